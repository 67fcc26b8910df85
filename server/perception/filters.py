"""Filters of what devices tell: contact by the drives' torques, moving frames, sightings. Pure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, NamedTuple

import numpy as np

from ..control.compiled import MATRIX, NUMBER, TABLE, VECTOR, compiled, evolve, record
from ..control.inputs import NO_PICTURE, Picture, Pushed
from ..control.mechanism.model import Dynamics
from ..control.scene import Body
from ..control.spatial import (
    Array,
    Motion,
    Pose,
    pose_error,
    right_jacobian,
    rotation_exp,
    rotation_log,
    vector_rate,
)

# --- Contact that no sensor sees, from the drives' torques ----------------------------------------
#
# A joint moves by what its drive gives and by what pushes the arm: with w the whole load that
# the force/torque sensor reads, J its Jacobian, and M, C, g those of the arm without what hangs
# on it,
#
#     τ_ext = M q̈ + C q̇ + g + Jᵀ w + τ_f − τ
#
# is what pushes the arm inboard of the sensor; low-passed, it is unseen contact. Weight,
# inertial forces and contact of the tool are all in w: what hangs there need not be known. It
# is the momentum observer (De Luca & Mattone 2003) with the momentum's rate written out as a
# second difference over the instants of the samples, which is one period late. Everything else
# is brought to that instant: torques, which drives report of the period before, as the mean of
# two; the load by its own stamps. A contact that grows by 1 N a millisecond is otherwise a push
# of 10 N. The law of drives in CST has another (`momentum.py`): of what it sent and predicted,
# slower, and without what friction may hold, because it acts on what it finds; this one judges
# what drives report, and in every operation mode.
#
# What is not known counts as nobody's push: Coulomb friction near standstill, whose sign may be
# either, a part of the accelerating torque, and the change of a load within a period, which
# drives and sensor see through filters of their own. It passes the same low-pass as the
# estimate, so that it outweighs what it excuses at every instant.

SLOW = 0.02
"""Joint speed above which the sign of friction is certain [rad/s]."""

CHATTER = 0.5
"""Contact that opens and closes between two samples is known to this part of what they jump [1]."""

CHATTER_S = 0.2
"""And goes on for about that long where samples happen to show nothing of it [s]."""

NOISE = 1.0
"""Jumps of less are the sensor's noise [N]."""


class SensorLoad(NamedTuple):
    """Reading of the force/torque sensor, and its age."""

    wrench: Array
    """All that the arm exerts on what is outboard (6,), at and in the Sensor frame [N, N·m]."""
    jump: Array
    """By how much one sample is off its neighbours' mean (6,) [N, N·m]."""
    lag_s: float
    """How much older the reading is than the joints [s]."""


class LoadUncertainty(NamedTuple):
    """Bounds of the error of the sensor's load."""

    force: float
    """[N]"""
    moment: float
    """[N·m]"""
    angle: float
    """By how much its axes may be turned [rad]."""


UNKNOWN_LOAD = LoadUncertainty(5.0, 0.5, math.radians(6.0))
"""A sensor of which nothing is known: its bias and its mounting."""


@dataclass(frozen=True)
class DetectorState:
    """Memory of the detector from tick to tick; empty at first."""

    q: tuple[Array, ...] = ()
    """Measured joints (n,) of the last two ticks, newest first [rad]."""
    tau: Array | None = None
    """The drives' torques (n,) one tick ago [N·m]."""
    load: SensorLoad | None = None
    """The sensor's reading of one tick ago."""
    external: Array | None = None
    """Low-passed torques (n,) of unseen contact, one tick ago [N·m]; None before it is known."""
    excused: Array | None = None
    """The part of that which friction and inertia may explain (n,) [N·m]."""
    chatter: Array | None = None
    """The part beside which chattering contact may explain (n,), dying away [N·m]."""
    lasting_s: float = 0.0
    """How long some joint's has been beyond its bound [s]."""
    time_s: float = 0.0
    """When the newest joints were sampled [s]."""
    step_s: float = 0.0
    """How long after those before them [s]."""


@dataclass(frozen=True)
class JointContact:
    """A joint that something pushes."""

    joint: int
    torque: float
    """Estimated external torque [N·m]."""
    bound: float
    """Bound that means contact [N·m]."""


class CollisionDetector:
    """Judges the drives' torques. `bound` (n,) [N·m] means contact if it lasts `confirm_s`.

    `friction` (n,) [N·m] is each joint's Coulomb friction, `doubt` the part of the accelerating
    torque that may be wrong.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        friction: Array,
        bound: Array,
        doubt: float,
        filter_hz: float,
        confirm_s: float,
        period_s: float,
    ) -> None:
        self.dynamics = dynamics
        self._friction = friction
        self._bound = bound
        self._doubt = doubt
        self._smoothing = 1.0 - math.exp(-2.0 * math.pi * filter_hz * period_s)
        self._dying = math.exp(-period_s / CHATTER_S)
        self._confirm_s = confirm_s
        self._period_s = period_s
        self._nothing = (np.zeros((6, len(bound))), np.zeros(6), np.zeros(6), np.zeros(6))
        """A load that is none, as `_feel` takes it."""

    def measure(
        self,
        state: DetectorState,
        q: Array,
        tau: Array,
        load: SensorLoad | None,
        time_s: float | None,
        doubt: LoadUncertainty | None = None,
    ) -> DetectorState:
        """Return the state after one reading: joints q (n,) [rad] and torques tau (n,) [N·m].

        Without a `load`, nothing but what `dynamics` is told to carry hangs on the arm, and nothing
        touches it; `time_s` is when the joints were sampled [s], None if that is not known: a SYNC
        that is late by a tenth of a period is 10 rad/s² at 1 rad/s to who takes it to be in time.
        A load that is in `doubt` is worth as much less, wherever it points.
        """
        if time_s is None:
            return evolve(state, q=())
        T, step_s = self._period_s, time_s - state.time_s
        if abs(step_s - T) > 0.5 * T or (load is None) is not (state.load is None):
            # Ticks were missed, or a late one is followed by one in time: torques are the means of
            # other periods. What was felt until then is kept.
            state = evolve(state, q=())
        if len(state.q) < 2 or state.tau is None:
            return evolve(
                state, q=(q, *state.q[:1]), tau=tau, load=load, time_s=time_s, step_s=step_s
            )
        (q1, q2), before_s = state.q, state.step_s
        rate, rate_before = (q - q1) / step_s, (q1 - q2) / before_s
        dq = (before_s * rate + step_s * rate_before) / (step_s + before_s)
        ddq = 2.0 * (rate - rate_before) / (step_s + before_s)
        still = np.zeros(len(q))
        needed, J = self.dynamics.needed(q1, dq, ddq)
        if load is not None and state.load is not None:
            until = _part_until_then(state.load, load, step_s)
            carried, dying = (J, state.load.wrench, load.wrench, load.jump), self._dying
        else:
            carried, until, dying = self._nothing, 0.0, 0.0
        # From nothing at first: brakes that open leave the drives' torques upset.
        before = still, still, still
        if state.external is not None and state.excused is not None and state.chatter is not None:
            before = state.external, state.excused, state.chatter
        external, excused, chatter = felt = np.empty((3, len(q)))
        beyond = _feel(
            (needed, dq, tau, state.tau),
            (*carried, until),
            (0.0, 0.0, 0.0) if doubt is None else doubt[:],
            before,
            (self._friction, self._bound, self._doubt, self._smoothing, dying),
            felt,
        )
        lasting_s = state.lasting_s + T if beyond else 0.0
        return DetectorState(
            (q, q1), tau, load, external, excused, chatter, lasting_s, time_s, step_s
        )

    def touched(self, state: DetectorState) -> JointContact | None:
        """Return which joint is pushed most, against its bound, if one is for long enough."""
        if state.external is None or state.excused is None or state.chatter is None:
            return None
        if state.lasting_s <= self._confirm_s:
            return None
        bound = self._bound + state.excused + state.chatter
        j = int(np.argmax(np.abs(state.external) / bound))
        return JointContact(j, float(state.external[j]), float(bound[j]))

    def pushed(self, state: DetectorState) -> Pushed | None:
        """Return the estimate that a state holds, None before there is one."""
        if state.external is None or state.excused is None:
            return None
        excused = state.excused if state.chatter is None else state.excused + state.chatter
        return Pushed(state.external, excused, self._bound)


def _part_until_then(before: SensorLoad, now: SensorLoad, step_s: float) -> float:
    """Return which part of a load's change was over when the joints were sampled one step ago."""
    between_s = step_s - now.lag_s + before.lag_s
    return min(1.0, max(0.0, before.lag_s / between_s)) if between_s > 0.0 else 0.0


@compiled(
    record(MATRIX, *3 * (VECTOR,)), record(MATRIX, *3 * (VECTOR,), NUMBER), record(*3 * (NUMBER,)),
    record(*3 * (VECTOR,)), record(VECTOR, VECTOR, *3 * (NUMBER,)), TABLE,
)  # fmt: skip
def _feel(
    motion: tuple[Array, ...],
    carried: tuple[Any, ...],
    doubt: tuple[float, float, float],
    before: tuple[Array, ...],
    known: tuple[Any, ...],
    felt: Array,
) -> bool:
    """Write external torque, what is excused and chatter (3, n) [N·m]; return whether any is felt.

    `motion` is the torques (2, n) that it needs, and needs without acceleration, its rates (n,),
    and the drives' torques now and before; `carried` the Jacobian (6, n) of a load, the load one
    tick ago and now, its jump (6,), and which part of its change was over; `doubt` that of the
    load; `before` the same as `felt`, one tick ago; `known` friction and bound (n,) and three
    parts.
    """
    needed, dq, tau, tau_before = motion
    J, load_before, load, jump, until = carried
    off_n, off_nm, angle = doubt
    friction, bound, part, smoothing, dying = known
    turned = 2.0 * math.sin(0.5 * angle)
    force = math.sqrt(load[0] * load[0] + load[1] * load[1] + load[2] * load[2])
    moment = math.sqrt(load[3] * load[3] + load[4] * load[4] + load[5] * load[5])
    jumped = math.sqrt(jump[0] * jump[0] + jump[1] * jump[1] + jump[2] * jump[2]) > NOISE
    found = False
    for j in range(len(dq)):
        certain = min(max(dq[j] / SLOW, -1.0), 1.0)
        # A drive reports the mean of the period before: two of them lie about the instant of q̈.
        external = needed[0, j] + friction[j] * certain - 0.5 * (tau[j] + tau_before[j])
        excused = part * abs(needed[0, j] - needed[1, j]) + friction[j] * (1.0 - abs(certain))
        pushed = changed = shaken = 0.0
        arm_m = arm_1 = 0.0
        for i in range(6):
            change = load[i] - load_before[i]
            pushed += (load_before[i] + until * change) * J[i, j]
            changed += change * J[i, j]
            shaken += jump[i] * J[i, j]
            if i < 3:
                arm_m += J[i, j] * J[i, j]
            else:
                arm_1 += J[i, j] * J[i, j]
        external += pushed
        excused += abs(changed) + (off_n + turned * force) * math.sqrt(arm_m)
        excused += (off_nm + turned * moment) * math.sqrt(arm_1)
        chatter = max(CHATTER * abs(shaken) if jumped else 0.0, dying * before[2][j])
        felt[0, j] = smoothing * external + (1.0 - smoothing) * before[0][j]
        felt[1, j] = smoothing * excused + (1.0 - smoothing) * before[1][j]
        felt[2, j] = chatter
        found = found or abs(felt[0, j]) > bound[j] + felt[1, j] + chatter
    return found


# --- Tracking filter of a moving frame, from news that is late, seldom and noisy. Pure ------------
#
# A fading-memory filter of the second order (Zarchan, Musoff, "Fundamentals of Kalman
# Filtering", section on fading-memory filters) over pose, twist and acceleration: a frame that
# moves at a constant twist or acceleration is followed without steady error. Attitudes by the
# rotation logarithm. Each estimate belongs to the tick that its news names, and is carried on
# to any other by its own twist and acceleration; so what is late is no error as long as the
# motion is smooth.
#
# Anybody may send news, so a frame is never believed to move faster, to accelerate more or to
# be further away than its cell says: what would need that is not believed, and estimates are
# kept inside.

NO_ACCELERATION = 3.0
"""A frame that has been known for less than this tells no acceleration yet [smoothing times]."""


class NewsRejection(StrEnum):
    """Reason to reject news of a frame."""

    QUALITY = "quality"
    JUMP = "jump"
    SPEED = "speed"
    ACCELERATION = "acceleration"
    EXTENT = "extent"
    LATE = "late"
    OUT_OF_ORDER = "out_of_order"
    CONTRADICTION = "contradiction"
    NO_NEWS = "no_news"


class RejectedNews(NamedTuple):
    """Rejected news: the reason, the value that was too large, and its bound."""

    doubt: NewsRejection
    value: float
    bound: float
    unit: str = ""

    @property
    def words(self) -> str:
        """For people."""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.doubt}: {self.value:.3g}{unit}, bound {self.bound:.3g}{unit}"

    @property
    def contradicts(self) -> bool:
        """True where what was believed before and this cannot both be true."""
        return self.doubt in _CONTRADICTING


_CONTRADICTING = frozenset(
    (
        NewsRejection.JUMP,
        NewsRejection.SPEED,
        NewsRejection.ACCELERATION,
        NewsRejection.EXTENT,
        NewsRejection.CONTRADICTION,
    )
)


class Track(NamedTuple):
    """Estimated motion of a frame at the tick of its newest news, in World."""

    tick: int
    T: Pose
    twist: Array
    acceleration: Array
    since: int
    """Tick of the first news that this builds upon."""

    def at(self, seconds: float) -> Body:
        """Return where it will be `seconds` after its tick, to the second order."""
        step = seconds * (self.twist + 0.5 * seconds * self.acceleration)
        T = Pose(rotation_exp(step[3:]) @ self.T.R, self.T.p + step[:3])
        return Body(T, self.twist + seconds * self.acceleration)


@dataclass(frozen=True)
class SightingBounds:
    """Bounds of the difference between two sightings: speeds, and slack for noise."""

    period_s: float
    least_quality: float
    speed: float
    angular_speed: float
    slack: float
    angular_slack: float
    smoothing_s: float


@dataclass(frozen=True)
class PlausibleMotion(SightingBounds):
    """Bounds of a frame's motion, and the smoothing of its news."""

    acceleration: float
    angular_acceleration: float
    extent: tuple[float, float]
    """How far from `home` it may be [m], [rad]; infinite: anywhere."""
    home: Pose
    """Where it stands in World until there is news of it."""


def update_track(
    track: Track | None,
    tick: int,
    T: Pose,
    twist: Array | None,
    quality: float,
    plausible: PlausibleMotion,
) -> Track | RejectedNews:
    """Return what is known after news of `tick`, or why it was not believed.

    `T` is the frame's pose in World, `twist` (6,) its own twist in World axes, if it was measured.
    """
    p = plausible
    if quality < p.least_quality:
        return RejectedNews(NewsRejection.QUALITY, quality, p.least_quality)
    doubted = _beyond(NewsRejection.EXTENT, pose_error(T, p.home), p.extent, ("m", "rad"))
    if doubted is None and twist is not None:
        doubted = _beyond(NewsRejection.SPEED, twist, (p.speed, p.angular_speed), ("m/s", "rad/s"))
    if doubted is not None:
        return doubted
    if track is None:
        return Track(tick, T, np.zeros(6) if twist is None else twist, np.zeros(6), tick)
    dt = (tick - track.tick) * p.period_s
    late = tick <= track.tick
    way = p.speed * abs(dt), p.angular_speed * abs(dt)
    far = (p.slack + way[0], p.angular_slack + way[1])
    kind = NewsRejection.CONTRADICTION if late else NewsRejection.JUMP
    doubted = _beyond(kind, pose_error(T, track.T), far, ("m", "rad"))
    if doubted is None and _settled(track, p):
        # What is known and what is true may accelerate in opposite senses.
        far = (
            p.slack + p.acceleration * dt * dt,
            p.angular_slack + p.angular_acceleration * dt * dt,
        )
        off = pose_error(T, track.at(dt).T)
        kind = NewsRejection.CONTRADICTION if late else NewsRejection.ACCELERATION
        doubted = _beyond(kind, off, far, ("m", "rad"))
    if doubted is None and late:
        doubted = RejectedNews(NewsRejection.OUT_OF_ORDER, tick, track.tick + 1)
    return doubted or _filtered(track, tick, T, twist, dt, plausible)


def _settled(track: Track, p: PlausibleMotion) -> bool:
    """Return whether a frame has been known for long enough to tell how it moves."""
    return (track.tick - track.since) * p.period_s >= NO_ACCELERATION * p.smoothing_s


def _filtered(
    track: Track, tick: int, T: Pose, twist: Array | None, dt: float, plausible: PlausibleMotion
) -> Track:
    # A memory no longer than what there is to remember: at first, two poses are a velocity.
    known_s = (tick - track.since) * plausible.period_s
    keep = math.exp(-dt / max(1e-9, min(plausible.smoothing_s, known_s)))
    forget = 1.0 - keep
    expected = track.at(dt)
    error = pose_error(T, expected.T)
    step = (1.0 - keep**3) * error
    if twist is None:
        v = expected.twist + (1.5 * forget**2 * (1.0 + keep) / dt) * error
        a = track.acceleration + (forget**3 / dt**2) * error
        if not _settled(track, plausible):
            a = np.zeros(6)
    else:
        miss = twist - expected.twist
        v = expected.twist + (1.0 - keep**2) * miss
        a = track.acceleration + (forget**2 / dt) * miss
    R = rotation_exp(step[3:]) @ expected.T.R
    p = plausible
    if _settled(track, p):  # at first, how fast it is has to be found out
        most = (p.acceleration * dt, p.angular_acceleration * dt)
        v = track.twist + within(v - track.twist, most)
    v = within(v, (p.speed, p.angular_speed))
    a = within(a, (p.acceleration, p.angular_acceleration))
    return Track(tick, Pose(R, expected.T.p + step[:3]), v, a, track.since)


def _beyond(
    doubt: NewsRejection, six: Array, most: tuple[float, float], units: tuple[str, str]
) -> RejectedNews | None:
    """Return the doubt about a (6,) whose linear or angular part is larger than `most`."""
    for part, bound, unit in zip((six[:3], six[3:]), most, units, strict=True):
        size = math.sqrt(part @ part)
        if size > bound:
            return RejectedNews(doubt, size, bound, unit)
    return None


def within(six: Array, most: tuple[float, float]) -> Array:
    """Return a (6,) whose linear and angular part are each shortened to at most `most`."""
    v, w = math.sqrt(six[:3] @ six[:3]), math.sqrt(six[3:] @ six[3:])
    if v <= most[0] and w <= most[1]:
        return six
    shares = (min(1.0, most[0] / max(v, 1e-12)), min(1.0, most[1] / max(w, 1e-12)))
    return np.asarray(six * np.repeat(shares, 3))


# --- Follower of a moving frame: its track without jumps, as control uses it ----------------------
#
# Every piece of news changes what is believed a little, and the first after a silence may
# change it by much. The arm is to notice neither: the frame goes on from where it was believed,
# at the twist that it had, and what it differs by from the new belief decays inside
# acceleration and jerk bounds. With no news at all it comes to rest where it then is, by the
# same bounds.
#
# While the arm depends on it, a frame is never told to be faster, or to accelerate more, than
# `most` says, whatever is believed: that is what news of it can do to the arm.

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


# --- Plausibility of sightings: from a known target and a picture to the next known target. Pure
#
# A target is known in its anchor: the frame in which it stands still, World before a carried
# camera, the Wrist before one that stands beside the arm. There the arm's own motion is no
# motion of the target, and an implausible one shows whatever the arm does.

AMBIGUOUS_BELOW = 2.0
"""Two poses are told apart when one fits worse by this factor at least [1]."""

NOISE_PX = 0.15
"""Reprojection errors below this tell nothing [px]."""


class PictureRejection(StrEnum):
    """Reason to reject a picture."""

    NO_TAG = "no_tag"
    QUALITY = "quality"
    AMBIGUOUS = "ambiguous"
    JUMP = "jump"
    LATE = "late"
    OUT_OF_ORDER = "out_of_order"
    NOTHING_STORED = "nothing_stored_is_seen"
    NO_PICTURE = "no_picture"


@dataclass(frozen=True)
class KnownTarget:
    """Pose of a target as last believed."""

    T_anchor_target: Pose
    """Filtered over the pictures that were believed."""
    tick: int
    """To which the newest of them belongs."""


def judge(
    known: KnownTarget | None,
    tick: int,
    poses: tuple[Pose, ...],
    errors_px: tuple[float, ...],
    quality: float,
    belief: SightingBounds,
) -> KnownTarget | PictureRejection:
    """Return what is known after a picture of `tick`, or why it was not believed.

    `poses` are the one or two poses of the target in its anchor that fit the picture, the better
    one first, `errors_px` how well each fits.
    """
    if not poses:
        return PictureRejection.NO_TAG
    if quality < belief.least_quality:
        return PictureRejection.QUALITY
    apart = len(poses) == 1 or errors_px[1] > AMBIGUOUS_BELOW * max(errors_px[0], NOISE_PX)
    if known is None:
        return KnownTarget(poses[0], tick) if apart else PictureRejection.AMBIGUOUS
    if tick <= known.tick:
        return PictureRejection.OUT_OF_ORDER
    elapsed = (tick - known.tick) * belief.period_s
    believable = [p for p in (poses[:1] if apart else poses) if _near(known, p, elapsed, belief)]
    if not believable:
        return PictureRejection.JUMP
    best = nearest_to(known.T_anchor_target, believable)
    share = 1.0 if belief.smoothing_s == 0.0 else -math.expm1(-elapsed / belief.smoothing_s)
    return KnownTarget(_blend(known.T_anchor_target, best, share), tick)


# --- Corners of a board's tags: where each was seen last, what two pictures have in common. Pure --
#
# A corner is known in the anchor as its target is: on the ray on which it was seen, as far along
# that as the pose of the same picture has it. Seen from where that picture was made it looks as it
# did there, whatever focal length, place of the Lens or size of the tag are wrong.

FLAT: Final = 0.01
"""Points whose least extent is below this part of the greatest are on a line [1]."""


class KnownCorners(NamedTuple):
    """Corners of one tag as last believed."""

    points: Array
    """In the anchor (4, 3) [m], filtered as the target's pose is."""
    tick: int


def pictured(points: Array) -> Array:
    """Return the normalised image coordinates (k, 2) of points (k, 3) before a Lens [m]."""
    return np.asarray(points[:, :2] / points[:, 2:])


def with_seen(
    known: Mapping[int, KnownCorners],
    tick: int,
    seen: Mapping[int, Array],
    board: Mapping[int, Array],
    T_anchor_lens: Pose,
    T_lens_target: Pose,
    belief: SightingBounds,
) -> dict[int, KnownCorners]:
    """Return the known corners after a picture of `tick` that was believed.

    `seen` has the corners (4, 2) of tags in normalised image coordinates, `T_lens_target` is the
    pose that explains them. Corners that it does not explain are passed over.
    """
    found = dict(known)
    for tag, s in seen.items():
        if tag not in board:
            continue
        model = board[tag] @ T_lens_target.R.T + T_lens_target.p
        points = np.column_stack([s, np.ones(4)]) * model[:, 2:]
        if model[:, 2].min() <= 0.0 or np.abs(points - model).max() > belief.slack:
            continue
        points = points @ T_anchor_lens.R.T + T_anchor_lens.p
        before = known.get(tag)
        if before is not None and belief.smoothing_s > 0.0:
            elapsed = (tick - before.tick) * belief.period_s
            share = -math.expm1(-elapsed / belief.smoothing_s)
            points = before.points + share * (points - before.points)
        found[tag] = KnownCorners(points, tick)
    return found


def in_common(known: Mapping[int, KnownCorners], stored: Mapping[int, Array]) -> Picture:
    """Return what is known of a stored picture: at least four corners, and not all on a line.

    Points are in the anchor; empty where there is less.
    """
    tags = [tag for tag in stored if tag in known]
    if not tags:
        return NO_PICTURE
    wanted = np.concatenate([stored[tag] for tag in tags])
    extent = np.linalg.svd(wanted - wanted.mean(axis=0), compute_uv=False)
    if extent[1] <= FLAT * extent[0]:
        return NO_PICTURE
    return Picture(np.concatenate([known[tag].points for tag in tags]), wanted)


def nearest_to(T: Pose, poses: Sequence[Pose]) -> Pose:
    """Return the pose whose attitude is the nearest to that of T."""
    return min(poses, key=lambda each: _angle(T, each))


def _near(known: KnownTarget, T: Pose, elapsed_s: float, belief: SightingBounds) -> bool:
    way = _norm(T.p - known.T_anchor_target.p)
    return (
        way <= belief.slack + belief.speed * elapsed_s
        and _angle(known.T_anchor_target, T)
        <= belief.angular_slack + belief.angular_speed * elapsed_s
    )


def _blend(a: Pose, b: Pose, share: float) -> Pose:
    turn = rotation_log(a.R.T @ b.R)
    return Pose(a.R @ rotation_exp(share * turn), a.p + share * (b.p - a.p))


def _angle(a: Pose, b: Pose) -> float:
    return _norm(rotation_log(a.R.T @ b.R))


def _norm(v: Array) -> float:
    return math.sqrt(float(v @ v))
