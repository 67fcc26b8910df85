"""Force/torque monitor: tells when the sensor falls silent or saturates, averages it for a tare."""

from collections import deque
from collections.abc import Mapping

import numpy as np

from ...drivers.device import Cause
from ..control.mechanism.payload import Payload
from ..control.spatial import GRAVITY, Array, sizes
from ..plant import UnitReading
from ..runtime.events import Events
from ..stability.gains import WRENCH_SOURCES
from .filters.collision import UNKNOWN_LOAD

TARE_S = 0.3
"""A tare averages the sensor over this time [s]."""

STILL = 1e-3
"""An arm stands for a tare while every joint stayed within this over that time [rad, m].

Force control follows the sensor's noise: where it is on, no command is ever quite zero. Within this
a tool moves by millimetres a second, so that no force of inertia counts, and weight is known.
"""

ASKED = np.array([1e-3] * 3 + [2e-3] * 3)
"""And while nothing but the sensor itself asks for more than this (6,) [m/s, rad/s].

What a stick pushes against a wall stands, too: its push is what force control and stick agree on.
"""

NAME = "force_torque"

WEIGHED = 0.1
"""Part of a payload's weight by which the reading may be off [1]."""

LONGEST = 0.5
"""Centres of mass of tools are nearer to the sensor [m]."""


def others_ask(twists: Mapping[str, Array]) -> bool:
    """Return whether sources other than those of the sensor ask for motion; `twists` by source."""
    asked = sum((v for name, v in twists.items() if name not in WRENCH_SOURCES), np.zeros(6))
    return bool((np.abs(asked) > ASKED).any())


def reads_weight(left: Array, payload: Payload) -> bool:
    """Return whether a reading is a payload's weight, if (6,) is left of it without that [N, N·m].

    One that weighs little, or has its centre farther than a tool reaches, is not told from none.
    """
    weight, lever = -float(GRAVITY[2]) * payload.mass, float(np.linalg.norm(payload.com))
    if weight < 2.0 * UNKNOWN_LOAD.force or lever > LONGEST:
        return False
    force, moment = sizes(left)
    within = max(UNKNOWN_LOAD.moment, WEIGHED * weight * lever)
    return force <= max(UNKNOWN_LOAD.force, WEIGHED * weight) and moment <= within


class ForceTorqueMonitor:
    """Monitors the sensor of a cell; if it is `essential`, the arm does not move without it."""

    def __init__(self, events: Events, essential: bool, period_s: float) -> None:
        self._events = events
        self._essential = essential
        self._stale: str | None = None
        """The event that told why there is no reading; None while there is one."""
        self._unloaded: deque[Array] = deque(maxlen=round(TARE_S / period_s))
        self._stood: deque[Array] = deque(maxlen=round(TARE_S / period_s))
        """Where the joints were (n,), while nothing was asked of the arm."""

    def update(
        self, reading: UnitReading, weight: Array | None, twists: Mapping[str, Array]
    ) -> None:
        """Take in a reading; `weight` (6,) is what the payload alone makes the sensor read.

        `twists` are what each source asks for.
        """
        if reading.q is None or others_ask(twists):
            self._stood.clear()
        else:
            self._stood.append(reading.q)
        trouble, stale = reading.wrench_trouble, None
        if reading.wrench is None:
            saturated = trouble is not None and trouble.cause is Cause.SATURATED
            stale = "sensor_saturated" if saturated else "sensor_stale"
        if stale is None and self._stale is not None:
            self._events.info("sensor_fresh", NAME)
        elif stale == "sensor_stale" and self._stale != stale:
            self._events.warning(stale, NAME, age_s=reading.wrench_age_s)
        elif stale is not None and trouble is not None and self._stale != stale:
            self._events.warning(stale, f"{NAME}: {trouble.detail}", **trouble.values)
        self._stale = stale
        if reading.wrench is None:
            self._unloaded.clear()
        elif weight is not None:
            self._unloaded.append(reading.wrench - weight)

    @property
    def unloaded(self) -> Array | None:
        """The mean reading (6,) less the payload's weight [N, N·m]; None before there is one."""
        full = len(self._unloaded) == self._unloaded.maxlen
        return np.asarray(np.mean(self._unloaded, axis=0)) if full else None

    @property
    def still(self) -> bool:
        """True while the arm stands well enough for a tare."""
        if len(self._stood) < (self._stood.maxlen or 0):
            return False
        return bool((np.ptp(np.array(self._stood), axis=0) < STILL).all())

    @property
    def stale(self) -> tuple[str, ...]:
        """The sensor's name while it is stale."""
        return () if self._stale is None else (NAME,)

    @property
    def missed(self) -> tuple[str, ...]:
        """The sensor's name while it is stale and the arm may not move without it."""
        return self.stale if self._essential else ()
