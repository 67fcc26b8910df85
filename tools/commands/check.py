"""`telerobot check CELL`: checks beyond the schema, one line each with its numbers."""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

from ...config.errors import ConfigError
from ...config.load import Cell, load_cell
from ..checks.arms import arms
from ..checks.bus_load import bus_load
from ..checks.drives import drives
from ..checks.enabling import enabling
from ..checks.findings import Finding, failed, summary, table, to_json
from ..checks.hardware.on_bus import on_bus
from ..checks.hardware.profile import profile
from ..checks.holding import holding
from ..checks.loops.following import following
from ..checks.loops.joint_tasks import joint_tasks
from ..checks.loops.reflection import reflection
from ..checks.loops.stability import stability
from ..checks.loops.torque import torque
from ..checks.model.postures import postures
from ..checks.model.starting import starting
from ..checks.network import network
from ..checks.rover.own_rays import own_rays
from ..checks.rover.sight import sight
from ..checks.rover.sweep import sweep
from ..checks.rover.wheels import wheels
from ..checks.sensors import sensors
from ..checks.timing import sampling, timing
from ..checks.tunnel import tunnel

Check = Callable[[Cell], Iterator[Finding]]

OF_THE_CELL: Final[tuple[Check, ...]] = (
    timing,
    network,
    bus_load,
    arms,
    joint_tasks,
    starting,
)

OF_AN_ARM: Final[tuple[Check, ...]] = (
    sampling,
    drives,
    enabling,
    stability,
    reflection,
    postures,
    tunnel,
    wheels,
    sweep,
    sight,
    own_rays,
    holding,
    torque,
    following,
    sensors,
)


def judge(cell: Cell) -> list[Finding]:
    """Return what every check found about a cell, and about each of its arms by its name."""
    found = [finding for check in OF_THE_CELL for finding in check(cell)]
    for part in cell.parts:
        of_arm = [finding for check in OF_AN_ARM for finding in check(part)]
        found += [replace(finding, check=f"{part.prefix}{finding.check}") for finding in of_arm]
    return found


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument(
        "cell", metavar="CELL", help="path of a cell file, or a shipped cell's name"
    )
    hardware = parser.add_mutually_exclusive_group()
    hardware.add_argument(
        "--bus", action="store_true",
        help="ask everybody on the cell's buses who they are and what they hold, and compare; "
        "moves and writes nothing",
    )  # fmt: skip
    hardware.add_argument(
        "--profile", metavar="JOINT",
        help="try the rules of CiA 301 and CiA 402 on that joint's drive, which stands and is off; "
        "writes objects and puts them back",
    )  # fmt: skip
    parser.add_argument(
        "--power", action="store_true",
        help="with --profile: also the rules that need the drive switched on, brake open, held",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print one JSON object")


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
    bad = failed(findings)
    if args.json:
        print(to_json({"cell": cell.config.name, "path": str(cell.path), "ok": not bad}, findings))
    else:
        print(table(findings))
        print(f"{cell.config.name}: {summary(findings)}")
    return 1 if bad else 0
