"""An operator's connection as a script has it: late, or cut."""

from collections import deque
from collections.abc import Callable


class DelayLine:
    """An operator's connection, both ways: in order, late by a set time, or cut."""

    def __init__(self) -> None:
        self._delay_s = 0.0
        self._cut = False
        self._underway: deque[tuple[float, Callable[[], None]]] = deque()

    def set(self, cut: bool, delay_s: float) -> None:
        """Cut the line, or let everything arrive `delay_s` late in each direction."""
        self._cut, self._delay_s = cut, delay_s

    def carry(self, deliver: Callable[[], None], now_s: float) -> None:
        """Carry something."""
        if self._cut:
            return
        if self._delay_s == 0.0 and not self._underway:
            deliver()
        else:
            self._underway.append((now_s + self._delay_s, deliver))

    def run(self, now_s: float) -> None:
        """Deliver what has arrived by now."""
        while self._underway and self._underway[0][0] <= now_s + 1e-9:
            self._underway.popleft()[1]()
