"""`telerobot record CELL`: a running cell as MCAP files, by a process of its own."""

import argparse
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Final

from ....drivers.network.identity import identity_of
from ....drivers.network.sensor_session import dial
from ....protocols.topics import Role
from ...host.address import cell_from
from ...host.ending import until_told
from .files import Files
from .listener import CellRecorder
from .viewer import require_schemas

POLL_S: Final = 0.01
RETRY_S: Final = 0.5
"""While nobody answers, the daemon is dialled again after [s]."""


def run(args: argparse.Namespace) -> int:
    """Record until told to end. Raises `ConfigError`, `OSError` for a folder that takes no file."""
    require_schemas()
    cell = cell_from(args)
    identity = identity_of(cell, Role.OBSERVER, "recorder")
    over = until_told(args.seconds)
    stem = f"{cell.config.name}_{datetime.now(UTC).strftime('%Y%m%dT%H%M%SZ')}"
    files = Files(args.out, stem, cell, round(args.split * 1e6))
    session = dial(cell, identity, over)
    if session is None:
        files.close()
        return 0
    try:
        return record(CellRecorder(cell, session, files, args.pictures), files, over)
    finally:
        session.close()


def record(listener: CellRecorder, files: Files, over: Callable[[], bool]) -> int:
    """Write what is heard until it is over; return 1 where it could not be written any more."""
    for notice in listener.notices:
        print(f"telerobot: {notice}", file=sys.stderr, flush=True)
    print(f"telerobot: recording to {files.now.path}", flush=True)
    try:
        while not over():
            listener.turn()
            time.sleep(POLL_S)
        listener.turn()
        listener.close()
    except OSError as error:
        print(f"telerobot: recording ended: {files.now.path}: {error.strerror}", file=sys.stderr)
        return 1
    print(f"{listener.heard} messages and frames, the last to {files.now.path}")
    return 0
