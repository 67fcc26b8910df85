"""Flight recorder of the cycle: it keeps every tick, and acts when the mode changes."""

from typing import Final

from ..mode import Mode
from ..runtime.events import Events
from .black_box import BlackBox
from .log import FlightLog

AFTER: Final = 50
"""Ticks that a black box has after the fault [1]."""


class Flight:
    """The log of a cell's ticks, and the black box that it fills; `box` None: none is written."""

    def __init__(self, log: FlightLog, events: Events, box: BlackBox | None = None) -> None:
        self.log, self._events, self._box = log, events, box
        self._mode = Mode.BOOT
        self._due: tuple[str, int] | None = None
        """Kind and tick of the file that is to be written."""

    def end(self, tick: int, mode: Mode) -> None:
        """Take in the mode at the end of a period; write the black box where that says so."""
        before, self._mode = self._mode, mode
        box = self._box
        if box is None:
            return
        if mode is Mode.FAULT and before is not Mode.FAULT:
            self._due = "fault", tick + AFTER
        elif before is Mode.STOPPING and mode is not Mode.STOPPING and self._due is None:
            self._due = "stop", tick
        if self._due is not None and tick >= self._due[1]:
            self._write(box, self._due[0])
        written = box.poll()
        if written is None:
            return
        if written.failure is None:
            self._events.info("black_box", str(written.path), path=str(written.path))
        else:
            self._events.warning("black_box_failed", f"{written.path}: {written.failure}")

    def close(self) -> None:
        """Write what is still due, and wait for it."""
        box = self._box
        if box is None:
            return
        box.close()
        if self._due is not None:
            self._write(box, self._due[0])
            box.close()

    def _write(self, box: BlackBox, kind: str) -> None:
        if box.write(kind, tuple(self.log.rows)):
            self._due = None
