"""`telerobot serve CELL`: the daemon."""

import argparse
import json
from pathlib import Path

from ..config.load import load_cell
from ..server.daemon import serve


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument(
        "cell", metavar="CELL", help="path of a cell file, or a shipped cell's name"
    )
    parser.add_argument("--seconds", type=float, help="end by itself after this long")
    parser.add_argument("--statistics", metavar="FILE", type=Path, help="write the loop's timing as JSON")


def run(args: argparse.Namespace) -> int:
    """Serve until told to end. Raises `ConfigError`, `DeviceError`."""
    statistics = serve(load_cell(args.cell), args.seconds)
    if args.statistics:
        args.statistics.write_text(json.dumps(statistics.figures()))
    print(statistics.line())
    return 0
