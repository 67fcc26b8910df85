"""The black box: the log's last seconds as a file, at every fault and verified stop.

Written by a thread of its own, which holds the interpreter for a fraction of a millisecond at a
time. The tick looks only whether it is done.
"""

import contextlib
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from threading import Thread
from typing import Final

from .container import MEMORY, TICK, Stamped, joined
from .log import KeptTick, pack_memories

MOST: Final = 10
"""Files of each kind, of faults and of stops, that are kept of one cell, the newest [1]."""

YIELD_S: Final = 2e-3
"""Between two memories the writer sleeps, so that a tick need not wait for it [s]."""


@dataclass(frozen=True)
class Written:
    """The end of a file's writing."""

    path: Path
    failure: str | None
    """Why it could not be written, in one line; None where it was."""


class BlackBox:
    """Writes the files of one cell into a folder, one at a time."""

    def __init__(
        self,
        folder: Path,
        cell_name: str,
        cell: str,
        about: dict[str, str],
        wall_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """Build it; `cell` is the cell as text, `about` says what is run."""
        self._folder, self._name, self._cell, self._about = folder, cell_name, cell, about
        self._wall_ns = wall_ns
        self._done: deque[Written] = deque()
        self._thread: Thread | None = None

    @property
    def busy(self) -> bool:
        """True while a file is being written."""
        return self._thread is not None and self._thread.is_alive()

    def write(self, kind: str, rows: Sequence[KeptTick]) -> bool:
        """Begin to write rows to a file; return False where one is still being written."""
        if self.busy or not rows:
            return False
        at = datetime.fromtimestamp(self._wall_ns() / 1e9, UTC).strftime("%Y%m%dT%H%M%S%fZ")
        path = self._folder / f"blackbox_{self._name}_{at}_{kind}.mcap"
        about = {**self._about, "kind": kind}
        self._thread = Thread(
            target=self._write, args=(path, about, rows), name="black box", daemon=True
        )
        self._thread.start()
        return True

    def poll(self) -> Written | None:
        """Return a file whose writing came to an end since the last call, if any."""
        return self._done.popleft() if self._done else None

    def close(self) -> None:
        """Wait for the file that is being written."""
        if self._thread is not None:
            self._thread.join()

    def _write(self, path: Path, about: dict[str, str], rows: Sequence[KeptTick]) -> None:
        failure = None
        part = path.with_suffix(".part")
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            part.write_bytes(joined(self._cell, about, _messages(rows)))
            os.replace(part, path)
            self._drop_old(path)
        except (OSError, TypeError) as error:
            failure = " ".join(str(error).split())
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
        self._done.append(Written(path, failure))

    def _drop_old(self, newest: Path) -> None:
        kind = newest.stem.rpartition("_")[2]
        every = sorted(self._folder.glob(f"blackbox_{self._name}_????????T*Z_{kind}.mcap"))
        for old in every[:-MOST]:
            old.unlink(missing_ok=True)


def _messages(rows: Sequence[KeptTick]) -> Iterator[Stamped]:
    for row in rows:
        if row.memories is not None:
            yield Stamped(MEMORY, row.stamp_ns, pack_memories(row.memories))
            time.sleep(YIELD_S)
        yield Stamped(TICK, row.stamp_ns, row.data)
