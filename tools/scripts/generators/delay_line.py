"""Simulated connection of an operator: late, jittery, lossy, or cut."""

import heapq
import random
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Conditions:
    """Conditions of a connection."""

    delay_s: float = 0.0
    """One way, the same in both directions [s]."""
    jitter: float = 0.0
    """Part of the delay by which it varies to either side, each time anew [1]."""
    loss: float = 0.0
    """Part of what is sent that does not arrive [1]."""
    cut: bool = False


class DelayLine:
    """Carries datagrams, of which the newest wins, and reliable messages, in order.

    A datagram that is lost is gone, and so is one that a newer one of its stream has overtaken. A
    reliable message that is lost is sent anew after a round trip, and holds up those behind it. The
    line draws from its own seed: the same calls at the same times are carried alike.
    """

    def __init__(self, seed: int = 1, conditions: Conditions | None = None) -> None:
        self._draw = random.Random(seed)
        self._conditions = conditions or Conditions()
        self._underway: list[tuple[float, int, str | None, Callable[[], None]]] = []
        self._count = 0
        self._newest: dict[str, int] = {}
        self._reliable_s = 0.0

    def set(self, conditions: Conditions) -> None:
        """Carry under new conditions from now on; what is under way arrives as it was to."""
        self._conditions = conditions

    def carry(self, deliver: Callable[[], None], now_s: float, stream: str | None = None) -> None:
        """Carry a datagram of a stream; or a reliable message, where none is named."""
        now, self._count = self._conditions, self._count + 1
        if now.cut:
            return
        arrival_s = now_s + self._way(now)
        while now.loss and self._draw.random() < now.loss:
            if stream is not None:
                return
            arrival_s += 2.0 * self._way(now)
        if stream is None:
            arrival_s = self._reliable_s = max(arrival_s, self._reliable_s)
        if arrival_s <= now_s and not self._underway:
            self._arrive(self._count, stream, deliver)
        else:
            heapq.heappush(self._underway, (arrival_s, self._count, stream, deliver))

    def run(self, now_s: float) -> None:
        """Deliver what has arrived by now."""
        while self._underway and self._underway[0][0] <= now_s + 1e-9:
            self._arrive(*heapq.heappop(self._underway)[1:])

    def _way(self, now: Conditions) -> float:
        if not now.jitter:
            return now.delay_s
        return now.delay_s * (1.0 + now.jitter * self._draw.uniform(-1.0, 1.0))

    def _arrive(self, number: int, stream: str | None, deliver: Callable[[], None]) -> None:
        if stream is not None:
            if number < self._newest.get(stream, 0):
                return
            self._newest[stream] = number
        deliver()
