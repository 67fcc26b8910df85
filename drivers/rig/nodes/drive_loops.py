"""The loops of all simulated drives, computed together once per physics step.

A loop interpolates linearly from setpoint to setpoint (CiA 402-2, 60C2h) in CSP, integrates the
speed asked for in CSV, and follows with `tau = K_p e + K_d (v_ref − dq) + ∫ K_i e + offset`: the
reference's own speed is fed forward, and the torque offset; the integral takes what is left of
gravity, and friction. In CST the motor gives the torque
asked for, less what would take the joint beyond its top speed. All vectors are (n,), in joint
terms, SI.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ....config.schema.mechanism.mechanism import DriveSection
from ....config.schema.rig.rig import RigDriveSection

Vector = NDArray[np.float64]

_SPEED_RESERVE = 1.2
"""A motor's top speed over the bound V that the cell keeps [1]."""
_SETTLED = 1e-9


class DriveLoops:
    """State of the loops. A loop that is not engaged gives no torque."""

    def __init__(
        self, arms: Sequence[tuple[Sequence[DriveSection], RigDriveSection]], dt: float
    ) -> None:
        """Take the drives of each arm with what the cell says of them, and a physics step [s]."""
        drives = [drive for of_arm, _ in arms for drive in of_arm]
        n = len(drives)
        self.dt = dt
        self._stiffness = _per_joint(arms, "stiffness")
        self._damping = _per_joint(arms, "damping")
        self._integral_step = _per_joint(arms, "integral") * dt
        self.max_torque = np.array([d.max_torque for d in drives])
        self.max_speed = np.array([d.max_velocity * _SPEED_RESERVE for d in drives])
        self.reference = np.zeros(n)
        """Demanded position [rad]."""
        self.speed = np.zeros(n)
        """Speed of the reference [rad/s]."""
        self.error = np.zeros(n)
        """Following error: reference minus position [rad]."""
        self.torque = np.zeros(n)
        """Torques of the motors [N·m]."""
        self.reported = np.zeros(n)
        """The same as the drives report it, low-passed [N·m]."""
        self._reporting = np.concatenate(
            [
                np.full(len(of_arm), 1.0 - math.exp(-dt / max(gains.torque_filter_s, 1e-9)))
                for of_arm, gains in arms
            ]
        )
        self.window = np.full(n, np.inf)
        """Following error that is too much [rad]."""
        self.steps_beyond = np.zeros(n, dtype=np.int64)
        """Physics steps in a row with a following error beyond the window [1]."""
        self.offset = np.zeros(n)
        """Torque that is fed forward [N·m]."""
        self._integral = np.zeros(n)
        self._engaged = np.zeros(n)
        self._looped = np.zeros(n)
        """1 for a joint that follows its reference, 0 for one without power or in CST."""
        self._pulled: dict[int, float] = {}
        """Torque asked for of each joint in CST [N·m]."""
        self._running: set[int] = set()
        """Joints in CSV."""
        self._steps_left = np.full(n, -1, dtype=np.int64)
        self._deceleration = np.zeros(n)

    def engage(self, joint: int, position: float, speed: float = 0.0) -> None:
        """Switch a joint's torque on: hold `position` [rad], starting at `speed` [rad/s]."""
        self.reference[joint], self.speed[joint] = position, speed
        self._integral[joint] = self._deceleration[joint] = 0.0
        self._steps_left[joint] = -1
        self._engaged[joint] = self._looped[joint] = 1.0
        self._pulled.pop(joint, None)
        self._running.discard(joint)

    def release(self, joint: int) -> None:
        """Switch a joint's torque off."""
        self.speed[joint] = self.torque[joint] = self.error[joint] = 0.0
        self.reported[joint] = 0.0
        self._integral[joint] = self._engaged[joint] = self._deceleration[joint] = 0.0
        self._looped[joint] = 0.0
        self._steps_left[joint] = -1
        self.steps_beyond[joint] = 0
        self._pulled.pop(joint, None)
        self._running.discard(joint)

    def aim(self, joint: int, position: float, period_s: float, *, streamed: bool = True) -> bool:
        """Move the reference to `position` [rad] within `period_s`.

        If nothing newer comes in a stream, the motion is continued for another period, as drives do
        over one lost setpoint, then the reference stands. Returns whether the motor's top speed cut
        it.
        """
        wanted = (position - self.reference[joint]) / period_s
        most = self.max_speed[joint]
        self.speed[joint] = min(max(wanted, -most), most)
        self._steps_left[joint] = (2 if streamed else 1) * round(period_s / self.dt)
        return bool(abs(wanted) > most)

    def run(self, joint: int, speed: float) -> bool:
        """Run at `speed` [rad/s] until told otherwise; return whether the top speed cut it."""
        most = self.max_speed[joint]
        self.speed[joint] = min(max(speed, -most), most)
        self._steps_left[joint] = -1
        self._running.add(joint)
        return bool(abs(speed) > most)

    def pull(self, joint: int, torque: float) -> bool:
        """Give `torque` [N·m] until told otherwise; return whether the motor's limit cut it."""
        most = float(self.max_torque[joint])
        self._pulled[joint] = min(max(torque, -most), most)
        self._looped[joint] = self.speed[joint] = 0.0
        return abs(torque) > most

    def take_over(self, joint: int, position: float, speed: float) -> None:
        """Let the loop of a joint in CST go on from where it is, with the torque that it gives."""
        self.reference[joint], self.speed[joint] = position, speed
        self._integral[joint] = self.torque[joint] - self.offset[joint]
        self._looped[joint] = 1.0
        self._pulled.pop(joint, None)

    def ramp_down(self, joint: int, deceleration: float) -> None:
        """Bring the reference to rest with a constant deceleration [rad/s²], whatever was aimed."""
        self._deceleration[joint] = deceleration
        self._steps_left[joint] = -1
        self._running.discard(joint)

    def resume_from(self, joint: int, position: float, speed: float) -> None:
        """Put the reference where the joint is; what the motor holds against goes on."""
        self.reference[joint], self.speed[joint] = position, speed

    @property
    def beyond(self) -> bool:
        """True while some joint's following error is beyond its window."""
        return bool(np.count_nonzero(self.steps_beyond))

    def at_rest(self, joint: int) -> bool:
        """Return whether a joint's reference stands."""
        return bool(abs(self.speed[joint]) < _SETTLED)

    def step(self, q: Vector, dq: Vector) -> Vector:
        """Advance by one physics step; return the torques (n,) [N·m]."""
        for joint in self._running:
            self._keep_near(joint, float(q[joint]))
        np.subtract(self.reference, q, out=self.error)
        self.error *= self._looped
        self._integral += self._integral_step * self.error
        wanted = self.speed - dq
        wanted *= self._damping
        wanted += self._stiffness * self.error
        wanted += self._integral
        wanted += self.offset
        torque = np.minimum(np.maximum(wanted, -self.max_torque), self.max_torque)
        # Anti-windup: what the motor cannot give is not wished for any longer.
        self._integral += (torque - wanted) * 0.05
        for joint, asked in self._pulled.items():
            torque[joint] = self._slowed(joint, asked, float(dq[joint]))
        np.multiply(torque, self._engaged, out=self.torque)
        self._integral *= self._looped
        self.reported += self._reporting * (self.torque - self.reported)
        self.steps_beyond += 1
        self.steps_beyond *= np.abs(self.error) > self.window
        self._move_reference()
        return self.torque

    def _keep_near(self, joint: int, q: float) -> None:
        """A speed loop does not run away from a joint that its motor cannot move."""
        most = self.max_torque[joint] / self._stiffness[joint]
        self.reference[joint] = min(max(self.reference[joint], q - most), q + most)

    def _slowed(self, joint: int, torque: float, dq: float) -> float:
        """Return what a motor in CST gives: less near its top speed, and a brake beyond it."""
        damping, most = self._damping[joint], self.max_speed[joint]
        torque = min(max(torque, damping * (-most - dq)), damping * (most - dq))
        return float(min(max(torque, -self.max_torque[joint]), self.max_torque[joint]))

    def _move_reference(self) -> None:
        if np.count_nonzero(self._deceleration):
            change = self._deceleration * self.dt
            slower = np.sign(self.speed) * np.maximum(np.abs(self.speed) - change, 0.0)
            self.speed = np.where(self._deceleration > 0, slower, self.speed)
        self.reference += self.speed * self.dt
        self._steps_left -= 1
        ended = self._steps_left == 0
        if np.count_nonzero(ended):
            self.speed[ended] = 0.0


def _per_joint(arms: Sequence[tuple[Sequence[DriveSection], RigDriveSection]], name: str) -> Vector:
    found: list[float] = []
    for drives, gains in arms:
        values, n = getattr(gains, name), len(drives)
        if len(values) not in (1, n):
            given = f"{len(values)} values for {n} joints"
            raise ValueError(f"[rig.drive] {name}: {given}; give 1 or {n}")
        found += values if len(values) == n else values * n
    return np.array(found, dtype=float)
