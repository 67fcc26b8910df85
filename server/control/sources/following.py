"""Following a hand: the tool moves as a damped mass would under the force on it.

The reference obeys `M ẍ + B ẋ = F` (Hamaguchi, Taniguchi, eq. 4), integrated by Runge–Kutta of
fourth order; the command follows it at the rate `ẋ + K (x − x_command)`. The reference is carried
along by what the other sources ask, so that their rates add to the hand's and nobody is fought.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from ..evolve import evolve
from ..frames import Array, Pose, pose_error, rotate_twist, rotation_exp

STANDING = 1e-6
"""A reference that is slower than this, and has no force to come, is at rest [m/s, rad/s]."""

SLACK = (0.02, 0.1)
"""The reference is at most this far from the command [m, rad]: an arm that cannot follow does not
catch up afterwards with all that it missed."""


@dataclass(frozen=True)
class Impedance:
    """What the tool feels like, per axis (6,)."""

    mass: Array
    """M_e [kg, kg·m²]."""
    damping: Array
    """B_e [N·s/m, N·m·s/rad]."""
    stiffness: float
    """Error of the command to rate [1/s]."""
    deadband: tuple[float, float]
    """Force [N] and moment [N·m] that are noise."""
    most: tuple[float, float]
    """Force [N] and moment [N·m] beyond which more makes no difference."""


@dataclass(frozen=True)
class FollowingState:
    """The reference; without a pose it is wherever the command is, at rest."""

    twist: Array = field(default_factory=lambda: np.zeros(6))
    """Its velocity in World axes (6,)."""
    T_world_reference: Pose | None = None
    step: Array = field(default_factory=lambda: np.zeros(6))
    """What it moves by in this tick (6,) [m, rad]."""
    asked: Array = field(default_factory=lambda: np.zeros(6))
    """The rate that was asked for in this tick (6,)."""


class Following:
    """Follows the wrench on the arm."""

    def __init__(self, impedance: Impedance, period_s: float) -> None:
        self._impedance = impedance
        self._period_s = period_s

    def rate(
        self,
        state: FollowingState,
        wrench_on_arm: Array | None,
        gain: Array,
        T_world_mrf: Pose,
        share: float = 1.0,
    ) -> tuple[Array, FollowingState]:
        """Return the twist (6,) of the MRF in World axes, and the next state.

        `wrench_on_arm` (6,) is what pushes the arm, at and in the MRF, None when stale: the motion
        then dies out with M/B. `gain` (6,) is the share of it that is followed, in MRF axes;
        `share` scales all of it, for an avoidance that takes precedence (eq. 10: 1 − α).
        """
        strength = min(1.0, float(gain.max()))
        if strength <= 0.0 and float(np.abs(state.twist).max()) < STANDING:
            return np.zeros(6), FollowingState()
        wrench = np.zeros(6)
        if wrench_on_arm is not None:
            felt = share * gain * self._felt(wrench_on_arm)
            wrench = rotate_twist(T_world_mrf.R, felt)
        twist, step = self._integrate(state.twist, wrench)
        T = state.T_world_reference or T_world_mrf
        error = pose_error(T, T_world_mrf)
        # What is switched off lets go of its reference as its gain fades.
        asked = twist + strength * self._impedance.stiffness * error
        return asked, FollowingState(twist, T, step, asked)

    def advance(
        self, state: FollowingState, twist: Array, granted: float, T_world_mrf: Pose
    ) -> FollowingState:
        """Return the state after a tick that asked for `twist` (6,) in all.

        `granted` (0 to 1) is the share of it that was let through, `T_world_mrf` the pose that the
        command now has.
        """
        if state.T_world_reference is None:
            return state
        others = twist - state.asked
        step = granted * (state.step + self._period_s * others)
        reference = state.T_world_reference
        reference = Pose(rotation_exp(step[3:]) @ reference.R, reference.p + step[:3])
        away = pose_error(reference, T_world_mrf)
        far, turned = _size(away[:3]) / SLACK[0], _size(away[3:]) / SLACK[1]
        if far > 1.0 or turned > 1.0:
            p = T_world_mrf.p + away[:3] / max(1.0, far)
            R = rotation_exp(away[3:] / max(1.0, turned)) @ T_world_mrf.R
            reference = Pose(R, p)
        return evolve(state, T_world_reference=reference)

    def _felt(self, wrench: Array) -> Array:
        """Return the wrench (6,) without noise, and bounded; its direction stays."""
        out = np.empty(6)
        for i, part in enumerate((wrench[:3], wrench[3:])):
            size = max(_size(part), 1e-12)
            dead, most = self._impedance.deadband[i], self._impedance.most[i]
            beyond = 1.0 if dead <= 0.0 else min(1.0, max(0.0, size / dead - 1.0))
            smooth = beyond * beyond * (3.0 - 2.0 * beyond)
            out[3 * i : 3 * i + 3] = part * (smooth * min(1.0, most / size))
        return out

    def _integrate(self, v: Array, wrench: Array) -> tuple[Array, Array]:
        """Return velocity (6,) and path (6,) after one period, by Runge–Kutta of fourth order."""
        T, M, B = self._period_s, self._impedance.mass, self._impedance.damping
        a1 = (wrench - B * v) / M
        v2 = v + 0.5 * T * a1
        a2 = (wrench - B * v2) / M
        v3 = v + 0.5 * T * a2
        a3 = (wrench - B * v3) / M
        v4 = v + T * a3
        a4 = (wrench - B * v4) / M
        path = T / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        return v + T / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4), path


def _size(a: Array) -> float:
    return math.sqrt(float(a @ a))
