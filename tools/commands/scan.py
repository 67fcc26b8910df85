"""`telerobot scan CELL`: takes the laser scanner's scans, and tells the daemon of obstacles."""

import argparse
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

from ...drivers.network.identity import identity_of
from ...drivers.network.sensor_session import dial
from ...protocols import topics as t
from ...protocols.topics import Role
from ...server.control import compilation
from ...server.perception.scanning.process import ScanWork
from ...server.perception.scanning.scanning import SCAN, Scanning
from ..host.address import cell_from
from ..host.local_plant import until_told
from ..host.progress import say, sparing

TOLD_EVERY_S = 5.0  # refused telegrams are told at most so often [s]


def run(args: argparse.Namespace) -> int:
    """Scan until told to end. Raises `ConfigError`."""
    cell = cell_from(args)
    scanning = Scanning(cell)
    # Silence for as long as a search takes would stop the base.
    scanning.reflex.elsewhere = ThreadPoolExecutor(1)
    for topic in (t.OBSTACLE, t.CONTOUR):  # it puts on both
        identity = identity_of(cell, Role.SENSOR, SCAN, topic.key)
    over = until_told(args.seconds)
    compilation.make_all()
    session = dial(cell, identity, over, f"the scanner of {cell.config.name} is looked through")
    if session is not None:
        told, complain = lambda line: say(f"telerobot: {line}"), sparing(TOLD_EVERY_S)
        with closing(session), closing(ScanWork(session, scanning, told, complain)) as work:
            work.run(over)
    counts = f"{scanning.scans} scans, {scanning.refused} telegrams refused"
    print(f"{counts}, {scanning.contours} contours")
    return 0
