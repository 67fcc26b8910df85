"""`telerobot init ARM.urdf`: writes a cell for an arm that runs on virtual hardware at once."""

import argparse
import math
import time
from pathlib import Path

import numpy as np

from ...config.errors import ConfigError
from ...config.load import load_cell
from ...config.urdf.meshes import packages_of
from ..checks.findings import Severity
from ..checks.judge import judge
from .make import Made, make
from .robot import read_arms
from .wheels import base_of


def run(args: argparse.Namespace) -> int:
    """Write the cell and its script; return 0, or 1 where a check of it fails.

    Raises `ConfigError` for a URDF that no cell can be made of.
    """
    began = time.monotonic()
    if not args.urdf.is_file():
        raise ConfigError(f"{args.urdf}: no such file")
    out = args.out or Path(f"{args.urdf.name.split('.')[0]}.toml")
    if out.suffix != ".toml":
        raise ConfigError(f"--out: value '{out}': must end in .toml")
    beside = out.with_name(f"{out.stem}_script.toml")
    for path in (out, beside):
        if path.exists() and not args.force:
            raise ConfigError(f"{path}: is there already: give another --out, or --force")
        if not path.parent.is_dir():
            raise ConfigError(f"{path.parent}: no such folder")
    print(f"{args.urdf}: fitting capsules around its links …", flush=True)
    packages = packages_of(args.package)
    arms = read_arms(args.urdf, args.tip, packages)
    made = make(arms, out, base_of(arms, packages))
    out.write_text(made.cell, encoding="utf-8")
    beside.write_text(made.script, encoding="utf-8")
    bad = [f for f in judge(load_cell(out)) if f.status is Severity.ERROR]
    for line in _report(made):
        print(line)
    for finding in bad:
        print(f"error  {finding.check}: {finding.text}")
    print(f"written in {time.monotonic() - began:.0f} s: {out} and {beside}")
    print(f"next: telerobot simulate {out}; then look at the lines that say CONFIRM")
    return 1 if bad else 0


def _report(made: Made) -> list[str]:
    """Return what was found and what was made up, a line each."""
    lines = []
    for draft in made.drafts:
        arm, drives = draft.arm, draft.drives
        reach = f"{len(drives)} joints, {drives[0].joint} to {drives[-1].joint}; tip {arm.tip}"
        ahead = 1e3 * float(np.linalg.norm(draft.mrf))
        lines += [
            f"{arm.name}: {reach}",
            f"{arm.name}: the tool is at {arm.tip}, MRF {ahead:.0f} mm off",
        ]
        if not draft.push:
            lines += [
                f"{arm.name}: its {len(drives)} joints cannot go straight at a wall: "
                "the script does not push"
            ]
        if arm.standing:
            lines += [f"{arm.name}: stands on joints that are held: {', '.join(arm.standing)}"]
        if arm.fingers:
            lines += [f"{arm.name}: a gripper, no joints of the arm: {', '.join(arm.fingers)}"]
    told = {name for draft in made.drafts for name in draft.arm.fingers}
    if (wheels := made.draft.wheels) is not None:
        told |= {drive.joint for drive in wheels.drives}
        lines += [
            f"base: drives on {wheels.names}, radius {wheels.radius:g} m, track {wheels.track:g} m"
        ]
        lines += [f"joint {drive.joint}: {note}" for drive in wheels.drives for note in drive.notes]
    if made.draft.base_held:
        lines += [f"base: held: {made.draft.base_held}"]
    if held := [name for name in made.draft.arm.held if name not in told]:
        lines += [f"held at zero: {', '.join(held)}"]
    for i, draft in enumerate(made.drafts):
        for fit in draft.fits:
            if i and fit.link not in draft.arm.own:
                continue
            tight = "its shape is flat" if math.isinf(fit.ratio) else f"{fit.ratio:.2f} × its hull"
            also = f"; they hold {', '.join(fit.holds)}" if fit.holds else ""
            lines += [f"link {fit.link}: {len(fit.tubes)} capsules, {tight}{also}"]
        lines += [
            f"link {given.link}: mass {given.mass:.3g} kg estimated from its shape: {given.why}"
            for given in draft.arm.inertials
            if not i or given.link in draft.arm.own
        ]
        lines += [f"joint {drive.joint}: {note}" for drive in draft.drives for note in drive.notes]
    return lines
