"""Contact wrench of one wrist's sensor, with the load in effect taken off."""

import math
from typing import NamedTuple

import numpy as np

from ..frame_tree import Moved
from ..spatial import GRAVITY, Array, Pose
from .contact_wrench import ContactWrench, WrenchState, load_of
from .payload import Payload

OVERSHOOT = 2.0
"""A tool may be accelerated by this times what it was told: drives overshoot [1]."""

LOAD_TIME_S = 0.15
"""Time constant with which a changed payload or bias takes effect [s]."""


class WristMemory(NamedTuple):
    """Memory of a wrist from tick to tick."""

    wrench: WrenchState = WrenchState()
    load: Array | None = None
    """Payload and bias in effect (10,), see `contact_wrench.load_of`."""


class SensorReading(NamedTuple):
    """One tick's reading of the sensor."""

    wrench: Array | None
    """Wrench that the arm exerts, at and in the Sensor frame (6,) [N, N·m]; None when stale."""
    age_s: float
    """How much older it is than the joints' sample [s]."""
    mean: tuple[Array, float] | None
    """The mean of a period's samples (6,) and its age [s]; None: the newest stands for all."""


class Wrist:
    """The force/torque sensor of one mechanism, and what hangs on it."""

    def __init__(self, contact: ContactWrench, payload: Payload, period_s: float) -> None:
        """Build it; `payload` is the cell's own, unless an operator says otherwise."""
        self.contact = contact
        self._payload = payload
        self._part = 1.0 - math.exp(-period_s / LOAD_TIME_S)
        # Scratch: payload, bias and both as a load, of the tick before.
        self._hung: tuple[Payload | None, Array | None, Array] = (None, None, np.zeros(10))

    def load(self, payload: Payload | None, bias: Array) -> Array:
        """Return a payload, None for the cell's own, and a bias (6,) as a load (10,)."""
        payload = payload or self._payload
        if payload is not self._hung[0] or bias is not self._hung[1]:
            self._hung = payload, bias, load_of(payload.mass, payload.com, bias)
        return self._hung[2]

    def measure(
        self,
        memory: WristMemory,
        sample: SensorReading,
        target: Array,
        T_world_wrist: Pose,
        time_s: float,
        moved: Moved | None,
        quickness: float,
        at_once: bool,
    ) -> WristMemory:
        """Return the memory with the newest wrench in it, payload and bias taken off.

        The load in effect goes to the `target` (10,) `at_once` or smoothly: a tool picked up or a
        tare never jumps. `T_world_wrist` is measured, at the instant that the joints were;
        `quickness` is the greatest acceleration that the tool was lately told [m/s²].
        """
        load = memory.load
        load = target if load is None or at_once else load + self._part * (target - load)
        place, free_fall = T_world_wrist, GRAVITY
        if moved is not None:
            # Seen from a Base that moves: its news is too rough to be differentiated twice.
            base = moved.T_world_base_measured
            place = base.inverse() @ T_world_wrist
            free_fall = base.R.T @ (GRAVITY - moved.acceleration_at(T_world_wrist.p))
        wrench = self.contact.measure(
            memory.wrench,
            sample.wrench,
            load,
            place,
            time_s,
            sample.age_s,
            free_fall,
            OVERSHOOT * quickness,
            sample.mean,
        )
        return WristMemory(wrench, load)

    def wrench_mrf(self, memory: WristMemory, T_wrist_mrf: Pose) -> Array | None:
        """Return what the arm exerts at and in the MRF (6,), None when stale."""
        return self.contact.wrench_mrf(memory.wrench, T_wrist_mrf)

    def hand_mrf(self, memory: WristMemory, T_wrist_mrf: Pose) -> Array | None:
        """Return the same of the mean readings, for what a payload's own force would upset."""
        return self.contact.hand_mrf(memory.wrench, T_wrist_mrf)

    def weight(
        self, T_world_mrf: Pose, T_wrist_mrf: Pose, payload: Payload | None, bias: Array
    ) -> Array:
        """Return the sensor reading (6,) of the payload's weight with the MRF at a pose."""
        T_world_wrist = T_world_mrf @ T_wrist_mrf.inverse()
        R_world_sensor = T_world_wrist.R @ self.contact.T_wrist_sensor.R
        return self.contact.weight(R_world_sensor, self.load(payload, bias))
