"""`telerobot check CELL`: checks beyond the schema, one line each with its numbers."""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from ...config.errors import ConfigError
from ...config.load import Cell, load_cell
from ...config.urdf.meshes import packages_of
from ..checks.findings import Finding, Severity, failed, summary, table, to_json
from ..checks.hardware.on_bus import on_bus
from ..checks.hardware.trial import profile
from ..checks.judge import judge
from ..recording.plot import require_matplotlib

STANDS_OUT: Final = 5e-4
"""A shape that its capsules do not hold by more than this is worth a word [m]."""


def run(args: argparse.Namespace) -> int:
    """Print the findings; return 0, or 1 if one is an error.

    Raises `ConfigError`, and `DeviceError` where a bus is to be asked and cannot be.
    """
    cell = load_cell(args.cell)
    if args.power and args.profile is None:
        raise ConfigError("check: --power is of use with --profile JOINT only")
    if args.bus:
        findings = on_bus(cell, time.monotonic)
    elif args.profile is not None:
        findings = list(profile(cell, args.profile, time.monotonic, power=args.power))
    else:
        findings = judge(cell)
    if args.picture is not None:
        findings += _picture(cell, args.picture, args.package)
    bad = failed(findings)
    if args.json:
        print(to_json({"cell": cell.config.name, "path": str(cell.path), "ok": not bad}, findings))
    else:
        print(table(findings))
        print(f"{cell.config.name}: {summary(findings)}")
    return 1 if bad else 0


def _picture(cell: Cell, out: Path, packages: Sequence[str]) -> list[Finding]:
    """Draw links and capsules into a file; return how tight each link's capsules are."""
    if out.suffix not in (".png", ".svg") or not out.parent.is_dir():
        raise ConfigError(f"--picture: value '{out}': must end in .png or .svg, in a folder")
    require_matplotlib()
    from ..recording.plot.scenes import covers, drawn

    links = covers(cell, packages_of(packages))
    drawn(f"{cell.config.name}: shapes of links, and their capsules", links).savefig(out, dpi=110)
    found = [
        Finding(
            f"shape of {link.link}",
            Severity.WARN if link.outside > STANDS_OUT else Severity.OK,
            link.text(),
            {"capsules": len(link.tubes), "ratio": link.ratio, "outside": link.outside},
        )
        for link in links
    ]
    return [*found, Finding("picture", Severity.OK, str(out))]
