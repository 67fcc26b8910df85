"""Jam monitor: tells when the tool, or a payload, is pressed on without getting any further.

Rate and force together press with what is asked of the motion over the gain, for ever: on an edge
beside a hole as well as in it. Every `SAMPLE_S` it is looked at what the sources ask of the tool,
what it presses with, and where it is; over a window of `JAMMED_S` these tell a motion that is held
up by contact from one that goes on, however slowly it was asked for.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from ...control.spatial import Array
from ...control.state import Output
from ...control.task.task import FRAMES
from ...runtime.events import Events
from ...stability.gains import WRENCH_SOURCES

SAMPLE_S = 0.1
"""It is looked so often [s]."""
JAMMED_S = 2.0
"""Force without progress for so long is a jam [s]."""
SLOWEST = 5e-4
"""Whatever is asked for less, as by a stick at rest, is no motion [m/s]."""
HELD_UP = 0.1
"""Less of what was asked for than this part is no progress [1]."""
PRESSED_N = 5.0
"""Below this against the motion something else holds it up, as a limit does [N]."""


class _Sample(NamedTuple):
    """One look; vectors (3,) in World axes."""

    asked: Array
    """Velocity that is asked for [m/s]."""
    force: Array
    """Force that is exerted [N]."""
    at: Array
    """Where the MRF was measured [m]."""


class JamMonitor:
    """Tells a jam once, and again only after progress or another motion."""

    def __init__(self, period_s: float, events: Events) -> None:
        self._events = events
        self._every = max(1, round(SAMPLE_S / period_s))
        self._ticks = 0
        self._seen: deque[_Sample] = deque(maxlen=1 + round(JAMMED_S / SAMPLE_S))
        self.jammed = False
        """True while something holds the motion up."""

    def update(self, output: Output | None) -> None:
        """Take in a tick; None or no reading of the sensor: nothing is known."""
        self._ticks += 1
        if self._ticks % self._every:
            return
        if output is None or output.wrench_mrf is None:
            self._forget()
            return
        asked = np.zeros(3)
        for name, twist in output.twists.items():
            if name not in WRENCH_SOURCES and name != FRAMES:
                asked += twist[:3]
        if _size(asked) < SLOWEST:
            self._forget()
            return
        T = output.T_world_mrf_measured
        self._seen.append(_Sample(asked, T.R @ output.wrench_mrf[:3], T.p))
        if len(self._seen) == self._seen.maxlen:
            self._judge()

    def _judge(self) -> None:
        seen = tuple(self._seen)
        asked = np.mean([sample.asked for sample in seen], axis=0)
        speed = _size(asked)
        if speed < SLOWEST:
            # There and back, as in a search.
            self.jammed = False
            return
        along = asked / speed
        way = float((seen[-1].at - seen[0].at) @ along)
        pressed = min(float(sample.force @ along) for sample in seen)
        held = way < HELD_UP * speed * JAMMED_S and pressed > PRESSED_N
        if held and not self.jammed:
            force = float(np.mean([sample.force @ along for sample in seen]))
            self._events.warning(
                "jammed",
                f"pressed with {force:.1f} N for {JAMMED_S:g} s and got {1e3 * way:.1f} mm further "
                f"of {1e3 * speed * JAMMED_S:.1f} that were asked for",
                force_n=force,
                way_m=way,
                asked_m=speed * JAMMED_S,
            )
        self.jammed = held

    def _forget(self) -> None:
        self._seen.clear()
        self.jammed = False


def _size(vector: Array) -> float:
    return math.sqrt(float(vector @ vector))
