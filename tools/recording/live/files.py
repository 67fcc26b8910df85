"""The files of one recording: a new one when the last is large, each with the whole cell in it."""

from collections.abc import Callable
from pathlib import Path

from ....config.load import Cell
from ..recorder import Recorder

Open = Callable[[Path], Recorder]
"""Opens a file. Raises `OSError`."""


class Files:
    """Recorders one after the other: `STEM_0000.mcap`, `STEM_0001.mcap`, …"""

    def __init__(
        self, folder: Path, stem: str, cell: Cell, largest: int, opened: Open = Recorder
    ) -> None:
        """Open the first; a file that has `largest` bytes is the last but one.

        Raises `OSError`.
        """
        self._folder, self._stem, self._cell, self._largest = folder, stem, cell, largest
        self._open, self._number = opened, 0
        folder.mkdir(parents=True, exist_ok=True)
        self.now = self._next()
        """The recorder to write to."""

    def turn(self) -> None:
        """Hand what is written to the system, and begin a new file when it is time.

        Raises `OSError`, as for a disk that is full.
        """
        self.now.flush()
        if self.now.size >= self._largest:
            self.now.close()
            self.now = self._next()

    def close(self) -> None:
        """Finish the last one. Raises `OSError`."""
        self.now.close()

    def _next(self) -> Recorder:
        recorder = self._open(self._folder / f"{self._stem}_{self._number:04d}.mcap")
        recorder.about(self._cell, part=str(self._number))
        self._number += 1
        return recorder
