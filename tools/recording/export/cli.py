"""`telerobot export RUN.mcap --to numpy|parquet|lerobot`: a recorded run as tables."""

import argparse

from ..run_file import read_cell
from .lerobot import write_lerobot
from .numpy_file import write_numpy
from .parquet import write_parquet
from .table import table_of


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
