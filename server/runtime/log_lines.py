"""Events as lines on stderr, with levels, for people and for journald.

A line is `level=error event=fault t=12.340 tick=1234 detail="…" name=value …`. Where stderr is
journald's, the level is put before it as `<3>` (sd-daemon), so that `journalctl -p err` finds it.
The lines are written by a thread of their own: a reader that has stopped reading holds up no tick.
"""

import json
import os
from collections.abc import Mapping
from queue import SimpleQueue
from threading import Thread
from typing import IO, Final, Literal

from ...config.errors import LONGEST_LINE, printable
from ...protocols.messages.telemetry import Event

Level = Literal["off", "error", "warning", "info"]

PRIORITY: Final[Mapping[str, int]] = {"error": 3, "warning": 4, "info": 6}
"""Levels of syslog [1]."""
MOST_WAITING: Final = 1000
"""Lines that wait to be written; more are left out, and their number is told [1]."""
_LEVELS: Final = ("off", "error", "warning", "info")
_END_S: Final = 3.0


class LogLines:
    """Writes events of a level and above to a stream; `take` never waits."""

    def __init__(self, stream: IO[str], level: Level, *, journal: bool) -> None:
        self._stream, self._journal = stream, journal
        self._told = frozenset(_LEVELS[1 : _LEVELS.index(level) + 1])
        self._waiting: SimpleQueue[str | None] = SimpleQueue()
        self._left_out = 0
        self._thread = Thread(target=self._write, name="log lines", daemon=True)
        self._thread.start()

    def take(self, event: Event) -> None:
        """Have an event written, if its level is one that is told."""
        if event.severity in self._told:
            self._put(event.severity, line_of(event))

    def notice(self, text: str, level: Literal["warning", "info"] = "warning") -> None:
        """Have a sentence written, whatever the level."""
        self._put(level, f"telerobot: {printable(text)}")

    def close(self) -> None:
        """Let what waits be written, for a moment."""
        self._waiting.put(None)
        self._thread.join(_END_S)

    def _put(self, level: str, line: str) -> None:
        if self._waiting.qsize() >= MOST_WAITING:
            self._left_out += 1
            return
        if self._left_out:
            told, self._left_out = self._left_out, 0
            self._waiting.put(self._prefix("warning") + f"level=warning event=log left_out={told}")
        self._waiting.put(self._prefix(level) + line)

    def _prefix(self, level: str) -> str:
        return f"<{PRIORITY[level]}>" if self._journal else ""

    def _write(self) -> None:
        while (line := self._waiting.get()) is not None:
            try:
                self._stream.write(line + "\n")
                self._stream.flush()
            except (OSError, ValueError):  # nobody reads any more: the arm goes on
                return


def line_of(event: Event) -> str:
    """Return an event as one line of names and values."""
    named: dict[str, object] = {
        "level": event.severity,
        "event": event.name,
        "t": f"{event.time_s:.3f}",
        "tick": event.tick,
    }
    if event.detail:
        named["detail"] = event.detail
    values = {key: value for key, value in event.values.items() if key not in named}
    return " ".join(f"{key}={_value(value)}" for key, value in (named | values).items())


def is_journals(stream: IO[str], environment: Mapping[str, str]) -> bool:
    """Return whether journald reads a stream: its device and inode are JOURNAL_STREAM's."""
    try:
        found = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return environment.get("JOURNAL_STREAM") == f"{found.st_dev}:{found.st_ino}"


def _value(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    text = printable(value)
    plain = text and text == str(value) and not any(c in text for c in ' "=')
    return (
        text
        if plain
        else printable(json.dumps(str(value)[:LONGEST_LINE], ensure_ascii=False), 10 * LONGEST_LINE)
    )
