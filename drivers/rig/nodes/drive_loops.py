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

from ....config.schema.mechanism import DriveSection
from ....config.schema.rig import RigDriveSection
from ....server.control.compiled import NUMBER, TABLE, VECTOR, compiled

Vector = NDArray[np.float64]

_SPEED_RESERVE = 1.2
"""A motor's top speed over the bound V that the cell keeps [1]."""
_SETTLED = 1e-9
_LEAKAGE = 0.05
"""Part of what the motor cannot give that an integral forgets in a step [1]."""


class DriveLoops:
    """State of the loops. A loop that is not engaged gives no torque."""

    def __init__(
        self, arms: Sequence[tuple[Sequence[DriveSection], RigDriveSection]], dt: float
    ) -> None:
        """Take the drives of each arm with what the cell says of them, and a physics step [s]."""
        drives = [drive for of_arm, _ in arms for drive in of_arm]
        n = len(drives)
        self.dt = dt
        # As `_step` takes them, a row of each: all are changed in place, and none is ever replaced.
        self._table = table = np.zeros((21, n))
        stiffness, damping, integral_step, reporting = table[:4]
        stiffness[:] = _per_joint(arms, "stiffness")
        damping[:] = _per_joint(arms, "damping")
        integral_step[:] = _per_joint(arms, "integral") * dt
        reporting[:] = np.concatenate(
            [
                np.full(len(of_arm), 1.0 - math.exp(-dt / max(gains.torque_filter_s, 1e-9)))
                for of_arm, gains in arms
            ]
        )
        self.max_torque, self.max_speed, self.window = table[4:7]
        """`window` is the following error that is too much [rad]."""
        self.max_torque[:] = [d.max_torque for d in drives]
        self.max_speed[:] = [d.max_velocity * _SPEED_RESERVE for d in drives]
        self.window[:] = np.inf
        self.offset, self._pulled, self._deceleration, self._engaged, self._looped = table[7:12]
        """`offset` is fed forward, `pulled` asked for in CST [N·m]: not a number in another mode;
        `looped` is 1 for a joint that follows its reference, 0 for one without power or in CST."""
        self._pulled[:] = np.nan
        self.reference, self.speed, self.error, self._integral, self.torque, self.reported = table[
            12:18
        ]
        """Demanded position and its speed, the following error, which is the reference minus the
        position [rad]; torques of the motors, and as the drives report them, low-passed [N·m]."""
        self._running, self._steps_left, self.steps_beyond = table[18:]
        """1 for a joint in CSV; physics steps of its aim that are left; steps in a row with a
        following error beyond the window [1]."""
        self._steps_left[:] = -1
        self.beyond = False
        """True while some joint's following error is beyond its window."""

    def engage(self, joint: int, position: float, speed: float = 0.0) -> None:
        """Switch a joint's torque on: hold `position` [rad], starting at `speed` [rad/s]."""
        self.reference[joint], self.speed[joint] = position, speed
        self._integral[joint] = self._deceleration[joint] = 0.0
        self._steps_left[joint] = -1
        self._engaged[joint] = self._looped[joint] = 1.0
        self._pulled[joint], self._running[joint] = np.nan, 0

    def release(self, joint: int) -> None:
        """Switch a joint's torque off."""
        self.speed[joint] = self.torque[joint] = self.error[joint] = 0.0
        self.reported[joint] = 0.0
        self._integral[joint] = self._engaged[joint] = self._deceleration[joint] = 0.0
        self._looped[joint] = 0.0
        self._steps_left[joint] = -1
        self.steps_beyond[joint] = 0
        self._pulled[joint], self._running[joint] = np.nan, 0

    def aim(self, joint: int, position: float, period_s: float, *, streamed: bool = True) -> bool:
        """Move the reference to `position` [rad] within `period_s`.

        If nothing newer comes in a stream, the motion is continued for another period, as drives do
        over one lost setpoint, then the reference stands. Returns whether the motor's top speed cut
        it.
        """
        wanted: float = (position - self.reference.item(joint)) / period_s
        most: float = self.max_speed.item(joint)
        self.speed[joint] = min(max(wanted, -most), most)
        self._steps_left[joint] = (2 if streamed else 1) * round(period_s / self.dt)
        return abs(wanted) > most

    def run(self, joint: int, speed: float) -> bool:
        """Run at `speed` [rad/s] until told otherwise; return whether the top speed cut it."""
        most = float(self.max_speed[joint])
        self.speed[joint] = min(max(speed, -most), most)
        self._steps_left[joint] = -1
        self._running[joint] = 1
        return abs(speed) > most

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
        self._pulled[joint] = np.nan

    def ramp_down(self, joint: int, deceleration: float) -> None:
        """Bring the reference to rest with a constant deceleration [rad/s²], whatever was aimed."""
        self._deceleration[joint] = deceleration
        self._steps_left[joint] = -1
        self._running[joint] = 0

    def resume_from(self, joint: int, position: float, speed: float) -> None:
        """Put the reference where the joint is; what the motor holds against goes on."""
        self.reference[joint], self.speed[joint] = position, speed

    def at_rest(self, joint: int) -> bool:
        """Return whether a joint's reference stands."""
        return bool(abs(self.speed.item(joint)) < _SETTLED)

    def step(self, q: Vector, dq: Vector) -> Vector:
        """Advance by one physics step; return the torques (n,) [N·m]."""
        self.beyond = _step(q, dq, self.dt, self._table)
        torque: Vector = self.torque
        return torque


@compiled(VECTOR, VECTOR, NUMBER, TABLE)
def _step(q: Vector, dq: Vector, dt: float, table: Vector) -> bool:
    """Advance all loops by one physics step; the rows are those of `DriveLoops`.

    Returns whether some joint's following error is beyond its window.
    """
    beyond = False
    stiffness, damping, integral_step, reporting = table[0], table[1], table[2], table[3]
    max_torque, max_speed, window = table[4], table[5], table[6]
    offset, pulled, deceleration = table[7], table[8], table[9]
    engaged, looped = table[10], table[11]
    reference, speed, error, integral = table[12], table[13], table[14], table[15]
    torque, reported = table[16], table[17]
    running, steps_left, steps_beyond = table[18], table[19], table[20]
    for i in range(len(q)):
        most, fastest = max_torque[i], max_speed[i]
        if running[i] != 0.0:
            # A speed loop does not run away from a joint that its motor cannot move.
            reach = most / stiffness[i]
            reference[i] = min(max(reference[i], q[i] - reach), q[i] + reach)
        error[i] = (reference[i] - q[i]) * looped[i]
        integral[i] += integral_step[i] * error[i]
        wanted = (speed[i] - dq[i]) * damping[i]
        wanted = wanted + stiffness[i] * error[i] + integral[i] + offset[i]
        given = min(max(wanted, -most), most)
        # Anti-windup: what the motor cannot give is not wished for any longer.
        integral[i] = (integral[i] + (given - wanted) * _LEAKAGE) * looped[i]
        if not math.isnan(pulled[i]):  # in CST: less near the motor's top speed, a brake beyond it
            low, high = damping[i] * (-fastest - dq[i]), damping[i] * (fastest - dq[i])
            given = min(max(min(max(pulled[i], low), high), -most), most)
        torque[i] = given * engaged[i]
        reported[i] += reporting[i] * (torque[i] - reported[i])
        steps_beyond[i] = steps_beyond[i] + 1.0 if abs(error[i]) > window[i] else 0.0
        beyond = beyond or steps_beyond[i] > 0.0
        if deceleration[i] > 0.0:
            slower = max(abs(speed[i]) - deceleration[i] * dt, 0.0)
            speed[i] = math.copysign(slower, speed[i])
        reference[i] += speed[i] * dt
        steps_left[i] -= 1.0
        if steps_left[i] == 0.0:
            speed[i] = 0.0
    return beyond


def _per_joint(arms: Sequence[tuple[Sequence[DriveSection], RigDriveSection]], name: str) -> Vector:
    found: list[float] = []
    for drives, gains in arms:
        values, n = getattr(gains, name), len(drives)
        if len(values) not in (1, n):
            given = f"{len(values)} values for {n} joints"
            raise ValueError(f"[rig.drive] {name}: {given}; give 1 or {n}")
        found += values if len(values) == n else values * n
    return np.array(found, dtype=float)
