"""Session of a process that tells the daemon of the world: it dials, and looks for news."""

import sys
import time
from collections.abc import Callable

from ...config.errors import printable
from ...config.load import Cell
from ...protocols.codec import CodecError, MessageT, decode_as
from .identity import Identity
from .session import Session, TopicBuffer

Over = Callable[[], bool]
"""Returns True once it is time to end."""

RETRY_S = 0.5
"""While nobody answers, the daemon is dialled again after [s]."""


def dial(cell: Cell, identity: Identity | None, over: Over, ready: str = "") -> Session | None:
    """Return a session with the daemon, however long it takes to appear; None when told to end.

    It is dialled once in any case. `ready` is printed then, if given.
    """
    told_so = False
    while True:
        try:
            session = Session(cell.config.name, cell.config.zenoh.dialled, identity)
        except ConnectionError as error:
            if not told_so:
                told_so = True
                print(f"telerobot: waiting: {printable(error)}", file=sys.stderr, flush=True)
            if over():
                return None
            time.sleep(RETRY_S)
        else:
            if ready:
                print(f"telerobot: {ready}", flush=True)
            return session


def newest(inbox: TopicBuffer, kind: type[MessageT], max_bytes: int) -> MessageT | None:
    """Return the newest message that came; what is none is passed over."""
    found = None
    for payload in inbox.take():
        try:
            found = decode_as(kind, payload, max_bytes)
        except CodecError:
            continue
    return found
