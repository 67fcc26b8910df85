"""Answers to requests, sent by a thread of their own, because a hand-over to Zenoh may block.

Even to let go of a request waits, for locks that Zenoh's threads hold, or for room on the way to
who asked. A tick shall not. This thread does nothing else, and knows nothing of the daemon.
"""

import contextlib
import os
import threading
from queue import SimpleQueue
from typing import Final

import zenoh

from ..runtime.operating_system import PRIORITY

MOST: Final = 1024
"""While more answers wait than this, no further requests are taken in [1]."""

END_S: Final = 2.0
"""Answers that are under way at the end are waited for [s]."""


class AnswerThread:
    """Sends answers, or lets requests go without one, in the order in which they are given."""

    def __init__(self) -> None:
        self._waiting: SimpleQueue[tuple[zenoh.Query, str, bytes | None] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="answers", daemon=True)
        self._thread.start()

    @property
    def crowded(self) -> bool:
        """True while so many wait that no more requests should be taken in."""
        return self._waiting.qsize() > MOST

    def give(self, query: "zenoh.Query", key: str, payload: bytes | None) -> None:
        """Answer a request on a key, or with None let it go; returns at once."""
        self._waiting.put((query, key, payload))

    def close(self) -> None:
        """Send what waits, and end."""
        self._waiting.put(None)
        self._thread.join(END_S)

    def _run(self) -> None:
        # Who waits for this thread is the loop, for the interpreter's lock: ordinary threads must
        # not keep it from giving that back. Where it is denied, the loop's own notice says so.
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY - 1))
        while (given := self._waiting.get()) is not None:
            query, key, payload = given
            with contextlib.suppress(zenoh.ZError):  # who asked is gone
                if payload is not None:
                    query.reply(key, payload)
            query.drop()  # type: ignore[no-untyped-call]  # its stubs
