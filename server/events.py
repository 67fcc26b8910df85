"""Events with cause and values, seldom of one name; and as lines, for people and journald."""

import json
import os
from collections import deque
from collections.abc import Callable, Mapping
from queue import SimpleQueue
from threading import Thread
from typing import IO, Final, Literal

from ..config.errors import LONGEST_LINE, printable
from ..protocols.messages.telemetry import Event

# --- Events with cause and values; one of a name is sent at most a few times a second -------------

Severity = Literal["info", "warning", "error"]
Value = str | int | float | bool | None

PER_SECOND: dict[Severity, int] = {"info": 20, "warning": 3}
"""Events of one name that are sent within a second; more are counted and told later.

Errors are never held back.
"""


class Events:
    """Collects the events of a run until they are taken for sending."""

    def __init__(self) -> None:
        self._next_id = 1
        self._pending: deque[Event] = deque()
        self._recent: dict[str, deque[float]] = {}
        self._suppressed: dict[str, int] = {}
        self._standing: list[tuple[str, str, dict[str, Value]]] = []
        self.tick = 0
        self.time_s = 0.0
        self.taps: list[Callable[[Event], None]] = []
        """Called with every event that is told, in the tick."""

    def at(self, tick: int, time_s: float) -> None:
        """Set the tick and time that events are stamped with."""
        self.tick, self.time_s = tick, time_s

    def info(self, name: str, detail: str = "", /, **values: Value) -> None:
        """Note something that is well."""
        self._add("info", name, detail, values)

    def warning(self, name: str, detail: str = "", /, **values: Value) -> None:
        """Note something that was refused or limited."""
        self._add("warning", name, detail, values)

    def standing(self, name: str, detail: str = "", /, **values: Value) -> None:
        """Note something that is wrong for the whole run: now, and at each `remind`."""
        self._standing.append((name, detail, values))
        self.warning(name, detail, **values)

    def remind(self) -> None:
        """Repeat the standing events, for operators that have come since the run began."""
        for name, detail, values in self._standing:
            self.warning(name, detail, **values)

    def error(self, name: str, detail: str = "", /, **values: Value) -> None:
        """Note something that stops the arm."""
        self._add("error", name, detail, values)

    def refused(self, kind: str, key: str, reason: str, detail: str, count: int = 1) -> None:
        """Note that a command or a request was refused, or several on one key."""
        more: dict[str, Value] = {"count": count} if count > 1 else {}
        self._add(
            "warning",
            f"{kind}_refused",
            f"{key}: {detail}",
            {"topic": key, "reason": str(reason), **more},
        )

    def of(self, mechanism: str) -> "Events":
        """Return events that are told with the name of a mechanism; without one, the same."""
        return _MechanismEvents(self, mechanism) if mechanism else self

    def take(self) -> list[Event]:
        """Return and forget what happened since the last call."""
        taken = list(self._pending)
        self._pending.clear()
        return taken

    def _add(self, severity: Severity, name: str, detail: str, values: dict[str, Value]) -> None:
        kind = f"{name} of {values['mechanism']}" if "mechanism" in values else name
        recent = self._recent.setdefault(kind, deque())
        while recent and recent[0] <= self.time_s - 1.0:
            recent.popleft()
        if len(recent) >= PER_SECOND.get(severity, len(recent) + 1):
            self._suppressed[kind] = self._suppressed.get(kind, 0) + 1
            return
        recent.append(self.time_s)
        suppressed = self._suppressed.pop(kind, 0)
        if suppressed:
            values = {**values, "suppressed": suppressed}
        event = Event.of_valid(
            id=self._next_id,
            tick=self.tick,
            time_s=self.time_s,
            name=name,
            severity=severity,
            detail=detail[:1000],
            values=values,
        )
        self._pending.append(event)
        self._next_id += 1
        for tap in self.taps:
            tap(event)


class _MechanismEvents(Events):
    """Events of one mechanism of several: each tells its name."""

    def __init__(self, whole: Events, mechanism: str) -> None:
        super().__init__()
        self._whole, self._mechanism = whole, mechanism

    def _add(self, severity: Severity, name: str, detail: str, values: dict[str, Value]) -> None:
        named: dict[str, Value] = {"mechanism": self._mechanism, **values}
        self._whole._add(severity, name, detail, named)


# --- Events as lines on stderr, with levels, for people and for journald --------------------------
#
# A line is `level=error event=fault t=12.340 tick=1234 detail="…" name=value …`. Where stderr
# is journald's, the level is put before it as `<3>` (sd-daemon), so that `journalctl -p err`
# finds it. The lines are written by a thread of their own: a reader that has stopped reading
# holds up no tick.

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
