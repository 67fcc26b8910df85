"""Follower of a moving frame: its track without jumps, as control uses it.

Every piece of news changes what is believed a little, and the first after a silence may change it
by much. The arm is to notice neither: the frame goes on from where it was believed, at the twist
that it had, and what it differs by from the new belief decays inside acceleration and jerk bounds.
With no news at all it comes to rest where it then is, by the same bounds.

While the arm depends on it, a frame is never told to be faster, or to accelerate more, than `most`
says, whatever is believed: that is what news of it can do to the arm.
"""

import math
from typing import NamedTuple

import numpy as np

from ...control.frame_tree import Body
from ...control.spatial import Array, Pose, pose_error, right_jacobian, rotation_exp, vector_rate
from ...control.stop.motion import Motion
from .frame_tracking import Track, within

SETTLING = 20.0
"""Natural frequency with which a small difference decays, critically damped [rad/s]."""

GONE = 1e-9
"""Differences below this are rounding [m, rad, and per second]."""


class FollowerState(NamedTuple):
    """State of the follower; `now` is the frame that control uses."""

    now: Body
    track: Track | None
    """The believed track; None while nothing is known, or no longer."""
    rest: Pose
    """Where it stands by belief while nothing is known."""
    offset: Motion
    """`now` less what is believed, as a motion of six freedoms, World axes."""


class Follower:
    """Follows one frame; `speed`, `acceleration`, `jerk` (6,) bound how it gets to the belief.

    All of its motion is inside `speed` and `acceleration`, too.
    """

    def __init__(self, speed: Array, acceleration: Array, jerk: Array, period_s: float) -> None:
        self._speed = (float(speed[0]), float(speed[3]))
        self._step = (period_s * float(acceleration[0]), period_s * float(acceleration[3]))
        self._bounds = [
            (part, float(speed[i]), float(acceleration[i]), float(jerk[i]))
            for i, part in ((0, slice(0, 3)), (3, slice(3, 6)))
        ]
        self._period_s = period_s

    @staticmethod
    def standing(T: Pose) -> FollowerState:
        """Return a frame of which nothing was heard, at T in World."""
        return FollowerState(Body.standing(T), None, T, Motion.at_rest(np.zeros(6)))

    def step(
        self, state: FollowerState, track: Track | None, tick: int, lead_s: float, snap: bool
    ) -> FollowerState:
        """Return the frame at `lead_s` after `tick`.

        `track` is what is known now, None when its news is stale. `snap`: nothing depends on the
        frame, so that what is believed is told as it is.
        """
        then_s = tick * self._period_s + lead_s
        before, offset = state.now, self._decayed(state)
        if track is not state.track:
            now = self._placed(_believed(state, then_s, self._period_s), offset)
            rest = now.T if track is None else state.rest
            state = FollowerState(now, track, rest, offset)
            offset = _between(_believed(state, then_s, self._period_s), now, offset.ddq)
        if snap:
            offset = Motion.at_rest(np.zeros(6))
        believed = _believed(state, then_s, self._period_s)
        now = self._placed(believed, offset)
        if not snap:
            now, offset = self._bounded(before, now, believed, offset)
        return state._replace(now=now, offset=offset)

    def _bounded(
        self, before: Body, now: Body, believed: Body, offset: Motion
    ) -> tuple[Body, Motion]:
        """Return the frame that is no faster than it may be, and its difference from the belief."""
        asked = now.twist - before.twist
        change = within(asked, self._step)
        if change is asked and within(now.twist, self._speed) is now.twist:
            return now, offset
        twist = within(before.twist + change, self._speed)
        way = self._period_s * twist
        T = Pose(rotation_exp(way[3:]) @ before.T.R, before.T.p + way[:3])
        held = Body(T, twist)
        return held, _between(believed, held, offset.ddq + (twist - now.twist) / self._period_s)

    def _decayed(self, state: FollowerState) -> Motion:
        """Return the difference one period later."""
        q, dq, ddq = state.offset
        home = state.track is not None
        if not (dq.any() or ddq.any() or (home and q.any())):
            return state.offset
        T = self._period_s
        towards = np.empty(6)
        for part, speed, most, jerk in self._bounds:
            rate = np.zeros(3)
            if home:
                size = _size(q[part])
                # As fast as it can be braked: half of the deceleration is in reserve, and it takes
                # a while to turn round.
                slow = most * (most / jerk + T)
                braked = math.sqrt(slow * slow + most * size) - slow
                fast = min(0.5 * SETTLING * size, braked, speed)
                rate = q[part] * (-fast / max(size, 1e-12))
            asked = _within(2.0 * SETTLING * (rate - dq[part]), most)
            towards[part] = ddq[part] + _within(asked - ddq[part], jerk * T)
        rate = dq + T * towards
        moved = Motion(q + T * rate, rate, towards)
        left = (moved.q, rate, towards) if home else (rate, towards)
        if all(float(np.abs(x).max()) < GONE for x in left):
            return Motion.at_rest(np.zeros(6) if home else moved.q)
        return moved

    @staticmethod
    def _placed(body: Body, offset: Motion) -> Body:
        r = offset.q[3:]
        if not (offset.q.any() or offset.dq.any()):
            return body
        turn = rotation_exp(r)
        T = Pose(turn @ body.T.R, body.T.p + offset.q[:3])
        twist = body.twist + offset.dq
        twist[3:] = turn @ body.twist[3:] + right_jacobian(-r) @ offset.dq[3:]
        return Body(T, twist)


def _believed(state: FollowerState, then_s: float, period_s: float) -> Body:
    if state.track is None:
        return Body.standing(state.rest)
    return state.track.at(then_s - state.track.tick * period_s)


def _between(believed: Body, now: Body, acceleration: Array) -> Motion:
    """Return the difference that makes `now` of what is believed, in pose and in twist."""
    q = pose_error(now.T, believed.T)
    rate = now.twist - believed.twist
    spin = now.twist[3:] - rotation_exp(q[3:]) @ believed.twist[3:]
    rate[3:] = vector_rate(-q[3:], spin)
    return Motion(q, rate, acceleration)


def _within(vector: Array, most: float) -> Array:
    return vector * min(1.0, most / max(_size(vector), 1e-12))


def _size(vector: Array) -> float:
    return math.sqrt(float(vector @ vector))
