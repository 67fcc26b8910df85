"""Arguments of the commands whose modules take long to import: `--help` needs none of these."""

import argparse
import math
import os
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Any, Final

LONGEST_DAYS: Final = 3650
"""A certificate holds for so long at most [d]."""


def demo(parser: argparse.ArgumentParser) -> None:
    """`telerobot demo`."""
    parser.add_argument(
        "cell", metavar="CELL", nargs="?", default="pa10", help="which cell (default: pa10)"
    )
    parser.add_argument(
        "--headless", action="store_true", help="play a script over and over instead of keys"
    )
    parser.add_argument(
        "--seconds", type=duration, default=20.0, help="how long, headless (default: 20)"
    )
    parser.add_argument("--script", metavar="NAME", help="which script; the cell's by default")
    parser.add_argument(
        "--identity", metavar="FOLDER", help="certificates that the processes show each other"
    )
    parser.add_argument("--no-page", action="store_true", help="without the page in the browser")
    parser.add_argument("--json", action="store_true", help="print the headless summary as JSON")
    parser.add_argument(
        "--record", metavar="FOLDER", type=Path, help="record the demo, and its black boxes, there"
    )


def serve(parser: argparse.ArgumentParser) -> None:
    """`telerobot serve`."""
    rig(parser)
    parser.add_argument(
        "--statistics", metavar="FILE", type=Path, help="write the loop's timing as JSON"
    )
    parser.add_argument(
        "--blackbox",
        metavar="FOLDER",
        type=Path,
        default=_state_folder(),
        help="where the last 30 s before each fault and verified stop are written, 10 files of "
        "each kind at most (default: %(default)s)",
    )
    parser.add_argument(
        "--log", choices=("off", "error", "warning", "info"), default="info",
        help="events of this level and above are lines on stderr, with levels for journald "
        "(default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--record", metavar="FOLDER", type=Path, help="record the cell there, by another process"
    )


def rig(parser: argparse.ArgumentParser) -> None:
    """`telerobot rig`, and what else works beside a daemon until it is told to end."""
    cell_and_address(parser)
    parser.add_argument("--seconds", type=duration, help="end by itself after this long")


scan = rig


def vision(parser: argparse.ArgumentParser) -> None:
    """`telerobot vision`."""
    cell_and_address(parser)
    parser.add_argument("--camera", metavar="NAME", help="only this camera; all by default")
    parser.add_argument("--seconds", type=duration, help="end by itself after this long")
    parser.add_argument(
        "--pictures", metavar="FOLDER", type=Path, help="save what is seen there, once a second"
    )


def simulate(parser: argparse.ArgumentParser) -> None:
    """`telerobot simulate`."""
    _cell(parser)
    parser.add_argument(
        "script",
        metavar="SCRIPT",
        nargs="?",
        help="path of a script, or a shipped script's name; the cell's own by default",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--record", metavar="FILE", type=Path, help="write the run as MCAP")


def record(parser: argparse.ArgumentParser) -> None:
    """`telerobot record`."""
    cell_and_address(parser)
    parser.add_argument(
        "--out", metavar="FOLDER", type=Path, default=Path(), help="where to (default: here)"
    )
    parser.add_argument(
        "--split",
        metavar="MB",
        type=_within(1, 1e6, "MB"),
        default=500.0,
        help="begin a new file at this size (default: %(default)s)",
    )
    parser.add_argument(
        "--pictures",
        metavar="FOLDER",
        type=Path,
        help="record what `vision --pictures` saves there",
    )
    parser.add_argument("--seconds", type=duration, help="end by itself after this long")


def replay(parser: argparse.ArgumentParser) -> None:
    """`telerobot replay`."""
    parser.add_argument(
        "file", metavar="RUN.mcap", type=Path, help="a recorded run, or a black box"
    )
    parser.add_argument(
        "--until",
        metavar="T",
        type=float,
        help="replay up to here only: seconds from the recording's first tick; below 0, from its "
        "last one",
    )
    parser.add_argument(
        "--explain", action="store_true", help="print what every stage did in the last tick"
    )


def export(parser: argparse.ArgumentParser) -> None:
    """`telerobot export`."""
    parser.add_argument("file", metavar="RUN.mcap", type=Path, help="a recorded run")
    parser.add_argument(
        "--to", choices=("numpy", "parquet", "lerobot"), required=True, help="what to write"
    )
    parser.add_argument(
        "--out", metavar="FOLDER", type=Path, help="where to (default: beside the recording)"
    )
    parser.add_argument(
        "--fps", type=int, default=20, help="frames a second of a LeRobot data set (default: 20)"
    )
    parser.add_argument(
        "--task", default="teleoperation", help="words for what is shown, for LeRobot"
    )


def drive(parser: argparse.ArgumentParser) -> None:
    """`telerobot drive`."""
    cell_and_address(parser, bus=False)
    parser.add_argument(
        "script", metavar="SCRIPT", nargs="?", help="play this instead of reading the keyboard"
    )
    parser.add_argument(
        "--name",
        default=os.environ.get("USER") or "operator",
        help="the operator's name, as others see it (default: %(default)s)",
    )


def console(parser: argparse.ArgumentParser) -> None:
    """`telerobot console`."""
    cell_and_address(parser, bus=False, more=", or a recorded run: NAME.mcap")
    parser.add_argument(
        "--listen",
        metavar="HOST:PORT",
        default="127.0.0.1:8080",
        help="where browsers reach the console (default: %(default)s); port 0 takes a free one",
    )
    parser.add_argument("--open", action="store_true", help="open the page in a browser")
    parser.add_argument(
        "--certificate", type=Path, metavar="FILE", help="certificate of HTTPS, in PEM"
    )
    parser.add_argument("--key", type=Path, metavar="FILE", help="private key of --certificate")


def init(parser: argparse.ArgumentParser) -> None:
    """`telerobot init`."""
    parser.add_argument("urdf", metavar="ARM.urdf", type=Path, help="the arm's robot description")
    parser.add_argument(
        "--tip",
        metavar="LINK",
        action="append",
        default=[],
        help="last link of the arm, which the tool is bolted to; found where it is not said; said "
        "again for each other arm of the file, which become one cell",
    )
    parser.add_argument(
        "--out",
        metavar="CELL.toml",
        type=Path,
        help="file to write, its script beside it; by default the URDF's name, in this folder",
    )
    _package(parser, "")
    parser.add_argument("--force", action="store_true", help="write over files that exist")


def check(parser: argparse.ArgumentParser) -> None:
    """`telerobot check`."""
    _cell(parser)
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
    parser.add_argument(
        "--picture", type=Path, metavar="FILE.png",
        help="draw each link's shape and the capsules around it, with their volumes' ratio",
    )  # fmt: skip
    _package(parser, "with --picture: ")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def identify(parser: argparse.ArgumentParser) -> None:
    """`telerobot identify`."""
    cell_and_address(parser, bus=False)
    parser.add_argument(
        "--mechanism", metavar="NAME", help="whose sensor, where the cell has several"
    )
    parser.add_argument(
        "--posture", default="ready", help="the wrist turns about this one (default: %(default)s)"
    )
    parser.add_argument(
        "--attitudes",
        type=_within(6, 200, "attitudes", int),
        default=24,
        metavar="N",
        help="so many are measured, 6 to 200 (default: %(default)s)",
    )
    parser.add_argument(
        "--room",
        type=float,
        default=0.15,
        metavar="METRES",
        help="the tool stays within this distance of where the posture has it; nothing else keeps "
        "it from touching things (default: %(default)s)",
    )
    parser.add_argument(
        "--simulate", action="store_true", help="the cell's virtual hardware, in virtual time"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def soak(parser: argparse.ArgumentParser) -> None:
    """`telerobot soak`."""
    from .host import jobs

    _cell(parser)
    parser.add_argument(
        "--seeds", type=jobs.seeds, default=range(20), metavar="A:B", help="B excluded (0:20)"
    )
    jobs.add_arguments(parser, 1, None)


def doctor(parser: argparse.ArgumentParser) -> None:
    """`telerobot doctor`."""
    parser.add_argument(
        "cell", metavar="CELL", nargs="?", help="look at this cell's certificates, too"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--seconds",
        type=_within(0.01, 600, "seconds"),
        default=2.0,
        metavar="S",
        help="how long to measure the timer (default %(default)s)",
    )


def certify(parser: argparse.ArgumentParser) -> None:
    """`telerobot certify`."""
    holder = _judged_by("commands.certify", "holder")
    parser.add_argument(
        "cells", metavar="CELL", nargs="+", help="path of a cell file, or a shipped cell's name"
    )
    parser.add_argument(
        "--directory", metavar="FOLDER", type=Path,
        help="where the certificates lie, instead of the cell's zenoh.security.directory",
    )  # fmt: skip
    for role, who in (("operator", "may command"), ("observer", "may listen")):
        parser.add_argument(
            f"--{role}", metavar="NAME", type=holder, action="append", default=[], help=who
        )
    parser.add_argument(
        "--sensor", metavar="NAME[=KEY,…]", type=_judged_by("commands.certify", "sensor"),
        action="append", default=[],
        help="may put on these keys, as vision or obstacle; by default on that of its name",
    )  # fmt: skip
    parser.add_argument(
        "--router", metavar="NAME", type=holder, help="a router that the cells' daemons dial"
    )
    parser.add_argument(
        "--listen", metavar="tls/HOST:PORT", help="where the router listens (tls/[::]:7447)"
    )
    parser.add_argument(
        "--host", metavar="HOST", type=_judged_by("commands.certify", "host_name"),
        action="append", default=[],
        help="name or address under which daemon and router are dialled; this machine's are known",
    )  # fmt: skip
    parser.add_argument(
        "--days", metavar="N", type=_within(1, LONGEST_DAYS, "days", int), default=730,
        help="how long the certificates hold (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--renew", action="store_true",
        help="sign those anew that are there: for longer, or for more cells, keys and hosts; the "
        "private keys stay",
    )  # fmt: skip


def service(parser: argparse.ArgumentParser) -> None:
    """`telerobot service`."""
    _cell(parser)
    parser.add_argument(
        "--user", default="telerobot", help="who runs the daemon (default: %(default)s)"
    )
    parser.add_argument(
        "--cpus",
        metavar="LIST",
        help="processors for the daemon alone, such as 3 or 2-3 (default: those that the kernel "
        "was started with as isolated, if any)",
    )


def completion(parser: argparse.ArgumentParser) -> None:
    """`telerobot completion`."""
    import shtab

    parser.add_argument("shell", metavar="SHELL", choices=shtab.SUPPORTED_SHELLS, help="bash, zsh…")


def bench(
    parser: argparse.ArgumentParser,
    benches: Iterable[str] = ("tick", "simulate", "sync", "latency"),
) -> None:
    """`telerobot bench`."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures as JSON")
    parser.add_argument("--quick", action="store_true", help="fewer samples, within a minute")
    parser.add_argument(
        "--only", nargs="+", choices=(*benches,), metavar="NAME",
        default=(*benches,), help=f"of {', '.join(benches)}",
    )  # fmt: skip


def cell_and_address(parser: argparse.ArgumentParser, bus: bool = True, more: str = "") -> None:
    """Describe CELL and the options that move it; without `bus`, only the endpoint.

    `more` says what else may stand in the place of CELL.
    """
    _cell(parser, more)
    parser.add_argument(
        "--endpoint",
        metavar="tcp/HOST:PORT",
        help="where the daemon is reached, instead of the cell's zenoh.listen or zenoh.router",
    )
    parser.add_argument(
        "--identity",
        metavar="PATH",
        help="folder of the certificates, or the one to show, without .crt; instead of the cell's "
        "zenoh.security.directory",
    )
    if bus:
        parser.add_argument(
            "--channel",
            action="append",
            metavar="[BUS=]CHANNEL",
            help="CAN channel or multicast group, instead of the cell's; with the bus' name where "
            "there are several",
        )
        parser.add_argument(
            "--port",
            action="append",
            metavar="[BUS=]PORT",
            help="UDP port of a loopback bus, instead of the cell's",
        )
        parser.add_argument(
            "--scanner",
            metavar="tcp/HOST:PORT",
            help="where the laser scanner listens, instead of the cell's scanner.address",
        )


def _cell(parser: argparse.ArgumentParser, more: str = "") -> None:
    parser.add_argument(
        "cell", metavar="CELL", help=f"path of a cell file, or a shipped cell's name{more}"
    )


def _package(parser: argparse.ArgumentParser, where: str) -> None:
    parser.add_argument(
        "--package", metavar="NAME=DIR", action="append", default=[],
        help=f"{where}folder of a package that the URDF names as package://NAME; may be said again",
    )  # fmt: skip


def duration(text: str) -> float:
    """Return a duration from the command line [s]; it is positive and finite."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds above 0")
    return seconds


def _within(least: float, most: float, unit: str, kind: type = float) -> Callable[[str], Any]:
    """Return what reads a number of a `kind` from the command line, `least` to `most`."""

    def read(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            words = f"{text!r}: must be from {least:.7g} to {most:.7g} {unit}"
            raise argparse.ArgumentTypeError(words)
        return value

    return read


def _judged_by(module: str, function: str) -> Callable[[str], object]:
    """Return a judge of an argument in a module of the tools, imported when there is one."""

    def judge(text: str) -> object:
        judged: object = getattr(import_module(f"{__package__}.{module}"), function)(text)
        return judged

    return judge


def _state_folder() -> Path:
    """Return the folder of black boxes: a unit's of systemd, else the user's own."""
    given = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if given:
        return Path(given)
    own = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local/state")
    return Path(own) / "telerobot"
