"""Following a hand: the tool moves as a damped mass would under the force on it."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from ....config.schema.sources import FollowingSection
from ..compiled import MATRIX, NUMBER, VECTOR, compiled, inner_kernel
from ..spatial import (
    NO_TWIST,
    Array,
    Pose,
    largest,
    moved_near,
    pose_error,
    right_jacobian,
    slowed_at,
)
from .source import Context, Granted, Redefined, Shaping, Source

STANDING = 1e-6
"""A reference that is slower than this, and has no force to come, is at rest [m/s, rad/s]."""

STAYS_S = 3.0
"""A hand does not hold the same force for so long [s]."""

SLACK = (0.02, 0.1)
"""The reference is at most this far from the command [m, rad]: an arm that cannot follow does not
catch up afterwards with all that it missed."""


@dataclass(frozen=True)
class Impedance:
    """Mass and damping that the tool shows, per axis (6,)."""

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
    payload_smoothing_s: float = 0.0
    """Time constant of the force for a payload of the mass M_e, and of the moment likewise [s]."""


class FollowingState(NamedTuple):
    """The reference; without a pose it is wherever the command is, at rest."""

    twist: Array = NO_TWIST
    """Its velocity in World axes (6,)."""
    T_world_reference: Pose | None = None
    step: Array = NO_TWIST
    """Motion in this tick (6,) [m, rad]."""
    asked: Array = NO_TWIST
    """The rate that was asked for in this tick (6,)."""
    felt: Array | None = None
    """The low-passed wrench on the arm at the MRF, in World axes (6,); None before there is one."""


_IDLE: Final = FollowingState()


class Following(Source[FollowingState]):
    """Follows the wrench of a hand on the arm."""

    def __init__(self, section: FollowingSection, shaping: Shaping) -> None:
        self._impedance = impedance(section)
        self._most, self._period_s = shaping.most, shaping.period_s

    def idle(self) -> FollowingState:
        """Return the state of a tool that nobody leads."""
        return _IDLE

    def rate(
        self, context: Context, state: FollowingState, gain: Array
    ) -> tuple[Array, FollowingState]:
        """Return the twist of a damped mass under the hand's force.

        `gain` (6,) is the share of the force that is followed, in MRF axes. A stale force is none:
        the motion then dies out with M/B. An avoidance that takes precedence leaves `1 − α` of it
        (eq. 10).
        """
        if not context.guided:
            state, gain = _IDLE, NO_TWIST
        strength = min(1.0, largest(gain))
        if strength <= 0.0 and largest(state.twist) < STANDING:
            return NO_TWIST, _IDLE
        T_world_mrf, felt = context.k.T_world_mrf, None
        wrench_on_arm = None if context.hand is None else -context.hand
        if wrench_on_arm is not None:
            wrench_on_arm, felt = _calmed(
                wrench_on_arm, T_world_mrf.R, state.felt, *self._shares(context.load)
            )
        untold = context.inputs.settings.untold
        untold = NO_TWIST if untold is None else _turned(-untold, T_world_mrf.R.T)
        i, T = self._impedance, state.T_world_reference or T_world_mrf
        # What is switched off lets go of its reference as its gain fades.
        twist, step, asked = _led(
            state.twist, NO_TWIST if wrench_on_arm is None else wrench_on_arm, untold, gain,
            T_world_mrf.R, pose_error(T, T_world_mrf), i.mass, i.damping, *i.deadband, *i.most,
            1.0 - context.precedence, strength * i.stiffness, self._period_s,
        )  # fmt: skip
        return asked, FollowingState(twist, T, step, asked, felt)

    def carry(
        self, state: FollowingState, context: Context, redefined: Redefined
    ) -> FollowingState:
        """Return the state with the reference told at the MRF of now."""
        if redefined.lever is None:
            return state
        T = state.T_world_reference
        if T is not None:
            T = T @ (redefined.before.T_wrist_mrf.inverse() @ context.T_wrist_mrf)
            T = moved_near(T, np.zeros(6), context.k.T_world_mrf, SLACK)
        twist = slowed_at(state.twist, redefined.lever, self._most)
        return state._replace(T_world_reference=T, twist=twist)

    def advance(self, state: FollowingState, granted: Granted) -> FollowingState:
        """Return the state with the reference moved on by what was let through."""
        if state.T_world_reference is None:
            return state
        step = granted.share * (state.step + self._period_s * (granted.twist - state.asked))
        if step[3:].any():
            # As all points of one rigid body move, so that it does not matter which is the MRF.
            step[:3] = right_jacobian(-step[3:]) @ step[:3]
        reference = moved_near(state.T_world_reference, step, granted.T_world_mrf, SLACK)
        return state._replace(T_world_reference=reference)

    def _shares(self, load: Array | None) -> tuple[float, float]:
        """Return the share of a new force and of a new moment that is taken over, 0 to 1."""
        if load is None:
            return 1.0, 1.0
        i, m = self._impedance, float(load[0])
        about = float(load[1:4] @ load[1:4]) / m if m > 0.0 else 0.0
        return (
            self._share(smoothing_s(i.payload_smoothing_s, m, float(i.mass[0]))),
            self._share(smoothing_s(i.payload_smoothing_s, about, float(i.mass[3]))),
        )

    def _share(self, time_s: float) -> float:
        return 1.0 if time_s <= 0.0 else -math.expm1(-self._period_s / time_s)


def impedance(section: FollowingSection) -> Impedance:
    """Return the impedance that a cell's section describes."""
    f = section
    return Impedance(
        mass=np.array([f.mass] * 3 + [f.inertia] * 3),
        damping=np.array([f.damping] * 3 + [f.angular_damping] * 3),
        stiffness=f.stiffness,
        deadband=(f.deadband, f.moment_deadband),
        most=(f.max_force, f.max_moment),
        payload_smoothing_s=f.payload_smoothing_s,
    )


def smoothing_s(per_mass_s: float, payload: float, mass: float) -> float:
    """Return the time constant [s] of the force under a payload, both masses in one unit."""
    return per_mass_s * payload / mass


def _calmed(
    wrench: Array, R: Array, before: Array | None, force: float, moment: float
) -> tuple[Array, Array]:
    """Return the low-passed wrench (6,) in MRF axes, and in World's, where R (3, 3) leads."""
    if before is None or (force >= 1.0 and moment >= 1.0):
        return wrench, _turned(wrench, R)
    felt = _blended(wrench, R, before, force, moment)
    return _turned(felt, R.T), felt


@compiled(VECTOR, MATRIX)
def _turned(wrench: Array, R: Array) -> Array:
    out = np.zeros(6)
    for i in range(3):
        for k in range(3):
            out[i] += R[i, k] * wrench[k]
            out[3 + i] += R[i, k] * wrench[3 + k]
    return out


@compiled(VECTOR, MATRIX, VECTOR, NUMBER, NUMBER)
def _blended(wrench: Array, R: Array, before: Array, force: float, moment: float) -> Array:
    new = _turned(wrench, R)
    for i in range(3):
        new[i] = before[i] + force * (new[i] - before[i])
        new[3 + i] = before[3 + i] + moment * (new[3 + i] - before[3 + i])
    return new


@inner_kernel
def _felt(
    wrench: Array, untold: Array,
    dead_force: float, dead_moment: float, most_force: float, most_moment: float,
) -> Array:  # fmt: skip
    """Return the wrench (6,) without what is noise, and bounded; its direction stays.

    What differs from the `untold` one (6,) by noise is noise, too.
    """
    out = np.empty(6)
    for first, dead, most in ((0, dead_force, most_force), (3, dead_moment, most_moment)):
        size2, off2 = 0.0, 0.0
        for i in range(first, first + 3):
            size2 += wrench[i] ** 2
            off2 += (wrench[i] - untold[i]) ** 2
        size = max(math.sqrt(size2), 1e-12)
        off = min(size, math.sqrt(off2))
        beyond = 1.0 if dead <= 0.0 else min(1.0, max(0.0, off / dead - 1.0))
        smooth = beyond * beyond * (3.0 - 2.0 * beyond)
        for i in range(first, first + 3):
            out[i] = wrench[i] * (smooth * min(1.0, most / size))
    return out


@compiled(
    VECTOR, VECTOR, VECTOR, VECTOR, MATRIX, VECTOR, VECTOR, VECTOR,
    NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER,
)  # fmt: skip
def _led(
    twist: Array, wrench: Array, untold: Array, gain: Array, R: Array, error: Array,
    mass: Array, damping: Array,
    dead_force: float, dead_moment: float, most_force: float, most_moment: float,
    share: float, stiffness: float, period_s: float,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Return velocity and path of a damped mass after one period, and the rate to ask for; (6,).

    The mass moves with `twist` (6,) in World, where R (3, 3) leads from the axes of `wrench` (6,),
    of one that is nobody's, `untold` (6,), and `gain` (6,). `error` (6,) is the way from the
    command to the reference.
    """
    felt = _felt(wrench, untold, dead_force, dead_moment, most_force, most_moment)
    after, path, asked = np.empty(6), np.empty(6), np.empty(6)
    T = period_s
    for i in range(6):
        first, row = (0, i) if i < 3 else (3, i - 3)
        F = 0.0
        for k in range(3):
            F += R[row, k] * (share * gain[first + k] * felt[first + k])
        M, B, v = mass[i], damping[i], twist[i]
        a1 = (F - B * v) / M
        v2 = v + 0.5 * T * a1
        a2 = (F - B * v2) / M
        v3 = v + 0.5 * T * a2
        a3 = (F - B * v3) / M
        v4 = v + T * a3
        a4 = (F - B * v4) / M
        after[i] = v + T / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        path[i] = T / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        asked[i] = after[i] + stiffness * error[i]
    return after, path, asked
