"""Jam monitor: tells when the tool, or a payload, is pressed on without getting any further.

Rate and force together press with what is asked of the motion over the gain, for ever: on an edge
beside a hole as well as in it. Every `SAMPLE_S` it is looked at what the sources ask of the tool,
what it presses with, and where it is; over a window of `JAMMED_S` these tell a motion that is held
up by contact from one that goes on, however slowly it was asked for.

A plain wall is pressed on by the same means, and because an operator means to: it answers straight
against the push, through the MRF. That is told quietly, `held_up`. A peg on a rim or askew in its
hole is pressed beside its axis, or from the side: `jammed`, and so is a payload's every stop.
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
BESIDE = 2e-3
"""A push whose line passes the MRF by more than this is one on an edge [m]."""
TILTS = 0.03
"""If its moment is more than this: the sensor's payload is known no better [N·m]."""
ASIDE = 0.3
"""And so is one that is answered from the side by more than that part of it [1]."""


class _Sample(NamedTuple):
    """One look; vectors (3,) in World axes."""

    asked: Array
    """Velocity that is asked for [m/s]."""
    force: Array
    """Force that is exerted [N]."""
    moment: Array
    """And the moment, at the MRF [N·m]."""
    at: Array
    """Where the MRF was measured [m]."""


class JamMonitor:
    """Tells a jam once, and again only after progress or another motion."""

    def __init__(self, period_s: float, events: Events, *, carries: bool = False) -> None:
        """Build it for a tool, or for a payload that several arms carry (`carries`)."""
        self._events, self._carries = events, carries
        self._every = max(1, round(SAMPLE_S / period_s))
        self._ticks = 0
        self._seen: deque[_Sample] = deque(maxlen=1 + round(JAMMED_S / SAMPLE_S))
        self.jammed = False
        """True while an edge, or anything a payload meets, holds the motion up."""
        self._held = False

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
        force, moment = output.wrench_mrf.reshape(2, 3) @ T.R.T
        self._seen.append(_Sample(asked, force, moment, T.p))
        if len(self._seen) == self._seen.maxlen:
            self._judge()

    def _judge(self) -> None:
        seen = tuple(self._seen)
        asked = np.mean([sample.asked for sample in seen], axis=0)
        speed = _size(asked)
        if speed < SLOWEST:
            # There and back, as in a search.
            self.jammed = self._held = False
            return
        along = asked / speed
        way = float((seen[-1].at - seen[0].at) @ along)
        pressed = min(float(sample.force @ along) for sample in seen)
        held = way < HELD_UP * speed * JAMMED_S and pressed > PRESSED_N
        force = np.mean([sample.force for sample in seen], axis=0)
        moment = np.mean([sample.moment for sample in seen], axis=0)
        jammed = held and (self._carries or _on_edge(force, moment, along))
        if (jammed and not self.jammed) or (held and not self._held):
            push, asked_m = float(force @ along), speed * JAMMED_S
            (self._events.warning if jammed else self._events.info)(
                "jammed" if jammed else "held_up",
                f"pressed with {push:.1f} N for {JAMMED_S:g} s and got {1e3 * way:.1f} mm further "
                f"of {1e3 * asked_m:.1f} that were asked for",
                force_n=push,
                way_m=way,
                asked_m=asked_m,
            )
        # The sensor's noise takes nothing back that was told.
        self.jammed, self._held = held and (jammed or self.jammed), held

    def _forget(self) -> None:
        self._seen.clear()
        self.jammed = self._held = False


def _on_edge(force: Array, moment: Array, along: Array) -> bool:
    """Return whether a mean wrench at the MRF is none of a push `along` on a plain wall."""
    push, across = float(force @ along), np.cross(force, moment) / _size(force)
    aside = _size(force - push * along) > ASIDE * push
    return aside or _size(across) > max(TILTS, BESIDE * _size(force))


def _size(vector: Array) -> float:
    return math.sqrt(float(vector @ vector))
