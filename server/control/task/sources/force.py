"""Force control by accommodation (Williams 1997, section 2.5): twist = K_F (F_desired − F).

F is the wrench that the arm exerts on its environment, at and in the MRF. With F_desired = 0 this
is force–moment accommodation (FMA): pressing on a wall, the arm backs off. Together with a stick it
turns a rate into a force by itself: F = K_HC u / K_F. In HOLD it goes on alone, inside a small
leash, until contact is bled off.
"""

from typing import ClassVar, Final, NamedTuple

import numpy as np

from .....config.schema.sources.force import ForceSection
from ...compiled import MATRIX, ROW, VECTOR, compiled
from ...rigid_body import rotate_twist, twist_at, wrench_to
from ...spatial import Array
from ..bleed import bleed, relief
from ..source import NO_TWIST, Context, Redefined, Shaping, Source


class ForceState(NamedTuple):
    """Contact being bled off in HOLD."""

    hold: Array | None = None
    """Where the Wrist was in Base when HOLD began (3,) [m]; None outside of HOLD."""
    bleeding: bool = False


_FREE: Final = ForceState()


class Force(Source[ForceState]):
    """Accommodates the contact wrench."""

    ORDERS: ClassVar[bool] = False

    def __init__(self, section: ForceSection, shaping: Shaping) -> None:
        self._threshold, self._leash = section.hold_threshold, section.hold_leash

    def idle(self) -> ForceState:
        """Return the state of an arm that is not held."""
        return _FREE

    def rate(self, context: Context, state: ForceState, gain: Array) -> tuple[Array, ForceState]:
        """Return K_F (desired − wrench); `gain` (6,) is K_F [m/s/N, rad/s/(N·m)], MRF axes."""
        if not (context.moving or context.holding):
            return NO_TWIST, _FREE
        if context.moving and not context.guided:
            return self._beside_joints(context, gain), _FREE
        twist = accommodation(context.wrench, desired_at_mrf(context), gain, context.T_world_mrf.R)
        return (twist, _FREE) if context.moving else self._bled(context, state, twist)

    def jump(
        self, context: Context, redefined: Redefined, state: ForceState, gain: Array, twist: Array
    ) -> Array | None:
        """Return the rate about the MRF of before, told at that of now, less the rate of now."""
        if redefined.lever is None:
            return None
        before = redefined.before.T_wrist_mrf
        desired = wrench_to(before.inverse() @ context.T_wrist_mrf, desired_at_mrf(context))
        R_world_before = context.T_world_wrist.R @ before.R
        was = accommodation(context.wrench_at(before), desired, gain, R_world_before)
        return twist_at(was, redefined.lever) - twist

    def _beside_joints(self, context: Context, gain: Array) -> Array:
        """Return the twist (6,) beside a jog or a posture: contact is given way to."""
        none = np.zeros(6)
        asked = accommodation(context.wrench, none, gain, context.T_world_mrf.R)
        twist = relief(context.wrench, asked, self._threshold)
        return NO_TWIST if twist is None else twist

    def _bled(self, context: Context, state: ForceState, twist: Array) -> tuple[Array, ForceState]:
        """Return the twist of accommodation as far as it bleeds off contact in HOLD."""
        at = context.T_world_wrist.p
        base = None if context.moved is None else context.moved.base.T
        if base is not None:
            at = base.R.T @ (at - base.p)
        hold = state.hold if state.hold is not None else at
        away = at - hold if base is None else base.R @ (at - hold)
        bled = bleed(state.bleeding, context.wrench, twist, away, self._threshold, self._leash)
        return bled.twist, ForceState(hold, bled.bleeding)


def desired_at_mrf(context: Context) -> Array:
    """Return the wrench to exert (6,), at the MRF and in its axes."""
    asked = context.asked
    return desired_wrench(asked.wrench_desired, asked.R_world_wrench, context.T_world_mrf.R)


def desired_wrench(wrench: Array, R_world_wrench: Array | None, R_world_mrf: Array) -> Array:
    """Return a wrench to exert (6,) in the axes of the MRF; those it has at first, if not None."""
    if R_world_wrench is None:
        return wrench
    return rotate_twist(R_world_mrf.T @ R_world_wrench, wrench)


def accommodation(wrench: Array | None, desired: Array, gain: Array, R_world_mrf: Array) -> Array:
    """Return the twist (6,) in World axes for wrenches (6,) in MRF axes; zero for a stale one."""
    if wrench is None:
        return NO_TWIST
    out = np.empty(6)
    _accommodate(R_world_mrf, gain, desired, wrench, out)
    return out


@compiled(MATRIX, VECTOR, VECTOR, VECTOR, ROW)
def _accommodate(R: Array, gain: Array, desired: Array, wrench: Array, out: Array) -> None:
    for part in (0, 3):
        x = gain[part] * (desired[part] - wrench[part])
        y = gain[part + 1] * (desired[part + 1] - wrench[part + 1])
        z = gain[part + 2] * (desired[part + 2] - wrench[part + 2])
        for i in range(3):
            out[part + i] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z
