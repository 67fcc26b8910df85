"""Rows of barriers: how fast joints may go, gaps close, the tool near walls, what is held up."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from ....config.load import Cell
from ..bodies.rates import Resistance
from ..compiled import (
    ARRAY4,
    COUNT,
    FLAG,
    MARKS,
    MATRIX,
    NUMBER,
    ROW,
    TABLE,
    VECTOR,
    compiled,
    inner_kernel,
)
from ..forest import Bases
from ..joints import Joints
from ..proximity.capsules import Capsules
from ..scene import Flags, Index
from ..spatial import Array, Pose

# --- How fast a gap may close: only so fast that the arm can still stop before it is used up ------
#
# v ≤ √(b² + 2 a' d) − b with b = a'·lag + w, where d is the room, less the way w·lag of
# something that comes nearer at w meanwhile; a' a part of the deceleration that the joints have
# along the gap; lag the time that jerk and period take before braking acts.
#
# What news shows to come at u > 0 is made way for. The gap closes at u less the arm's own rate
# away. That may be v(d) at most, and at most √(b₀² + 2 a' (d − u t)) − b₀ with b₀ = a'·lag: from
# there the arm can still come to go aside at u while the other is t away. For news shows late how
# fast it comes, and among several there has to be room to go aside. Where the room is used up, the
# gap is widened at k times by how much, up to `CATCH_UP` u. So a gap that something closes comes to
# rest where it just cannot be lost, and opens again before what was late is. All is continuous in
# d, never less where d is, and v(d) at u = 0. It is a wish: of what the arm does itself, each gap
# may close at v(d). So what is far does not hold the arm before what is near.

BRAKING = 0.7
"""Part a'/A of the deceleration that is counted on."""

RETURN_RATE = 1.0
"""Inside a bound the gap is widened at this rate [1/s], times how far inside it is, or will be
before anything can be done about what comes."""

RETURN_SPEED = 0.02
"""And at most so fast [m/s]."""

ASIDE_RATE = 10.0
"""k: inside the bound to something that comes, the gap is widened at this rate [1/s] …"""

CATCH_UP = 2.0
"""… and at most at so many times the speed at which it comes [1]."""

SOON_S = 1.0
"""t: what comes has to be away by at least so long while the arm can make way [s]."""


class Rows(NamedTuple):
    """Barriers on joint rates: A dq ≥ low."""

    A: Array
    """(m, n)."""
    low: Array
    """What they are to be (m,) [m/s], as well as can be where that is more than `kept`."""
    kept: Array
    """What they are at least (m,) [m/s], 0 at most: standing keeps it."""

    @staticmethod
    def of_all(each: "Sequence[Rows]") -> "Rows":
        """Return several as one."""
        return each[0] if len(each) == 1 else Rows(*map(np.concatenate, zip(*each, strict=True)))

    def concern(self, which: Flags, part: slice) -> bool:
        """Return whether any of those that are flagged (m,) has a slope in some joints."""
        return bool(self.A[which, part].any())

    def broken(self, dq: Array) -> tuple[Flags, bool]:
        """Return which of them (m,) the rates dq (n,) [rad/s] break, and whether any."""
        which = np.empty(len(self.low), dtype=bool)
        return which, _break(self.A, self.low, dq, which) > 0


class Walled(NamedTuple):
    """The tool and the walls around it, planes that its MRF stays above."""

    J: Array
    """Jacobian of the MRF (6, n)."""
    p: Array
    """Where it is (3,) [m]."""
    normals: Array
    """Of the walls, to their free side (w, 3)."""
    heights: Array
    """Along these, where it has no room left (w,) [m]."""


class Braking:
    """Braking ability of n joints, at full or reduced acceleration."""

    def __init__(self, acceleration: Array, jerk: Array, period_s: float) -> None:
        self.acceleration = acceleration
        """The joints' in full (n,) [rad/s²]."""
        self._ramp_s = float((acceleration / jerk).max())
        self._period_s = period_s

    def lag(self, factor: float) -> float:
        """Return the time before braking acts [s]; `factor` scales the acceleration."""
        return 2.0 * (factor * self._ramp_s + self._period_s)

    def rows(
        self,
        slopes: Array,
        room: Array,
        closing: tuple[Array, Array],
        tool: Walled,
        factor: float,
        widen: bool,
    ) -> Rows:
        """Return the barriers of gaps with slopes (k, n) and room (k,) [m].

        `closing` are the speeds (k,) [m/s] at which the other side may come nearer, and at which it
        comes and is made way for. Then those of the walls. With `widen`, a gap
        beyond its bound is widened gently; else it just does not close.
        """
        acceleration, lag = self.acceleration, self.lag(factor)
        count, n = len(slopes) + len(tool.heights), len(acceleration)
        found = Rows(np.empty((count, n)), np.empty(count), np.empty(count))
        _damp(slopes, room, *closing, *tool, acceleration, factor, lag, widen, *found)
        return found


@inner_kernel
def _closing(a: float, b: float, room: float) -> float:
    """Return v ≥ 0 [m/s] for room beyond what comes takes [m]; 0 where there is none."""
    return math.sqrt(b * b + 2.0 * a * max(room, 0.0)) - b


@compiled(
    MATRIX, VECTOR, VECTOR, VECTOR, MATRIX, VECTOR, MATRIX, VECTOR, VECTOR,
    NUMBER, NUMBER, FLAG, TABLE, ROW, ROW,
)  # fmt: skip
def _damp(
    gaps: Array, room: Array, closing: Array, coming: Array,
    J: Array, p: Array, normals: Array, heights: Array,
    acceleration: Array, factor: float, lag: float, widen: bool, slopes: Array, least: Array,
    kept: Array,
) -> None:  # fmt: skip
    """Write slopes (k + w, n) of gaps and walls, and their rates (k + w,) [m/s], see `Rows`.

    The law of this page. Of all motions with one approach speed, the one with the least joint rates
    has the deceleration that is counted on; `factor` times `acceleration` (n,) is the joints'.
    """
    k, n = gaps.shape
    m = k + len(heights)
    for i in range(m):
        if i < k:
            slopes[i], left, comes, u = gaps[i], room[i], closing[i], coming[i]
        else:
            x, y, z = normals[i - k]
            left, comes, u = x * p[0] + y * p[1] + z * p[2] - heights[i - k], 0.0, 0.0
            for j in range(n):
                slopes[i, j] = x * J[0, j] + y * J[1, j] + z * J[2, j]
        size2, slowest = 0.0, 1e-12
        for j in range(n):
            size2 += slopes[i, j] * slopes[i, j]
            slowest = max(slowest, abs(slopes[i, j]) / (factor * acceleration[j]))
        a = BRAKING * size2 / slowest
        b = a * lag + comes
        left -= comes * lag
        least[i] = aside = -_closing(a, b, left)
        if u > 0.0:
            aside = u - min(-aside, _closing(a, a * lag, left + comes * lag - SOON_S * u))
            if left < 0.0:
                aside = max(aside, min(-ASIDE_RATE * left, CATCH_UP * u))
        if widen:
            least[i] += min(RETURN_RATE * max(-left, 0.0), RETURN_SPEED)
        kept[i] = min(least[i], 0.0)
        least[i] = max(least[i], aside)


@compiled(MATRIX, VECTOR, VECTOR, MARKS)
def _break(A: Array, low: Array, dq: Array, broken: Flags) -> int:
    """Write which barriers (m,) the rates dq (n,) break, and return how many."""
    count = 0
    for i in range(len(low)):
        rate = 0.0
        for j in range(len(dq)):
            rate += A[i, j] * dq[j]
        broken[i] = rate < low[i]
        count += broken[i]
    return count


# --- Where the tool's MRF stays: the six walls of a box, and planes, each a gap like any other ----

BETWEEN: Final = 0.002
"""Kept from a wall for what a path dips between two looks at a stop [m]."""


class _Tip(NamedTuple):
    """The MRF on the last body of the chain."""

    T_wrist_mrf: Pose
    p: Array
    """Where it is there (3,) [m]."""
    reach: Array
    """Bounds on its levers (n,) [m]."""


class Walls:
    """The workspace of one cell."""

    def __init__(self, cell: Cell, capsules: Capsules) -> None:
        """Build that of one mechanism's tool; `cell` is the cell of it alone."""
        avoidance, each = cell.config.avoidance, []
        if (box := avoidance.workspace) is not None:
            each += list(zip(np.eye(3), box.low, strict=True))
            each += [(-axis, -x) for axis, x in zip(np.eye(3), box.high, strict=True)]
        for plane in avoidance.tool_planes:
            normal = np.array(plane.normal) / math.hypot(*plane.normal)
            each.append((normal, float(normal @ plane.point)))
        self.given = bool(each)
        self._normals = np.array([normal for normal, _ in each]).reshape(-1, 3)
        self._heights = np.array([height for _, height in each], dtype=np.float64)
        self._barriers = self._heights + avoidance.margin
        self._capsules = capsules
        tip = f"{cell.prefix}{cell.config.mechanism.tip_link}"
        self.body, self._T_last_wrist = capsules.forest.body_of(tip)
        self._tip: _Tip | None = None

    def around(self, J: Array, p: Array) -> Walled:
        """Return the MRF at p (3,), with its Jacobian J (6, n), among the barriers."""
        return Walled(J, p, self._normals, self._barriers)

    def far(self, p: Array, T_wrist_mrf: Pose, way: Array) -> bool:
        """Return whether joints that move by `way` (n,) cannot lead the MRF beyond a wall."""
        return _stays(p, self._normals, self._heights, self._tip_at(T_wrist_mrf).reach, way)

    def violation(self, p: Array, T_wrist_mrf: Pose, q: Array, T_world_base: Bases = None) -> float:
        """Return by how much the MRF is beyond a wall along postures q (s, n) [m]; 0 for not.

        From where it is at p (3,), beyond one, it may only come nearer.
        """
        frames = self._capsules.forest.frames(q, T_world_base)
        heights = np.minimum(self._heights + BETWEEN, self._normals @ p - 1e-4)
        tip = self._tip_at(T_wrist_mrf).p
        return _beyond(frames, self.body - 1, tip, self._normals, heights)

    def _tip_at(self, T_wrist_mrf: Pose) -> _Tip:
        """Return where the MRF is on the chain; it stays there from tick to tick."""
        if self._tip is None or self._tip.T_wrist_mrf is not T_wrist_mrf:
            p = (self._T_last_wrist @ T_wrist_mrf).p
            reach = self._capsules.reach(self.body, math.sqrt(float(p @ p)))
            self._tip = _Tip(T_wrist_mrf, p, reach)
        return self._tip


@compiled(VECTOR, MATRIX, VECTOR, VECTOR, VECTOR)
def _stays(p: Array, normals: Array, heights: Array, reach: Array, way: Array) -> bool:
    """Return whether a point at p (3,) that moves by less than `reach` · `way` crosses no wall."""
    gone = BETWEEN
    for j in range(len(way)):
        gone += reach[j] * way[j]
    nearest = np.inf
    for i in range(len(heights)):
        x, y, z = normals[i]
        nearest = min(nearest, x * p[0] + y * p[1] + z * p[2] - heights[i])
    return gone < nearest


@compiled(ARRAY4, COUNT, VECTOR, MATRIX, VECTOR)
def _beyond(frames: Array, last: int, tip: Array, normals: Array, heights: Array) -> float:
    """Return how far a point of a mechanism is beyond any wall at most [m]; 0 for not.

    `frames` (s, n, 3, 4) are the joints' at s postures; `tip` (3,) is the point in the `last` one
    of the mechanism.
    """
    worst, p = 0.0, np.empty(3)
    for s in range(len(frames)):
        for i in range(3):
            p[i] = frames[s, last, i, 3]
            for k in range(3):
                p[i] += frames[s, last, i, k] * tip[k]
        for i in range(len(heights)):
            x, y, z = normals[i]
            worst = max(worst, heights[i] - (x * p[0] + y * p[1] + z * p[2]))
    return worst


# --- An arm that is held up: it slows as a whole before a joint falls behind out of its window ----
#
# A joint that meets something, or is pushed back by what another one presses the arm into,
# falls behind its command at a rate ė, whatever its own command does. While it does, the whole
# arm slows until ė ≤ √(b² + 2a'd) − b, where d is what is left of the joint's following window,
# less the way until its news has come and gone, and a' and b are those of joint limits: from
# there the command can still stop. A joint beyond its leash is held up already: there no joint
# goes faster than that, but on a way on which it comes back. So a tool that is pressed at
# something unseen ends in rest, not in a following error; and the way back, against the motion
# that pressed it there, is always open.

USED = 0.9
"""Part of the following window that may be used up [1]."""

RETREAT = 0.1
"""So fast the way back may be gone however far a joint is behind [rad/s]."""

FASTER = 3.0
"""While a joint that is held up gets closer, others may go so much faster than it does [1]."""

LATENCY = 3.0
"""Periods until what a command does is seen and answered [1]."""

_STANDS = 1e-7
"""A way of a tick below this is none [rad]."""


@compiled(
    VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, NUMBER,
    ROW,
)  # fmt: skip
def slow(
    dq: Array, now: Array, way: Array, error: Array, before: Array, pressed: Array, leash: Array,
    window: Array, velocity: Array, a: Array, b: Array, period_s: float, against: Array,
) -> tuple[float, int]:  # fmt: skip
    """Return the share of rates dq (n,) [rad/s] that is left, and who decides.

    `pressed` anew is written to `against` (n,), zeros before.

    Joints are told to go at `now` (n,), and went the `way` (n,) [rad] in the tick whose effect is
    seen; command − joint is `error` (n,) [rad], and was `before` a period ago. `leash` and `window`
    (n,) [rad] are its bounds, `velocity` (n,) those of speeds, `a` and `b` (n,) the braking that is
    counted on.
    """
    n = len(dq)
    asked = moving = gone = farthest = falling = 0.0
    for j in range(n):
        behind = 2.0 * abs(error[j]) / leash[j] - 1.0
        asked, moving = max(asked, abs(dq[j])), max(moving, abs(now[j]))
        gone, farthest = max(gone, abs(way[j])), max(farthest, behind)
        if behind > 0.0:
            falling = max(falling, abs(error[j]) - abs(before[j]))
    along = 0.0
    for j in range(n):
        if farthest > 0.0:
            against[j] = way[j] if falling > 0.0 and gone > _STANDS else pressed[j]
        along += against[j] * dq[j]
    most, which = asked, -1
    for j in range(n):
        behind = abs(error[j])
        growth = (behind - abs(before[j])) / period_s
        left = USED * window[j] - behind - LATENCY * period_s * max(0.0, growth)
        allowed = math.sqrt(b[j] ** 2 + 2.0 * a[j] * max(0.0, left)) - b[j]
        bound = most
        if growth > allowed:
            bound = allowed / growth * moving
        beyond = min(1.0, 2.0 * behind / leash[j] - 1.0)
        if beyond > 0.0:
            free = (1.0 - beyond) * velocity[j] + FASTER * max(0.0, -growth)
            bound = min(bound, allowed + free)
            if along <= 0.0:
                bound = max(bound, RETREAT)
        if bound < most:
            most, which = bound, j
    return most / max(asked, 1e-12) if which >= 0 else 1.0, which


# --- How fast each joint may go, given the room ahead of it: joint limits and the leash -----------
#
# A joint may approach a limit only as fast as it can still stop before it: v ≤ √(b² + 2 a' d) −
# b with b = a'·lag, d the room, a' a part of the deceleration, and lag the time that jerk and
# period take before braking acts. The leash slows a command that runs ahead of its joint, from
# half its length on. Motion away is always free. A joint that stands outside its limits may
# stay there or come in, and is not led: enabling an arm moves nothing.


class Room(NamedTuple):
    """Bounds on joint rates (n,) [rad/s], and which joint is near what."""

    low: Array
    high: Array

    def left_by(self, dq: Array) -> list[int]:
        """Return the joints whose rates dq (n,) [rad/s] are outside."""
        outside: list[int] = _outside(dq, self.low, self.high).tolist()
        return outside


class Within(NamedTuple):
    """Joint rates inside their speed bounds, and the bounds that all barriers of joints set."""

    dq: Array
    """All scaled by one share (n,) [rad/s]."""
    share: float
    low: Array
    """Never above `high` (n,) [rad/s]."""
    high: Array
    beyond: bool
    """True where dq is not inside these."""


class JointLimits:
    """Rate bounds from position limits and from the leash, for n joints."""

    def __init__(self, joints: Joints, period_s: float) -> None:
        """Build it for the joints of one mechanism."""
        self._lower, self._upper = joints.lower, joints.upper
        self._a = BRAKING * joints.acceleration
        self._b = self._a * 2.0 * (joints.acceleration / joints.jerk + period_s)
        self._velocity = joints.velocity
        self._leash = joints.leash
        # A window that is wider is for joints that a collision throws back, not for commands.
        self._window = np.minimum(joints.following_window, 2.0 * joints.leash)
        self._period_s = period_s

    def within(self, dq: Array, most: Array, q: Array, error: Array) -> Within:
        """Return rates dq (n,) scaled to the bounds `most` (n,), and what all bounds allow.

        `q` (n,) and what the command is ahead of the joints, `error` (n,), set the others.
        """
        scaled, low, high = np.empty(len(q)), np.empty(len(q)), np.empty(len(q))
        share, beyond = _bound(
            dq, most, q, self._lower, self._upper, self._a, self._b,
            error, self._leash, self._velocity, scaled, low, high,
        )  # fmt: skip
        return Within(scaled, share, low, high, beyond)

    def resisted(
        self, dq: Array, now: Array, way: Array, error: Array, memory: Resistance | None
    ) -> tuple[float, int, Resistance]:
        """Return the share of rates dq (n,) that is left, so that joints keep their windows.

        And the joint that decides, −1 for none, and what to remember.
        Joints go at `now` (n,), and went the `way` (n,) in the tick whose effect is seen; the
        command is ahead of them by `error` (n,).
        """
        if memory is None:
            return 1.0, -1, Resistance(error, np.zeros(len(error)))
        pressed = np.zeros(len(error))
        share, joint = slow(
            dq, now, way, error, *memory, self._leash, self._window, self._velocity,
            self._a, self._b, self._period_s, pressed,
        )  # fmt: skip
        return share, joint, Resistance(error, pressed)

    def approach(self, room: Array) -> Array:
        """Return the greatest rate (n,) towards a bound that is `room` (n,) [rad] away.

        It is 0 beyond the bound, where `room` is negative.
        """
        return _approach(room, self._a, self._b)

    def limits(self, q: Array) -> Room:
        """Return the rate bounds that joint limits set at q (n,) [rad]."""
        return Room(-self.approach(q - self._lower), self.approach(self._upper - q))

    def leash(self, following_error: Array) -> Room:
        """Return the rate bounds that the leash sets; `following_error` is command − joint."""
        low, high = np.empty(len(following_error)), np.empty(len(following_error))
        _leash(following_error, self._leash, self._velocity, low, high)
        return Room(low, high)


@compiled(VECTOR, VECTOR, VECTOR)
def _approach(room: Array, a: Array, b: Array) -> Array:
    out = np.empty(len(room))
    for j in range(len(room)):
        if room[j] >= 0.0:
            out[j] = math.sqrt(b[j] ** 2 + 2.0 * a[j] * room[j]) - b[j]
        else:
            out[j] = 0.0
    return out


@compiled(VECTOR, VECTOR, VECTOR, ROW, ROW)
def _leash(error: Array, leash: Array, velocity: Array, low: Array, high: Array) -> None:
    # Beyond the leash a command may stand still: the drive, not the command, comes back.
    for j in range(len(error)):
        ahead = error[j] / leash[j]
        low[j] = -velocity[j] * min(1.0, max(0.0, 2.0 * (1.0 + ahead)))
        high[j] = velocity[j] * min(1.0, max(0.0, 2.0 * (1.0 - ahead)))


@compiled(
    VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, ROW, ROW, ROW
)
def _bound(
    dq: Array, most: Array, q: Array, lower: Array, upper: Array, a: Array, b: Array,
    error: Array, leash: Array, velocity: Array, scaled: Array, low: Array, high: Array,
) -> tuple[float, bool]:  # fmt: skip
    """Write the arrays of `Within`, and return its share and whether its rates are beyond."""
    n = len(q)
    fastest = 1.0
    for j in range(n):
        ratio = abs(dq[j]) / most[j]
        if not ratio <= fastest:  # what is not a number is not hidden
            fastest = ratio
    share = 1.0 / fastest
    below, above = np.empty(n), np.empty(n)
    for j in range(n):
        below[j], above[j] = q[j] - lower[j], upper[j] - q[j]
    below, above = _approach(below, a, b), _approach(above, a, b)
    _leash(error, leash, velocity, low, high)
    beyond = False
    for j in range(n):
        scaled[j] = share * dq[j]
        if abs(scaled[j]) > most[j]:  # by rounding, which is no reason to name a limit
            scaled[j] = math.copysign(most[j], scaled[j])
        least = max(-below[j], low[j], -most[j])
        greatest = min(above[j], high[j], most[j])
        low[j], high[j] = min(least, greatest), max(least, greatest)
        beyond = beyond or scaled[j] < low[j] or scaled[j] > high[j]
    return share, beyond


@compiled(VECTOR, VECTOR, VECTOR)
def _outside(dq: Array, low: Array, high: Array) -> Index:
    found, count = np.empty(len(dq), dtype=np.int64), 0
    for j in range(len(dq)):
        if dq[j] < low[j] or dq[j] > high[j]:
            found[count] = j
            count += 1
    return found[:count].copy()
