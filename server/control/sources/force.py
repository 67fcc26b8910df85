"""Force control by accommodation (Williams 1997, section 2.5): twist = K_F (F_desired − F).

F is the wrench that the arm exerts on its environment, at and in the MRF, after the weight and
gravity moment of everything outboard of the sensor are taken off. With F_desired = 0 this is
force–moment accommodation (FMA): pressing on a wall, the arm backs off. Together with a stick it
turns a rate into a force by itself: F = K_HC u / K_F.
"""

from dataclasses import dataclass

import numpy as np

from ..frames import Array, Pose, cross, rotate_twist, wrench_to

GRAVITY = np.array([0.0, 0.0, -9.81])
"""Free-fall acceleration in World (3,) [m/s²]."""


@dataclass(frozen=True)
class ForceState:
    """Filtered contact wrench (6,) at and in the Sensor frame; None before the first sample."""

    wrench: Array | None = None


class Force:
    """Accommodates the measured wrench."""

    def __init__(
        self, T_wrist_sensor: Pose, payload_mass: float, payload_com: Array, smoothing: float
    ) -> None:
        self.T_wrist_sensor = T_wrist_sensor
        self._mass = payload_mass
        self._com = payload_com
        self._smoothing = smoothing

    def weight(self, R_world_sensor: Array) -> Array:
        """Return the reading (6,) of the payload's weight alone, Sensor axes, exerted sign.

        The payload hangs on the sensor, so the arm's side carries it: what the arm exerts to hold
        it up is minus its weight, and a sensor that only carries weight reads just that.
        """
        # Load on the sensor is m g; the exerted wrench is its negative.
        force = -self._mass * (R_world_sensor.T @ GRAVITY)
        return np.concatenate([force, cross(self._com, force)])

    def measure(
        self, state: ForceState, sample: Array | None, bias: Array, T_world_wrist: Pose
    ) -> ForceState:
        """Return the state after one sample (6,) at the measured Wrist pose; None when stale."""
        if sample is None:
            return ForceState()
        R_world_sensor = T_world_wrist.R @ self.T_wrist_sensor.R
        contact = sample - bias - self.weight(R_world_sensor)
        if state.wrench is None:
            return ForceState(contact)
        return ForceState(state.wrench + self._smoothing * (contact - state.wrench))

    def wrench_mrf(self, state: ForceState, T_wrist_mrf: Pose) -> Array | None:
        """Return the contact wrench (6,) at and in the MRF (eq. 5); None when stale."""
        if state.wrench is None:
            return None
        return wrench_to(T_wrist_mrf.inverse() @ self.T_wrist_sensor, state.wrench)

    def rate(
        self, wrench_mrf: Array | None, desired: Array, gain: Array, R_world_mrf: Array
    ) -> Array:
        """Return the twist (6,) in World axes; `gain` (6,) is K_F [m/s/N, rad/s/(N·m)]."""
        if wrench_mrf is None:
            return np.zeros(6)
        return rotate_twist(R_world_mrf, gain * (desired - wrench_mrf))
