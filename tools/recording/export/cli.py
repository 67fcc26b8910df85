"""`telerobot export RUN.mcap --to numpy|parquet|lerobot`: a recorded run as tables."""

import argparse
from pathlib import Path

from ..run_file import read_cell
from .lerobot import write_lerobot
from .numpy_file import write_numpy
from .parquet import write_parquet
from .table import table_of

FPS = 20
"""Frames a second of a LeRobot data set by default [1/s]."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument("file", metavar="RUN.mcap", type=Path, help="a recorded run")
    parser.add_argument(
        "--to", choices=("numpy", "parquet", "lerobot"), required=True, help="what to write"
    )
    parser.add_argument(
        "--out", metavar="FOLDER", type=Path, help="where to (default: beside the recording)"
    )
    parser.add_argument(
        "--fps", type=int, default=FPS, help="frames a second of a LeRobot data set (default: 20)"
    )
    parser.add_argument(
        "--task", default="teleoperation", help="words for what is shown, for LeRobot"
    )


def run(args: argparse.Namespace) -> int:
    """Export a run. Raises `ConfigError` for a package that is missing, `OSError`."""
    out = args.out or args.file.with_suffix(f".{args.to}")
    table = table_of(args.file, read_cell(args.file))
    if args.to == "numpy":
        write_numpy(table, out)
    elif args.to == "parquet":
        write_parquet(table, out)
    else:
        write_lerobot(table, out, max(1, args.fps), args.task)
    pictures = sum(map(len, table.pictures.values()))
    print(f"{out}: {table.rows} ticks, {len(table.events)} events, {pictures} pictures")
    return 0
