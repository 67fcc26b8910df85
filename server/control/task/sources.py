"""Sources that need no path: joystick, force, reflex, virtual fixture, camera's view."""

import math
from typing import ClassVar, Final, NamedTuple

import numpy as np

from ....config.schema.sources import (
    ForceSection,
    JoystickSection,
    PointAtSection,
    ReflexSection,
    SpringSection,
    VisionSection,
)
from ..compiled import FLAG, MATRIX, NUMBER, ROW, VECTOR, compiled
from ..inputs import Intent, ViewGoal
from ..spatial import (
    NO_TWIST,
    Array,
    Motion,
    Pose,
    motion_at,
    nonzero,
    pose_error,
    rotate_twist,
    sizes,
    twist_at,
    wrench_to,
)
from ..stop.trajectory import VelocityPlanner
from .image import view_error
from .source import Context, Redefined, Shaping, Source

# --- The operator's stick: rates, scaled by K_HC (Williams 1997, section 2.2) ---------------------
#
# Shaped in Cartesian acceleration and jerk before it enters the sum, so that the motion keeps
# its direction when joints saturate. A stick that is released or falls silent may come to rest
# more quickly than it set out.


class JoystickState(NamedTuple):
    """The shaped twist in World axes, before the gain, as a motion of six freedoms."""

    motion: Motion

    @staticmethod
    def idle() -> "JoystickState":
        """Return the state of a released stick."""
        return _RELEASED


_RELEASED: Final = JoystickState(Motion(NO_TWIST, NO_TWIST, NO_TWIST))


class Joystick(Source[JoystickState]):
    """Shapes the stick's twist inside acceleration and jerk bounds."""

    def __init__(self, section: JoystickSection, shaping: Shaping) -> None:
        self._shaping = shaping
        self._planner = self._braking = VelocityPlanner(shaping.acceleration, shaping.jerk)
        quicker = section.braking
        if quicker != 1.0:
            # Time scaled down: the same way to rest, so many times as quickly.
            self._braking = VelocityPlanner(
                quicker * shaping.acceleration, quicker**2 * shaping.jerk
            )

    def idle(self) -> JoystickState:
        """Return the state of a released stick."""
        return _RELEASED

    def rate(
        self, context: Context, state: JoystickState, gain: Array
    ) -> tuple[Array, JoystickState]:
        """Return the shaped twist; `gain` (6,) applies in the stick's own axes [1]."""
        stick, target = context.inputs.stick, NO_TWIST
        if not context.moving:
            stick, state = None, _RELEASED
        if stick is not None:
            target = rotate_twist(stick.R_world_axes, gain * stick.twist)
        planner = self._planner if nonzero(target) else self._braking
        shaped = planner.shape(state.motion, target, self._shaping.period_s)
        if shaped is state.motion:
            return NO_TWIST, state
        return shaped.dq, JoystickState(shaped)

    def carry(self, state: JoystickState, context: Context, redefined: Redefined) -> JoystickState:
        """Return the state with the same motion of the rigid body, told at the MRF of now."""
        if redefined.lever is None:
            return state
        most, acceleration = self._shaping.most, self._shaping.acceleration
        return JoystickState(motion_at(state.motion, redefined.lever, most, acceleration))


# --- In HOLD, force control goes on alone, inside a small leash, until contact is bled off --------

BLED_OFF = 0.3
"""Bleeding off contact in HOLD ends at this part of its threshold [1]."""


class Bled(NamedTuple):
    """Whether contact is being bled off, and the twist that does it."""

    bleeding: bool
    twist: Array
    """(6,) in World axes; attitude is held but where a moment is bled off."""


def bleed(
    bleeding: bool,
    wrench: Array | None,
    asked: Array,
    away: Array,
    threshold: float,
    leash: float,
    threshold_moment: float = math.inf,
) -> Bled:
    """Return whether contact is bled off now, and how.

    `wrench` (6,) is what the arm exerts, None when stale; `asked` (6,) what force control asks for,
    and `away` (3,) how far the Wrist is from where HOLD began [m], both in World axes. Moments are
    bled off beyond their threshold [N·m] where it is given.
    """
    if wrench is None:
        return Bled(False, np.zeros(6))
    part = BLED_OFF if bleeding else 1.0
    pushes = math.sqrt(float(wrench[:3] @ wrench[:3])) > threshold * part
    turns = math.sqrt(float(wrench[3:] @ wrench[3:])) > threshold_moment * part
    if not (pushes or turns):
        return Bled(False, np.zeros(6))
    twist = asked.copy()
    room = max(0.0, leash - math.sqrt(float(away @ away)))
    share = min(1.0, room / (0.2 * leash + 1e-12))
    if float(asked[:3] @ away) > 0.0:
        twist[:3] *= share
    # Turning about a grasp takes the Wrist along, whichever way.
    twist[3:] *= share if turns else 0.0
    return Bled(True, twist)


def relief(wrench: Array | None, asked: Array, threshold: float) -> Array | None:
    """Return the twist (6,) by which joints that are commanded themselves give way to contact.

    In World axes, forces only; None where contact is below the part of the threshold at which it
    counts as bled off: noise and inertia move no joint. `wrench` (6,) is what the arm exerts,
    `asked` (6,) accommodation of all of it.
    """
    size = 0.0 if wrench is None else math.sqrt(float(wrench[:3] @ wrench[:3]))
    if size <= BLED_OFF * threshold:
        return None
    twist = (1.0 - BLED_OFF * threshold / size) * asked
    twist[3:] = 0.0
    return twist


def joint_share(force: float, threshold: float) -> float:
    """Return the share (0 to 1) of joint rates that lead into contact of a force [N]."""
    return min(1.0, max(0.0, (threshold - force) / ((1.0 - BLED_OFF) * threshold)))


# --- Force control by accommodation (Williams 1997, section 2.5): twist = K_F (F_desired − F) -----
#
# F is the wrench that the arm exerts on its environment, at and in the MRF. With F_desired = 0
# this is force–moment accommodation (FMA): pressing on a wall, the arm backs off. Together with
# a stick it turns a rate into a force by itself: F = K_HC u / K_F. In HOLD it goes on alone,
# inside a small leash, until contact is bled off.


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
        if not (context.moving or context.inputs.intent is Intent.HOLD):
            return NO_TWIST, _FREE
        if context.moving and not context.guided:
            return self._beside_joints(context, gain), _FREE
        R = context.k.T_world_mrf.R
        twist = accommodation(context.wrench, desired_at_mrf(context), gain, R)
        return (twist, _FREE) if context.moving else self._bled(context, state, twist)

    def jump(
        self, context: Context, redefined: Redefined, state: ForceState, gain: Array, twist: Array
    ) -> Array | None:
        """Return the rate about the MRF of before, told at that of now, less the rate of now."""
        if redefined.lever is None:
            return None
        before = redefined.before.T_wrist_mrf
        desired = wrench_to(before.inverse() @ context.T_wrist_mrf, desired_at_mrf(context))
        R_world_before = context.k.T_world_wrist.R @ before.R
        was = accommodation(context.wrench_at(before)[0], desired, gain, R_world_before)
        return twist_at(was, redefined.lever) - twist

    def _beside_joints(self, context: Context, gain: Array) -> Array:
        """Return the twist (6,) beside a jog or a posture: contact is given way to."""
        none = np.zeros(6)
        asked = accommodation(context.wrench, none, gain, context.k.T_world_mrf.R)
        twist = relief(context.wrench, asked, self._threshold)
        return NO_TWIST if twist is None else twist

    def _bled(self, context: Context, state: ForceState, twist: Array) -> tuple[Array, ForceState]:
        """Return the twist of accommodation as far as it bleeds off contact in HOLD."""
        at = context.k.T_world_wrist.p
        base = None if context.inputs.moved is None else context.inputs.moved.base.T
        if base is not None:
            at = base.R.T @ (at - base.p)
        hold = state.hold if state.hold is not None else at
        away = at - hold if base is None else base.R @ (at - hold)
        bled = bleed(state.bleeding, context.wrench, twist, away, self._threshold, self._leash)
        return bled.twist, ForceState(hold, bled.bleeding)


def desired_at_mrf(context: Context) -> Array:
    """Return the wrench to exert (6,), at the MRF and in its axes."""
    inputs = context.inputs
    return desired_wrench(inputs.wrench_desired, inputs.R_world_wrench, context.k.T_world_mrf.R)


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


# --- How hard sources press: no faster into contact than force control gives way to a bound -------
#
# Where a stick's rate u meets a surface, the force grows until force control gives way at the
# same rate, F = K_HC u / K_F (Williams 1997, section 2.5): a stick at full speed would press
# with hundreds of newtons. So the power that the other sources put into a contact, wrench times
# twist, over the force, is bounded by K_F F_most. With a contact at one point, wherever that is,
# this is the speed of that point. What force control gives way by turning is not counted: several
# contacts may hinder it. The bound goes on for a while after something was pressed, as a tool
# that bounces off a stiff wall would come back at full speed.

PRESSED = 0.25
"""Something is pressed from this part of the bound on, beside what speeds up a payload [1]."""

LETS_GO_S = 0.5
"""Time constant with which a tool that presses nothing any more is free again [s]."""

FREED = 0.05
"""It is free at this part [1]."""


def pressed(
    before: Array | None, wrench: Array | None, R_world_mrf: Array, least: float, part: float
) -> Array | None:
    """Return the wrench by which something is pressed, for a force of 1 N, in World axes (6,).

    It was so `before`, and counts less and less. `wrench` (6,) is what is exerted, in the axes of
    the MRF; None where that is not known. A force of `least` [N] counts; `part` is a period's share
    of `LETS_GO_S`. None: nothing is pressed.
    """
    if wrench is not None:
        size = sizes(wrench)[0]
        if size > least:
            return rotate_twist(R_world_mrf, wrench / size)
    if before is None or sizes(before)[0] < FREED:
        return None
    return np.asarray((1.0 - part) * before)


def eased(asked: Array, press: Array, gain: Array, R_world_mrf: Array, most: float) -> Array | None:
    """Return the twist (6,) that takes back what of a sum `asked` (6,) presses too hard.

    The sum keeps its direction: along a wall with friction, one that changed it would chatter.
    `press` (6,) is as of `pressed`; `gain` (6,) is K_F [m/s/N, rad/s/(N·m)] along the axes of the
    MRF. None where the sum leads into the contact more slowly than force control gives way to
    `most` [N], and where that gives way to nothing.
    """
    counts = math.sqrt(float(press[:3] @ press[:3]))
    wrench = press / counts
    gives_way = most * float(gain[:3] @ (wrench[:3] @ R_world_mrf) ** 2)
    into = float(asked @ wrench)
    if into <= gives_way or gives_way <= 0.0:
        return None
    return counts * (gives_way / into - 1.0) * asked


# --- Folding to pass below what is ahead: the tool's part of it (Zhang et al. 2013, section 4) ----
#
# An arm that folds goes to a posture, joints in proportion, with rates z. The tool's part of
# that, J z, is this source; what is left of it, (1 − J⁺J) z, is the redundancy objective of the
# same name.


class ReflexState(NamedTuple):
    """Nothing is remembered: the posture's rates stop in time by themselves."""


_NO_REFLEX = ReflexState()


class Reflex(Source[ReflexState]):
    """Leads the tool as the arm folds."""

    def __init__(self, section: ReflexSection, shaping: Shaping) -> None:
        """Build it; it has no constants."""

    def idle(self) -> ReflexState:
        """Return the only state."""
        return _NO_REFLEX

    def rate(self, context: Context, state: ReflexState, gain: Array) -> tuple[Array, ReflexState]:
        """Return the twist of an MRF that is folded away; `gain` (6,) is its share, in World."""
        folding = context.folding
        if folding is None or not context.guided:
            return NO_TWIST, state
        return gain * folding, state


# --- A virtual fixture: the tool is pulled to a line or a plane (Rosenberg 1993; Abbott 2007) -----
#
# The way from the MRF to the nearest point of the fixture, less a deadband, times a gain, is
# the rate: along the line or in the plane, the tool is free. An axis of the tool may be turned
# into the line's direction, or into the plane's normal, by the shortest arc. As every source,
# it adds to the others: a stick of u against it stands off by u / K_S.
#
# It is shaped in acceleration and jerk, at a point of the tool that stays the same, so that
# neither a new MRF nor a frame that jumps makes the tool jump.

_WORLD = Pose.identity()


class SpringState(NamedTuple):
    """The shaped twist of a point of the tool in World axes, as a motion of six freedoms."""

    motion: Motion


_NO_SPRING: Final = SpringState(Motion(NO_TWIST, NO_TWIST, NO_TWIST))


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
        return _NO_SPRING

    def rate(self, context: Context, state: SpringState, gain: Array) -> tuple[Array, SpringState]:
        """Return the twist that leads to the fixture; `gain` (6,) is K_S [1/s], in its frame."""
        target, pulls = NO_TWIST, context.guided and nonzero(gain)
        if not context.moving:
            state = _NO_SPRING
        if state is _NO_SPRING and not pulls:
            return NO_TWIST, _NO_SPRING
        if pulls:
            target = twist_at(self._pull(context, gain), context.lever)
        shaped = self._planner.shape(state.motion, target, self._period_s)
        if shaped is state.motion:
            return NO_TWIST, _NO_SPRING
        return twist_at(shaped.dq, -context.lever), SpringState(shaped)

    def _pull(self, context: Context, gain: Array) -> Array:
        """Return the twist (6,) of the MRF that is asked for, before shaping."""
        moved = context.inputs.moved
        body = None if moved is None else moved.body(self._relative_to)
        frame = _WORLD if body is None else body.T
        R, mrf, factor = frame.R, context.k.T_world_mrf, context.inputs.settings.speed_factor
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


# --- An axis of the tool looks at a point ---------------------------------------------------------
#
# The shortest arc from the axis to the line of sight, times a gain, is the rate: it has no part
# about the axis, so that the tool rolls about its line of sight as others have it, and none of
# translation. What turns the line of sight, the tool that goes past or the point that moves, is
# fed forward: a tool that goes by at v looks at the point all the way, and not v / (r K_A) behind.
#
# Near the point a small step turns the line of sight by much: there it lets go.

FED_FORWARD: Final = 0.5
"""From this gain on the line of sight's turning is fed forward in full; below, it fades [1/s]."""


class PointAtState(NamedTuple):
    """The shaped rate in World axes (3,), as a motion."""

    motion: Motion


_LOOKS_NOWHERE: Final = PointAtState(Motion(NO_TWIST[:3], NO_TWIST[:3], NO_TWIST[:3]))


class PointAt(Source[PointAtState]):
    """Turns an axis of the tool to a point."""

    def __init__(self, section: PointAtSection, shaping: Shaping) -> None:
        self._point, self._relative_to = np.array(section.point), section.relative_to
        self._axis, self._most = _unit(section.tool_axis), section.angular_speed
        self._nearest = section.nearest
        self._planner = VelocityPlanner(shaping.acceleration[3:], shaping.jerk[3:])
        self._period_s = shaping.period_s

    def idle(self) -> PointAtState:
        """Return the state of a tool that looks nowhere."""
        return _LOOKS_NOWHERE

    def rate(
        self, context: Context, state: PointAtState, gain: Array
    ) -> tuple[Array, PointAtState]:
        """Return the twist that turns the axis to the point; `gain` (6,) is K_A [1/s], in World."""
        target, looks = NO_TWIST[:3], context.guided and nonzero(gain[3:])
        if not context.moving:
            state = _LOOKS_NOWHERE
        if state is _LOOKS_NOWHERE and not looks:
            return NO_TWIST, _LOOKS_NOWHERE
        if looks:
            target = self._turn(context, gain[3:])
        shaped = self._planner.shape(state.motion, target, self._period_s)
        if shaped is state.motion:
            return NO_TWIST, _LOOKS_NOWHERE
        return np.concatenate([np.zeros(3), shaped.dq]), PointAtState(shaped)

    def jump(
        self,
        context: Context,
        redefined: Redefined,
        state: PointAtState,
        gain: Array,
        twist: Array,
    ) -> Array | None:
        """Return the turn about the MRF of before, told at that of now, less the rate of now."""
        return None if redefined.lever is None else twist_at(twist, redefined.lever) - twist

    def _turn(self, context: Context, gain: Array) -> Array:
        """Return the rate (3,) that is asked for, before shaping."""
        mrf, moved, point = context.k.T_world_mrf, context.inputs.moved, self._point
        going, ground = context.twist[:3], np.zeros(3)
        body = None if moved is None else moved.body(self._relative_to)
        if body is not None:
            point = body.T.p + body.T.R @ point
        if moved is not None:
            going = going - moved.carries(self._relative_to, point)[:3]
        if context.carried is not None:
            ground = context.carried[3:]
        most = context.inputs.settings.speed_factor * self._most
        return _sighted(mrf.R @ self._axis, point - mrf.p, going, ground, gain, self._nearest, most)


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, NUMBER, NUMBER)
def _sighted(
    axis: Array, way: Array, going: Array, ground: Array, gain: Array, nearest: float, most: float
) -> Array:
    """Return the rate (3,) that turns a unit vector `axis` to the `way` (3,) to a point [m].

    The tool is `going` (3,) [m/s] with respect to the point; the sum adds how the `ground` (3,)
    turns [rad/s]. All in World axes.
    """
    distance = along = size2 = 0.0
    for i in range(3):
        distance += way[i] ** 2
    distance = math.sqrt(distance)
    out = np.zeros(3)
    share = min(1.0, max(0.0, 2.0 * distance / nearest - 1.0))
    if share == 0.0:
        return out
    sight = way / distance
    turn = _arc(axis, sight)
    for i in range(3):
        along += ground[i] * sight[i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        follows = (going[j] * sight[k] - going[k] * sight[j]) / distance
        follows += along * sight[i] - ground[i]
        out[i] = share * (gain[i] * turn[i] + min(1.0, gain[i] / FED_FORWARD) * follows)
        size2 += out[i] ** 2
    most = min(1.0, most / max(math.sqrt(size2), 1e-12))
    for i in range(3):
        out[i] *= most
    return out


# --- A camera's view (Williams 1997, section 2.4): the position law with the Lens for the MRF -----
#
# The desired view takes the target pose's part and the seen target the CRF's: the pose error by
# translation and rotation logarithm, times K_V, is the rate of the Lens; the rigid body between
# makes it the MRF's. A camera that is carried moves its Lens to where the target looks as
# desired; one that stands beside the arm moves the target, which the arm carries, to where it
# is desired.
#
# Between two pictures, and for as long as a picture is on its way, the target is taken to stand
# where it was last seen in its own frame (World, or the Wrist that carries it), found with the
# arm's pose at the picture's own instant. The arm's motion since then is thus no error, and the
# loop has no more delay than the position source's, however late pictures come: what is late is
# only the news that the target itself has moved.
#
# By the image-based law (`image.py`) the corners of a stored picture take the pose's part: all but
# the error is the same.


class VisionState(NamedTuple):
    """The shaped twist of a point of the tool in World axes, as a motion of six freedoms."""

    motion: Motion

    @staticmethod
    def idle() -> "VisionState":
        """Return the state of a source that asks for nothing."""
        return _NO_VIEW


_NO_VIEW: Final = VisionState(Motion(NO_TWIST, NO_TWIST, NO_TWIST))


class Vision(Source[VisionState]):
    """Keeps a view; the Lens is no faster than the section's speeds, and its rate is shaped."""

    def __init__(self, section: VisionSection, shaping: Shaping) -> None:
        self._speed, self._turn = section.speed, section.angular_speed
        self._planner = VelocityPlanner(shaping.acceleration, shaping.jerk)
        self._period_s = shaping.period_s

    def idle(self) -> VisionState:
        """Return the state of a source that asks for nothing."""
        return _NO_VIEW

    def rate(self, context: Context, state: VisionState, gain: Array) -> tuple[Array, VisionState]:
        """Return the twist that leads to the desired view.

        `gain` (6,) is K_V [1/s] per axis of the Lens. It is shaped where the MRF was at start,
        always the same point of the tool. Without a goal, or with a new one, the rate changes
        within the acceleration and jerk bounds.
        """
        goal = context.inputs.view if context.guided else None
        target = NO_TWIST
        if goal is not None and nonzero(gain):
            p_world_tool = context.k.T_world_mrf.p + context.lever
            factor = context.inputs.settings.speed_factor
            target = self._asked(goal, context.k.T_world_wrist, p_world_tool, gain, factor)
        if not context.moving:
            state = _NO_VIEW
        shaped = self._planner.shape(state.motion, target, self._period_s)
        if shaped is state.motion:
            return NO_TWIST, state
        twist = shaped.dq
        if nonzero(context.lever):
            twist = twist_at(twist, -context.lever)
        return twist, VisionState(shaped)

    def _asked(
        self, goal: ViewGoal, T_world_wrist: Pose, p_world_tool: Array, gain: Array, factor: float
    ) -> Array:
        here = T_world_wrist @ goal.T_wrist_point
        axes = (goal.T_world_lens or here).R
        speed, turn = factor * self._speed, factor * self._turn
        by_image = len(goal.picture.points) > 0
        error = view_error(goal, here) if by_image else pose_error(goal.T_world_goal, here)
        out = np.zeros(6)
        _ask(axes, error, gain, speed, turn, p_world_tool, here.p, out)
        return out


@compiled(MATRIX, VECTOR, VECTOR, NUMBER, NUMBER, VECTOR, VECTOR, ROW)
def _ask(
    axes: Array,
    error: Array,
    gain: Array,
    speed: float,
    turn: float,
    tool: Array,
    point: Array,
    out: Array,
) -> None:
    """Write the rate (6,) of the tool for the pose error (6,) of a point, all in World.

    `gain` (6,) acts per axis of the Lens, whose `axes` (3, 3) are in World. One factor keeps all
    six within `speed` [m/s] and `turn` [rad/s]: the target is to stay in the picture, so the way
    stays straight. `tool` and `point` (3,) are on one rigid body [m].
    """
    asked, size2 = np.zeros(6), np.zeros(2)
    for i in range(6):
        part = i // 3
        for k in range(3):
            asked[i] += axes[k, i % 3] * error[3 * part + k]
        asked[i] *= gain[i]
        size2[part] += asked[i] ** 2
    most = max(1.0, math.sqrt(size2[0]) / speed, math.sqrt(size2[1]) / turn)
    for i in range(3):
        for k in range(3):
            out[i] += axes[i, k] * asked[k] / most
            out[3 + i] += axes[i, k] * asked[3 + k] / most
    # From the moved point to the tool's (eq. 1).
    x, y, z = tool[0] - point[0], tool[1] - point[1], tool[2] - point[2]
    out[0] += out[4] * z - out[5] * y
    out[1] += out[5] * x - out[3] * z
    out[2] += out[3] * y - out[4] * x
