"""`telerobot serve CELL`: the daemon."""

import argparse
import json
import os
from pathlib import Path

from ...server.daemon import serve
from ..host.address import add_cell_arguments, cell_from, duration
from ..host.recording import recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    add_cell_arguments(parser)
    parser.add_argument("--seconds", type=duration, help="end by itself after this long")
    parser.add_argument(
        "--statistics", metavar="FILE", type=Path, help="write the loop's timing as JSON"
    )
    parser.add_argument(
        "--blackbox",
        metavar="FOLDER",
        type=Path,
        default=state_folder(),
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


def run(args: argparse.Namespace) -> int:
    """Serve until told to end. Raises `ConfigError`, `DeviceError`."""
    cell = cell_from(args)
    with recording(cell, args.record):
        statistics = serve(cell, args.seconds, args.blackbox, args.log)
    if args.statistics:
        args.statistics.write_text(json.dumps(statistics.figures()))
    print(statistics.line())
    return 0


def state_folder() -> Path:
    """Return the folder of black boxes: a unit's of systemd, else the user's own."""
    given = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if given:
        return Path(given)
    own = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local/state")
    return Path(own) / "telerobot"
