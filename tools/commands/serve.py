"""`telerobot serve CELL`: the daemon."""

import argparse
import json

from ...server.daemon import serve
from ..host.address import cell_from
from ..host.local_plant import recording


def run(args: argparse.Namespace) -> int:
    """Serve until told to end. Raises `ConfigError`, `DeviceError`."""
    cell = cell_from(args)
    with recording(cell, args.record):
        statistics = serve(cell, args.seconds, args.blackbox, args.log)
    if args.statistics:
        args.statistics.write_text(json.dumps(statistics.figures()))
    print(statistics.line())
    return 0
