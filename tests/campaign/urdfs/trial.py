"""One arm from its URDF to motion: `init`, `check`, a wall push, a clearance, a pose, judged.

Nobody edits anything: the cell is as `init` writes it. The second run's cell begins at
`ready`, and has a sphere as an obstacle, which the stick drives at.
"""

import math
import re
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from telerobot.config.errors import ConfigError
from telerobot.config.load import altered, load_cell
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.judge import judge
from telerobot.tools.init.make import TO_WALL, Made, make
from telerobot.tools.init.robot import read_arms
from telerobot.tools.init.study import BALL
from telerobot.tools.init.wheels import base_of
from telerobot.tools.scripts.script import Script, Step
from telerobot.tools.simulation.simulation import Result, simulate

from .pictures import look

POSE_M: Final = 1e-3
"""A pose move ends no farther from its target [m]."""
FORCE: Final = 0.1
"""A push settles within this part of what was planned, and `NOISE` [1]."""
NOISE_N: Final = 0.3
CLEARANCE: Final = 0.02
"""Clearance that the cells of `init` promise [m]."""
ROUNDING: Final = 1e-3
"""Of what is measured in the physics, where the arm lags behind what it is told [m]."""
SPHERE: Final = 0.05
AHEAD: Final = 0.03
"""The sphere stands so far in front of the tool's ball [m]."""
DRIVE: Final = (0.3, 0.4)
"""A base on wheels drives so far ahead, and turns by so much then [m], [rad]."""
DRIVEN: Final = (0.005, 0.005)
"""It ends no farther from there [m], [rad]."""


@dataclass(frozen=True)
class UrdfTrial:
    """Result of one arm."""

    name: str
    joints: int = 0
    pose_m: float = float("nan")
    force_n: float = float("nan")
    """0 where `init` plans no push, as the arm cannot go straight."""
    clearance_m: float = float("nan")
    ratio: float = float("nan")
    """Volume of capsules by that of hulls, mean over the links that have meshes [1]."""
    reasons: list[str] = field(default_factory=list)
    init_s: float = float("nan")
    """Time from the URDF to a cell that has been checked and can move [s]."""


def try_arm(
    name: str,
    urdf: Path,
    tips: Sequence[str] = (),
    packages: Mapping[str, Path] | None = None,
    folder: Path | None = None,
) -> UrdfTrial:
    """Make a cell of a URDF, run it, and judge the runs; `tips` as for `init`.

    Cell and picture stay in `folder`, if there is one; without, nobody looks at a page.
    """
    if folder is None:
        with tempfile.TemporaryDirectory() as found:
            return _tried(name, urdf, tips, packages or {}, Path(found), drawn=False)
    folder.mkdir(parents=True, exist_ok=True)
    return _tried(name, urdf, tips, packages or {}, folder, drawn=True)


def _tried(
    name: str,
    urdf: Path,
    tips: Sequence[str],
    packages: Mapping[str, Path],
    folder: Path,
    *,
    drawn: bool,
) -> UrdfTrial:
    began = time.monotonic()
    out = folder / f"{name}.toml"
    try:
        arms = read_arms(urdf, tips, packages)
        made = make(arms, out, base_of(arms, packages))
        out.write_text(made.cell, encoding="utf-8")
        out.with_name(f"{name}_script.toml").write_text(made.script, encoding="utf-8")
        reasons = [
            f"check: {f.check}: {f.text}"
            for f in judge(load_cell(out))
            if f.status is Severity.ERROR
        ]
        init_s = time.monotonic() - began
        pushed = simulate(out)
        reasons += _against("push", pushed)
        force = float(str(pushed.summary["contact_force_n"])) if made.draft.push else 0.0
        if abs(force - made.draft.push) > FORCE * made.draft.push + NOISE_N:
            reasons.append(f"the push is {force:.3g} N, planned {made.draft.push:.3g} N")
        if drawn:
            reasons += look(load_cell(out), pushed, out.with_suffix(".png"))
        kept = _keep_clear(made, out)
        # The arm rightly stands off a target that the sphere is in the way of.
        blocked = any(name.endswith(":sphere") for name in kept.states[-1].limits)
        posed = _keep_clear(made, out, sphere=False) if blocked else kept
        reasons += _drive(made, out)
    except ConfigError as error:
        return UrdfTrial(name, reasons=list(error.messages))
    reasons += _against("clearance and pose", kept)
    reasons += _against("pose", posed) if blocked else []
    pose, clearance = posed.summary["tool_error_m"], kept.summary["min_clearance_m"]
    if not isinstance(pose, float) or pose > POSE_M:
        reasons.append(f"the pose move ends {pose} m from its target")
    if not isinstance(clearance, float) or clearance < CLEARANCE - ROUNDING:
        reasons.append(f"the sphere is passed at {clearance} m, promised {CLEARANCE:g}")
    elif clearance > AHEAD - ROUNDING:
        reasons.append(f"the arm never came near the sphere: {clearance:.3g} m")
    ratios = [fit.ratio for arm in arms for fit in arm.fits if np.isfinite(fit.ratio)]
    return UrdfTrial(
        name, sum(len(draft.drives) for draft in made.drafts), _number(pose), force,
        _number(clearance), float(np.mean(ratios)) if ratios else float("nan"), reasons, init_s,
    )  # fmt: skip


def _drive(made: Made, out: Path) -> list[str]:
    """Drive a base on wheels ahead and turn it, without the wall; return what speaks against it.

    Where it gets to is the physics' truth. Nothing of an arm that stands.
    """
    wheels = made.draft.wheels
    if wheels is None:
        return []
    v, w = min(0.15, wheels.speed), min(0.3, wheels.angular_speed)
    told = [(0.2, 0.0, 0.0), (1.0, v, 0.0), (1.0 + DRIVE[0] / v, 0.0, 0.0)]
    at = told[-1][0] + 1.5
    told += [(at, 0.0, w), (at + DRIVE[1] / w, 0.0, 0.0)]
    steps = [Step.model_validate({"at_s": s, "cmd/drive": {"rates": rates}}) for s, *rates in told]
    run = simulate(
        altered(load_cell(out), {"rig.wall": None}),
        Script(duration_s=told[-1][0] + 2.0, step=tuple(steps)),
    )
    reasons = _against("drive", run)
    begin, end = (run.truths[i].frames["base"] for i in (50, -1))
    ahead = math.cos(begin[5]) * (end[0] - begin[0]) + math.sin(begin[5]) * (end[1] - begin[1])
    aside = math.cos(begin[5]) * (end[1] - begin[1]) - math.sin(begin[5]) * (end[0] - begin[0])
    turned = math.remainder(end[5] - begin[5], 2.0 * math.pi)
    if math.hypot(ahead - DRIVE[0], aside) > DRIVEN[0] or abs(turned - DRIVE[1]) > DRIVEN[1]:
        reasons.append(
            f"the base gets {ahead:.4g} m ahead, {aside:.4g} m aside and turns by {turned:.4g} "
            f"rad, asked for {DRIVE[0]:g} m and {DRIVE[1]:g} rad"
        )
    if (error := float(str(run.summary["odometry_error_m"]))) > DRIVEN[0]:
        reasons.append(f"its odometry is {error:.3g} m off")
    return reasons


def _keep_clear(made: Made, out: Path, *, sphere: bool = True) -> Result:
    """Drive the tool at a sphere, then go back and to a pose; without the sphere, to the pose."""
    plan = made.plans[0]
    wall = made.draft.wall
    if wall is None:
        raise ConfigError(f"{out}: rig.wall: missing")
    ball = wall[0] - plan.forward * (TO_WALL + BALL)
    centre = ball + plan.forward * (BALL + AHEAD + SPHERE)
    obstacle = (
        '\n[[obstacles]]\nname = "sphere"\nshape = "sphere"\n'
        f"xyz = {centre.round(5).tolist()}\nradius = {SPHERE}\n"
    )
    cell = out.with_name(f"{out.stem}_clear.toml")
    # The arm begins at `ready`: at `start` a link may be where the sphere is.
    text = re.sub(
        "^start = .*", f"start = {made.draft.postures['ready']}", made.cell, count=1, flags=re.M
    )
    cell.write_text(text + obstacle * sphere, encoding="utf-8")
    twist = [*(0.03 * plan.forward).round(6).tolist(), 0.0, 0.0, 0.0]
    xyz, rpy = (values.round(6).tolist() for values in plan.target)
    frame = "world" if made.draft.wheels is None else "base"
    at = 0.2 + max(each.ready_s for each in made.plans)
    several = len(made.drafts) > 1
    of, task = (
        f'{key} = "{made.draft.arm.name}", ' if several else "" for key in ("mechanism", "task")
    )
    others = [
        f'[[step]]\nat_s = 0.2\n"cmd/posture" = {{ mechanism = "{draft.arm.name}", '
        'posture = "ready" }'
        for draft in made.drafts[1:]
    ]
    steps = [
        f'[[step]]\nat_s = 0.2\n"cmd/posture" = {{ {of}posture = "ready" }}',
        *others,
        f"[[step]]\nat_s = {at:.2f}\nfor_s = 2.5\n"
        f'"cmd/joystick" = {{ {task}twist = {twist}, expressed_in = "world" }}',
        f'[[step]]\nat_s = {at + 3.0:.2f}\n"cmd/posture" = {{ {of}posture = "ready" }}',
        f"[[step]]\nat_s = {at + 5.0 + plan.ready_s:.2f}\n"
        f'"cmd/position" = {{ {task}xyz = {xyz}, rpy = {rpy}, relative_to = "{frame}" }}',
    ]
    script = out.with_name(f"{out.stem}_clear_script.toml")
    ends = at + 7.0 + plan.ready_s + plan.target_s
    script.write_text("\n".join([f"duration_s = {ends:.1f}", *steps]), encoding="utf-8")
    return simulate(cell, str(script))


def _against(what: str, result: Result) -> list[str]:
    """Return what speaks against a run: it failed, missed what its script expects, broke a limit,
    or told an error."""
    reasons = [f"{what}: {row}" for row in result.expected if not row.met]
    if result.summary["failure"]:
        reasons.append(f"{what}: not played: {result.summary['failure']}")
    if result.summary["limit_violations"]:
        reasons.append(f"{what}: limits broken: {result.summary['violations']}")
    if own := result.summary["own_contact_n"]:
        reasons.append(f"{what}: links press each other with {own:.3g} N")
    events = result.summary["events"]
    reasons += [
        f"{what}: {event['name']} at {event['t_s']:.2f} s: {event['detail']}"
        for event in (events if isinstance(events, list) else [])
        if event["severity"] == "error"
    ]
    return reasons


def _number(value: object) -> float:
    return value if isinstance(value, float) else float("nan")
