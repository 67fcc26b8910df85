"""`telerobot serve CELL`: the daemon."""

import argparse
import json
from pathlib import Path

from ...server.daemon import serve
from ..host.address import add_cell_arguments, cell_from, duration


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    add_cell_arguments(parser)
    parser.add_argument("--seconds", type=duration, help="end by itself after this long")
    parser.add_argument(
        "--statistics", metavar="FILE", type=Path, help="write the loop's timing as JSON"
    )


def run(args: argparse.Namespace) -> int:
    """Serve until told to end. Raises `ConfigError`, `DeviceError`."""
    statistics = serve(cell_from(args), args.seconds)
    if args.statistics:
        args.statistics.write_text(json.dumps(statistics.figures()))
    print(statistics.line())
    return 0
