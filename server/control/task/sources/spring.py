"""A virtual fixture: the tool is pulled to a line or a plane (Rosenberg 1993; Abbott 2007).

The way from the MRF to the nearest point of the fixture, less a deadband, times a gain, is the
rate: along the line or in the plane, the tool is free. An axis of the tool may be turned into the
line's direction, or into the plane's normal, by the shortest arc. As every source, it adds to the
others: a stick of u against it stands off by u / K_S.

It is shaped in acceleration and jerk, at a point of the tool that stays the same, so that neither
a new MRF nor a frame that jumps makes the tool jump.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from .....config.schema.sources.spring import SpringSection
from ...compiled import FLAG, MATRIX, NUMBER, VECTOR, compiled
from ...rigid_body import twist_at
from ...spatial import Array, Pose
from ...stop.motion import Motion
from ...stop.trajectory import VelocityPlanner
from ..source import NO_TWIST, Context, Shaping, Source

_WORLD = Pose.identity()


class SpringState(NamedTuple):
    """The shaped twist of a point of the tool in World axes, as a motion of six freedoms."""

    motion: Motion


_IDLE: Final = SpringState(Motion(NO_TWIST, NO_TWIST, NO_TWIST))


class Spring(Source[SpringState]):
    """Pulls the tool to a line or a plane."""

    def __init__(self, section: SpringSection, shaping: Shaping) -> None:
        self._plane, self._relative_to = section.shape == "plane", section.relative_to
        self._point, self._direction = np.array(section.point), _unit(section.direction)
        self._axis = None if section.tool_axis is None else _unit(section.tool_axis)
        self._deadband = (section.deadband, section.angular_deadband)
        self._most = (section.speed, section.angular_speed)
        self._planner = VelocityPlanner(shaping.acceleration, shaping.jerk)
        self._period_s = shaping.period_s

    def idle(self) -> SpringState:
        """Return the state of a fixture that does not pull."""
        return _IDLE

    def rate(self, context: Context, state: SpringState, gain: Array) -> tuple[Array, SpringState]:
        """Return the twist that leads to the fixture; `gain` (6,) is K_S [1/s], in its frame."""
        target, pulls = NO_TWIST, context.guided and np.count_nonzero(gain) > 0
        if not context.moving:
            state = _IDLE
        if state is _IDLE and not pulls:
            return NO_TWIST, _IDLE
        if pulls:
            target = twist_at(self._pull(context, gain), context.lever)
        shaped = self._planner.shape(state.motion, target, self._period_s)
        if shaped is state.motion:
            return NO_TWIST, _IDLE
        return twist_at(shaped.dq, -context.lever), SpringState(shaped)

    def _pull(self, context: Context, gain: Array) -> Array:
        """Return the twist (6,) of the MRF that is asked for, before shaping."""
        body = None if context.moved is None else context.moved.body(self._relative_to)
        frame = _WORLD if body is None else body.T
        R, mrf, factor = frame.R, context.T_world_mrf, context.asked.speed_factor
        turn = np.zeros(3)
        if self._axis is not None:
            turn = _arc(R.T @ (mrf.R @ self._axis), self._direction)
        way = _way(R.T @ (mrf.p - frame.p), self._point, self._direction, self._plane)
        v = _pulled(R, way, gain[:3], self._deadband[0], factor * self._most[0])
        w = _pulled(R, turn, gain[3:], self._deadband[1], factor * self._most[1])
        return np.concatenate([v, w])


def _unit(axis: tuple[float, float, float]) -> Array:
    return np.array(axis) / math.hypot(*axis)


@compiled(VECTOR, VECTOR, VECTOR, FLAG)
def _way(p: Array, point: Array, direction: Array, plane: bool) -> Array:
    """Return the way (3,) from p (3,) to the nearest point of a plane, or of a line."""
    along, out = 0.0, np.empty(3)
    for i in range(3):
        along += (point[i] - p[i]) * direction[i]
    for i in range(3):
        normal = along * direction[i]
        out[i] = normal if plane else point[i] - p[i] - normal
    return out


@compiled(VECTOR, VECTOR)
def _arc(a: Array, b: Array) -> Array:
    """Return the shortest rotation vector (3,) that turns a unit vector a (3,) into b (3,)."""
    out, cosine, sine = np.empty(3), 0.0, 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = a[j] * b[k] - a[k] * b[j]
        sine += out[i] ** 2
        cosine += a[i] * b[i]
    sine = math.sqrt(sine)
    angle = math.atan2(sine, cosine)
    if sine < 1e-9 and cosine < 0.0:
        # Opposite: any axis across will do, and the same one every time.
        least = 0
        for i in range(1, 3):
            if abs(a[i]) < abs(a[least]):
                least = i
        size2 = 1.0 - a[least] ** 2
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            out[i] = (a[j] * (k == least) - a[k] * (j == least)) / math.sqrt(size2)
        sine = 1.0
    for i in range(3):
        out[i] *= angle / max(sine, 1e-9)
    return out


@compiled(MATRIX, VECTOR, VECTOR, NUMBER, NUMBER)
def _pulled(R: Array, error: Array, gain: Array, deadband: float, most: float) -> Array:
    """Return the rate (3,) in World axes, at most `most`, for an error (3,) in the frame R (3, 3).

    `gain` (3,) [1/s] acts along the frame's axes on what is beyond the deadband.
    """
    size2 = rate2 = 0.0
    rate, out = np.empty(3), np.zeros(3)
    for i in range(3):
        size2 += error[i] ** 2
    beyond = max(0.0, 1.0 - deadband / max(math.sqrt(size2), 1e-12))
    for i in range(3):
        rate[i] = gain[i] * beyond * error[i]
        rate2 += rate[i] ** 2
    share = min(1.0, most / max(math.sqrt(rate2), 1e-12))
    for i in range(3):
        for k in range(3):
            out[i] += R[i, k] * share * rate[k]
    return out
