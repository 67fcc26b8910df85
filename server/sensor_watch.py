"""Watches the force/torque sensor: tells when it falls silent, and averages it for a tare."""

from collections import deque

import numpy as np

from .control.frames import Array
from .events import Events
from .plant import PlantReading

TARE_S = 0.3
"""A tare averages the sensor over this time [s]."""

NAME = "force_torque"


class SensorWatch:
    """One cell's sensor; `essential` means that the arm does not move without it."""

    def __init__(self, events: Events, essential: bool, period_s: float) -> None:
        self._events = events
        self._essential = essential
        self._stale = False
        self._unloaded: deque[Array] = deque(maxlen=round(TARE_S / period_s))

    def look(self, reading: PlantReading, weight: Array | None) -> None:
        """Take in a reading; `weight` (6,) is what the payload alone makes the sensor read."""
        stale = reading.wrench is None
        if stale and not self._stale:
            self._events.warning("sensor_stale", NAME, age_s=reading.wrench_age_s)
        elif self._stale and not stale:
            self._events.info("sensor_fresh", NAME)
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
    def missed(self) -> tuple[str, ...]:
        """The sensor's name while it is stale and the arm may not move without it."""
        return (NAME,) if self._essential and self._stale else ()
