"""The position loops of all simulated drives, computed together once per physics step.

Each loop interpolates linearly from setpoint to setpoint (CiA 402-2, 60C2h) and follows with
`tau = K_p e + K_d (v_ref − dq) + ∫ K_i e`: the reference's own speed is fed forward, the integral
takes gravity and friction. All vectors are (n,), in joint terms, SI.
"""

import numpy as np
from numpy.typing import NDArray

from ...config.schema import Drive, RigDrive

Vector = NDArray[np.float64]

_SPEED_RESERVE = 1.2
"""A motor's top speed over the bound V that the cell keeps [1]."""
_SETTLED = 1e-9


class PositionLoop:
    """State of the loops. A loop that is not engaged gives no torque."""

    def __init__(self, drives: tuple[Drive, ...], gains: RigDrive, dt: float) -> None:
        n = len(drives)
        self.dt = dt
        self._stiffness = _per_joint("stiffness", gains.stiffness, n)
        self._damping = _per_joint("damping", gains.damping, n)
        self._integral_step = _per_joint("integral", gains.integral, n) * dt
        self.max_torque = np.array([d.max_torque for d in drives])
        self.max_speed = np.array([d.max_velocity * _SPEED_RESERVE for d in drives])
        self.reference = np.zeros(n)
        """Demanded position [rad]."""
        self.speed = np.zeros(n)
        """Speed of the reference [rad/s]."""
        self.error = np.zeros(n)
        """Following error: reference minus position [rad]."""
        self.torque = np.zeros(n)
        """What the motors give [N·m]."""
        self.window = np.full(n, np.inf)
        """Following error that is too much [rad]."""
        self.steps_beyond = np.zeros(n, dtype=np.int64)
        """Physics steps in a row with a following error beyond the window [1]."""
        self._integral = np.zeros(n)
        self._engaged = np.zeros(n)
        self._steps_left = np.full(n, -1, dtype=np.int64)
        self._deceleration = np.zeros(n)

    def engage(self, joint: int, position: float, speed: float = 0.0) -> None:
        """Switch a joint's torque on: hold `position` [rad], starting at `speed` [rad/s]."""
        self.reference[joint], self.speed[joint] = position, speed
        self._integral[joint] = self._deceleration[joint] = 0.0
        self._steps_left[joint] = -1
        self._engaged[joint] = 1.0

    def release(self, joint: int) -> None:
        """Switch a joint's torque off."""
        self.speed[joint] = self.torque[joint] = self.error[joint] = 0.0
        self._integral[joint] = self._engaged[joint] = self._deceleration[joint] = 0.0
        self._steps_left[joint] = -1
        self.steps_beyond[joint] = 0

    def aim(self, joint: int, position: float, period_s: float) -> bool:
        """Move the reference to `position` [rad] within `period_s`.

        If nothing newer comes, the motion is continued for another period, as drives do over one
        lost setpoint, then the reference stands. Returns whether the motor's top speed cut it.
        """
        wanted = (position - self.reference[joint]) / period_s
        most = self.max_speed[joint]
        self.speed[joint] = min(max(wanted, -most), most)
        self._steps_left[joint] = 2 * round(period_s / self.dt)
        return bool(abs(wanted) > most)

    def ramp_down(self, joint: int, deceleration: float) -> None:
        """Bring the reference to rest with a constant deceleration [rad/s²], whatever was aimed."""
        self._deceleration[joint] = deceleration
        self._steps_left[joint] = -1

    def resume_from(self, joint: int, position: float, speed: float) -> None:
        """Put the reference where the joint is; what the motor holds against goes on."""
        self.reference[joint], self.speed[joint] = position, speed

    def at_rest(self, joint: int) -> bool:
        """Return whether a joint's reference stands."""
        return bool(abs(self.speed[joint]) < _SETTLED)

    def step(self, q: Vector, dq: Vector) -> Vector:
        """Advance by one physics step; return the torques (n,) [N·m]."""
        np.subtract(self.reference, q, out=self.error)
        self.error *= self._engaged
        self._integral += self._integral_step * self.error
        wanted = self.speed - dq
        wanted *= self._damping
        wanted += self._stiffness * self.error
        wanted += self._integral
        torque = np.minimum(np.maximum(wanted, -self.max_torque), self.max_torque)
        # Anti-windup: what the motor cannot give is not wished for any longer.
        self._integral += (torque - wanted) * 0.05
        np.multiply(torque, self._engaged, out=self.torque)
        self._integral *= self._engaged
        self.steps_beyond += 1
        self.steps_beyond *= np.abs(self.error) > self.window
        self._move_reference()
        return self.torque

    def _move_reference(self) -> None:
        if self._deceleration.any():
            change = self._deceleration * self.dt
            slower = np.sign(self.speed) * np.maximum(np.abs(self.speed) - change, 0.0)
            self.speed = np.where(self._deceleration > 0, slower, self.speed)
        self.reference += self.speed * self.dt
        self._steps_left -= 1
        ended = self._steps_left == 0
        if ended.any():
            self.speed[ended] = 0.0


def _per_joint(name: str, values: tuple[float, ...], n: int) -> Vector:
    if len(values) not in (1, n):
        raise ValueError(f"[rig.drive] {name}: {len(values)} values for {n} joints; give 1 or {n}")
    return np.array(values if len(values) == n else values * n, dtype=float)
