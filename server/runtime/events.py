"""Events with cause and values; one of a name is sent at most a few times a second."""

from collections import deque
from collections.abc import Callable
from typing import Literal

from ...protocols.messages.telemetry import Event

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
        event = Event.model_construct(
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
