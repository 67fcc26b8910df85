"""An arm in HOLD or that nobody tells to move: what pushes it, its retreat, and its making way."""

import math
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from ...config.schema.surroundings import AvoidanceSection
from .compiled import NUMBER, VECTOR, compiled
from .inputs import ObjectiveGains, Pushed
from .proximity.capsules import Capsules, Placed
from .scene import Flags
from .spatial import Array, Pose, pose_error, sizes
from .stop.profile import Stop

# --- Forces that push an arm in HOLD: estimated at its joints, or seen by a sensor ----------------

RELEASE = 0.7
"""A joint, or the tool, is pushed no longer below this part of its bound [1]."""

NEW = 0.5
"""Contact that the sensor sees came with the touch where more than this part of it is new [1]."""


def released(pushed: Pushed) -> bool:
    """Return whether nothing pushes the joints any more."""
    return not beyond(pushed.external, pushed).any()


def tool_released(pushed: Pushed) -> bool:
    """Return whether the tool is no longer pushed by more than before it was touched.

    The weight of a payload that was told wrong is the same before and after, in World axes; its
    inertia reads like a push whenever the arm begins to give way or ends.
    """
    if pushed.tool_bound is None or pushed.steady is None or pushed.free_wrench is None:
        return True
    return sizes(pushed.steady - pushed.free_wrench)[0] <= RELEASE * pushed.tool_bound


def tool_push(pushed: Pushed, new: Array) -> Array:
    """Return the joint torques (n,) of the tool's contact: `new` as long as it lasts [N·m]."""
    return np.zeros(len(new)) if tool_released(pushed) else new


def beyond(torque: Array, pushed: Pushed) -> Array:
    """Return by how much torques (n,) are beyond what releases each joint (n,) [N·m]."""
    rest = np.abs(torque) - pushed.excused - RELEASE * pushed.bound
    return np.asarray(np.sign(torque) * np.maximum(rest, 0.0))


def leads_into(dq: Array, pushed: Pushed) -> bool:
    """Return whether rates dq (n,) lead into what pushes unseen."""
    return -float(pushed.external @ dq) > magnitude(dq * (pushed.bound + pushed.excused))


def seen_torques(pushed: Pushed, J: Array) -> tuple[Array, Array]:
    """Return the joint torques (n,) of contact that the sensor sees, and what came with the touch.

    What it reads by a payload or a bias that is wrong was there before.
    """
    if pushed.wrench is None:
        return np.zeros(J.shape[1]), np.zeros(J.shape[1])
    now = pushed.wrench @ J
    return now, now - pushed.free_wrench @ J if pushed.free_wrench is not None else 0.0 * now


def relieves(dq: Array, seen: Array, new: Array, pushed: Pushed) -> bool:
    """Return whether rates dq (n,) give way to contact that the sensor saw with the touch."""
    return float(new @ dq) > max(magnitude(dq * pushed.bound), NEW * float(seen @ dq))


def magnitude(x: Array) -> float:
    """Return the Euclidean norm."""
    return math.sqrt(float(x @ x))


# --- In HOLD after a touch, the arm goes back along the way it came until nothing pushes it -------
#
# The commanded path is remembered in steps of some milliradians. The last `LOOKBACK_S` of it
# before the touch, and what the stop added, is taken back at once: there the arm was free. From
# there on the estimated torques decide (`clearance.py`). While a joint is pushed, the arm goes
# on back along its path; where the push leads off the path, as that of a wall does along which
# the arm has slid, it goes where it is pushed, but not forward again.
#
# The motion goes one way only, is slow, and ends with the push, where another one is met, or
# when its joints have used up their leash, each its own, from where the push was felt: an
# estimate that is wrong makes it neither swing nor drift.

STEP = 2e-3
"""The path is remembered in steps of this, by the joint that moves most [rad]."""

LOOKBACK_S = 0.2
"""Contact began at most this long before it was felt [s]: low-pass, confirmation, soft walls."""

FASTEST, SLOWEST = 0.2, 0.05
"""Rates of the joint that moves most, back to where the arm was free and from there on [rad/s]."""

WITHIN_S = 0.5
"""A longer way back to where the arm was free is gone faster than that: within so long [s]."""

APPROACH = 8.0
"""Rate per distance, to where the arm was free and to the end of the leash [1/s]."""

USED_UP = 0.02
"""Part of the leash that is left when it counts as used up [1]."""

ALONG = 0.3
"""A push along the path: cosine between it and the way back, in joint space [1]."""

OPPOSED_S = 0.05
"""Another push must last so long to end the retreat [s]."""

RELIEVED_S = 0.5
"""Relief that began so long ago, and is over, is no part of a touch [s]."""

UNSEEN_S = 0.03
"""Contact began at most this long before force control relieved it [s]."""

YIELDS = 0.8
"""A joint that is pushed off its command by more than this part of its leash is yielded to [1]."""

YIELD_GAIN = 20.0
"""So quickly the command goes after it [1/s]."""

ACROSS = 0.1
"""Bleeding off goes forward on the path where the cosine between them is above this [1]."""


NOWHERE: Final[Array] = np.zeros(0)
"""Travel of an arm that nothing pushed."""
NOWHERE.flags.writeable = False


class RetreatState(NamedTuple):
    """The way that led here, and how far it was gone back."""

    way: tuple[Array, ...] = ()
    """Commanded postures (n,), newest last [rad]."""
    at_s: tuple[float, ...] = ()
    """When each was passed [s]."""
    felt_s: float | None = None
    """When the push was felt [s]; None before."""
    q: Array | None = None
    """Command (n,) one tick ago, while the arm gives way [rad]; None before."""
    overrun: int = 0
    """Postures until one of a time when the arm was free [1]."""
    ahead: int = 0
    """Postures until the one at which the push was felt [1]: the stop went beyond it."""
    travelled: Array = NOWHERE
    """How far each joint has gone from there (n,) [rad]; empty before the push."""
    stride: float = STEP
    """How far the postures until then are apart [rad]."""
    fastest: float = FASTEST
    """Rate of the joint that moves most, back to where the arm was free [rad/s]."""
    opposed_s: float = 0.0
    """How long another push has been in the way [s]."""
    rate: float = 0.0
    """Rate asked for [rad/s]."""
    off_path: bool = False
    """The rates asked for lead off the way; then `way` goes along beside the command."""
    shifted: bool = False
    """It ever did: the arm was never where `way` is now."""
    relieved_s: float | None = None
    """When force control began to relieve contact of joints that are commanded themselves [s].

    That leads off the way, which is kept as it was then: back along it would press on again.
    """


class Retreat:
    """Gives way after a touch; `leash` is the longest travel of a joint [rad].

    An arm that is `bound` to its path, as one in tunnels is, goes back along it and nowhere else.
    Joints that do not give way (n,) stand, and are no part of the path: an axis that sweeps.
    """

    def __init__(
        self,
        leash: float,
        period_s: float,
        bound: bool = False,
        gives_way: Flags | None = None,
    ) -> None:
        self.leash, self._bound = leash, bound
        self._stands = None if gives_way is None or gives_way.all() else ~gives_way
        self._T = period_s
        self._kept = 16 + math.ceil(leash / STEP)
        self.start = RetreatState()

    def step(
        self,
        state: RetreatState,
        q: Array,
        dq: Array,
        J: Array,
        pushed: Pushed | None,
        time_s: float,
        held: bool,
        relieving: bool = False,
        held_up: Array | float = 0.0,
    ) -> tuple[RetreatState, Array]:
        """Return the rates to ask for, `dq` (n,) with the retreat added [rad/s].

        q (n,) is the command [rad], J (6, n) the MRF's Jacobian there, in World axes, and `dq` what
        bleeding off asks for while the arm is `held`. Force control is `relieving` contact that
        commanded joints press on. `held_up` (n,) is the sign of the error of joints that are far
        behind their command, 0 for others.
        """
        if self._stands is not None:
            q = np.where(self._stands, 0.0, q)
        if not held or pushed is None or not pushed.touched:
            if held and pushed is not None and leads_into(dq, pushed):
                dq = np.zeros_like(dq)
            return self._remembered(state, q, pushed, time_s, relieving), dq
        state = _moved(self._begun(state, q, time_s), q)
        seen, new = seen_torques(pushed, J)
        tool = tool_push(pushed, new)
        back = _way_back(state, q)
        if back is not None and not self._bound:
            state, back = _unopposed(state, q, back, tool, pushed, held_up)
        state, way = self._direction(state, q, back, new, tool, pushed)
        if leads_into(dq, pushed) or (_forward(dq, back) and not relieves(dq, seen, new, pushed)):
            dq = np.zeros_like(dq)
        if self._stands is not None:
            way = np.where(self._stands, 0.0, way)
        return state._replace(q=q), dq + state.rate * way

    def yielded(
        self, state: RetreatState, dq: Array, error: Array, leash: Array
    ) -> tuple[RetreatState, Array]:
        """Return rates (n,) that let what holds joints far off their commands lead these on.

        What comes on for longer than the arm goes back by itself pushes its joints against all
        their torque. Their commands go where they are pushed, and no further: that takes no
        estimate, and ends with the push. `error` (n,) is command − joint, `leash` (n,) its bound
        [rad].
        """
        if state.q is None or self._bound:
            return state, dq
        beyond = np.maximum(np.abs(error) - YIELDS * leash, 0.0)
        if self._stands is not None:
            beyond = np.where(self._stands, 0.0, beyond)
        if not beyond.any():
            return state, dq
        rate, ahead = YIELD_GAIN * beyond, np.sign(error)
        dq = np.where(beyond > 0.0, -ahead * np.maximum(rate, -ahead * dq), dq)
        return state._replace(off_path=True, shifted=True), dq

    def _remembered(
        self,
        state: RetreatState,
        q: Array,
        pushed: Pushed | None,
        time_s: float,
        relieving: bool,
    ) -> RetreatState:
        """Return the state with the command's path in it."""
        if state.q is not None:
            state = self.start if state.shifted else RetreatState(state.way, state.at_s)
        felt = pushed is not None and pushed.touched
        if felt != (state.felt_s is not None):
            state = state._replace(felt_s=time_s if felt else None)
        if relieving and state.relieved_s is None:
            state = state._replace(relieved_s=time_s)
        elif state.relieved_s is not None and not (relieving or felt):
            lately = time_s - state.relieved_s <= RELIEVED_S
            state = state if lately else state._replace(relieved_s=None)
        if state.relieved_s is not None or (state.way and not _apart(q, state.way[-1], STEP)):
            return state
        way, at_s = state.way[1 - self._kept :], state.at_s[1 - self._kept :]
        return RetreatState((*way, q), (*at_s, time_s), *state[2:])

    def _begun(self, state: RetreatState, q: Array, time_s: float) -> RetreatState:
        """Return the state of an arm that gives way: how far back it certainly goes."""
        if state.q is not None:
            return state
        if state.relieved_s is not None:
            free = sum(at_s <= state.relieved_s - UNSEEN_S for at_s in state.at_s)
            state = state._replace(
                way=state.way[:free], at_s=state.at_s[:free], felt_s=state.relieved_s
            )
        free_s = (time_s if state.felt_s is None else state.felt_s) - LOOKBACK_S
        since = sum(at_s > free_s for at_s in state.at_s)
        overrun = min(since + 1, len(state.way)) if since else 0
        ahead = 0 if state.felt_s is None else sum(at_s >= state.felt_s for at_s in state.at_s)
        way = _length(q, state.way[::-1][:overrun])
        return state._replace(
            q=q,
            travelled=np.zeros(len(q)),
            overrun=overrun,
            ahead=min(ahead, overrun),
            stride=way / max(1, overrun),
            fastest=max(FASTEST, way / WITHIN_S),
        )

    def _direction(
        self,
        state: RetreatState,
        q: Array,
        back: Array | None,
        new: Array,
        tool: Array,
        pushed: Pushed,
    ) -> tuple[RetreatState, Array]:
        """Return the state with the rate to give way at, and the direction (n,) for that rate."""
        none = np.zeros(len(q))
        push = beyond(pushed.external, pushed) + tool
        state = state._replace(rate=0.0, off_path=False)
        if back is not None:
            needed = magnitude(back * (pushed.bound + pushed.excused))
            met = min(float(pushed.external @ back), float(new @ back))
            opposed = met < -needed
            state = state._replace(opposed_s=state.opposed_s + self._T if opposed else 0.0)
        spent = state.travelled > (1.0 - USED_UP) * self.leash
        if self._bound and spent.any():
            return state, none
        left = APPROACH * np.maximum(self.leash - state.travelled, 0.0)
        along = back is not None and float(push @ back) > ALONG * magnitude(push) * magnitude(back)
        along = along or self._bound
        if (
            back is not None
            and not spent.any()
            and (state.overrun > 0 or (along and pushed.lasting))
        ):
            if state.opposed_s > OPPOSED_S and not self._bound:
                return state, none
            rate = SLOWEST
            if state.overrun > 0:
                to_go = float(np.abs(state.way[-1] - q).max()) + (state.overrun - 1) * state.stride
                rate = min(max(APPROACH * to_go, SLOWEST), state.fastest)
            return state._replace(rate=min(rate, float(left.min()))), back
        way = None if self._bound else _off_path(pushed, tool, back, spent)
        if way is None:
            return state, none
        rate = min(FASTEST, SLOWEST * _strength(push, pushed))
        # A joint at the end of its leash stands, and the others give way further.
        way = np.clip(way, -left / rate, left / rate)
        return state._replace(rate=rate, off_path=True, shifted=True), way


def _strength(push: Array, pushed: Pushed) -> float:
    """Return how hard a push (n,) [N·m] is, in bounds of the joint that it is hardest for; from 1.

    What comes on is given way to the quicker, the harder it pushes: at one rate for all it would
    overtake the arm. Not where the tool was touched, which a stiff wall throws off within a tick or
    two: at such a rate what is left of the joints' estimate would lead it back into the wall.
    """
    if pushed.tool_bound is not None:
        return 1.0
    return max(1.0, float((np.abs(push) / pushed.bound).max()))


def _moved(state: RetreatState, q: Array) -> RetreatState:
    """Return the state without what of the way was gone back by now."""
    way, travelled = state.way, state.travelled
    if state.q is not None and state.rate > 0.0:
        travelled = travelled + np.abs(q - state.q)
    if state.q is not None and state.off_path:
        way = tuple(posture + (q - state.q) for posture in way)
    while way and _passed(way, q):
        way = way[:-1]
    passed = len(state.way) - len(way)
    if state.ahead > passed:
        travelled = np.zeros(len(q))
    elif state.ahead > 0:
        travelled = np.abs(q - state.way[-state.ahead])
    return state._replace(
        way=way,
        at_s=state.at_s[: len(way)],
        overrun=max(0, state.overrun - passed),
        ahead=max(0, state.ahead - passed),
        travelled=travelled,
    )


def _length(q: Array, way: tuple[Array, ...]) -> float:
    """Return the length of a way from q (n,) [rad], by the joint that moves most."""
    return sum(float(np.abs(a - b).max()) for a, b in pairwise((q, *way)))


def _passed(way: tuple[Array, ...], q: Array) -> bool:
    """Return whether the newest posture (n,) of the way is reached, or lies behind q (n,)."""
    if not _apart(q, way[-1], 0.25 * STEP):
        return True
    return len(way) > 1 and float((q - way[-1]) @ (way[-2] - way[-1])) > 0.0


def _way_back(state: RetreatState, q: Array) -> Array | None:
    """Return the direction (n,) of the way back, 1 for the joint that moves most."""
    if not state.way:
        return None
    way = state.way[-1] - q
    return np.asarray(way / np.abs(way).max())


def _unopposed(
    state: RetreatState, q: Array, back: Array, tool: Array, pushed: Pushed, held_up: Array | float
) -> tuple[RetreatState, Array]:
    """Return the direction `back` (n,) without the joints that would press on.

    `tool` (n,) is what the tool's contact turns them with [N·m]. A tool that came straight presses
    one joint back and another one forth: that may have met its torque limit, or the end of its
    leash, and would hold up all. So would a joint that contact of a link has `held_up` (n,), and
    that the way leads further ahead. So the rest of the way leads on from where it is.
    """
    out = held_up * back > 0.0
    if float(tool @ back) > 0.0:
        out |= -tool * back > pushed.bound * np.abs(back)
    if not out.any():
        return state, back
    off, free = np.where(out, q - state.way[-1], 0.0), np.where(out, 0.0, back)
    state = state._replace(way=tuple(posture + off for posture in state.way), shifted=True)
    return state, free / max(float(np.abs(free).max()), 1e-12)


def _forward(dq: Array, back: Array | None) -> bool:
    """Return whether rates dq (n,) lead forward on the path, away from the way `back` (n,)."""
    return back is not None and -float(dq @ back) > ACROSS * magnitude(dq) * magnitude(back)


def _off_path(pushed: Pushed, tool: Array, back: Array | None, spent: Flags) -> Array | None:
    """Return where the arm is pushed off its path (n,), 1 for the joint that moves most.

    Only what was not felt before the touch counts: the weight of a payload that nobody told of
    would lead down, whatever is there. `tool` (n,) is what came of the tool's [N·m]. Joints
    whose leash is `spent` (n,) stand. None where there is no such push, or it leads forward.
    """
    if pushed.free is None or not pushed.lasting:
        return None
    # Of joints that are pushed alike against their bounds, a weak one gives way no less.
    push = (beyond(pushed.external - pushed.free, pushed) + tool) / pushed.bound
    push = np.where(spent, 0.0, push)
    size = magnitude(push)
    if size == 0.0:
        return None
    if back is not None and float(push @ back) < 0.0:
        push = push - back * (float(push @ back) / float(back @ back))
    return push / float(np.abs(push).max()) if magnitude(push) > ALONG * size else None


@compiled(VECTOR, VECTOR, NUMBER)
def _apart(a: Array, b: Array, by: float) -> bool:
    """Return whether two postures (n,) are at least so far apart in one joint [rad]."""
    most = 0.0
    for j in range(len(a)):
        most = max(most, abs(a[j] - b[j]))
    return most >= by


# --- An arm that nobody tells to move: whether it makes way for what comes, how far, and its way
# back
#
# Obstacles' news needs no lease. So an arm that stands goes out of the way only as its cell
# says, no part of it further than a reach from where it was told to stand, and comes back when
# it can.

BACK_GAIN: Final = 2.0
"""Way back, close to where the arm was told to stand [1/s]."""

BACK_SPEED: Final = 0.1
"""The tool comes back no faster than this [m/s]: nobody looks."""

BACK_RATE: Final = 0.3
"""And no joint faster than this part of its greatest speed [1]."""

LAST_PART: Final = 0.25
"""In the last part of its reach an arm makes way ever slower [1]."""

HOME: Final = 2e-4
"""An arm is back within this angle of every joint [rad] …"""

HOME_M: Final = 1e-3
"""… or, where a goal leads its tool back, within this distance [m]."""

MOVED: Final = 1e-4
"""Self-motion below this leads nowhere [rad/s]."""

OUTSIDE: Final = ("field", "spheres")
"""Objectives that look at obstacles: they act on an arm at a posture, too."""


class Station(NamedTuple):
    """Where an arm was told to stand that has left there to make way."""

    q: Array
    """Posture (n,) [rad]."""
    T_world_mrf: Pose
    """The MRF there."""
    ends: Array | None
    """Ends of its capsules (c, 2, 3) in World [m]; None where its shape is not known."""


class Stance(NamedTuple):
    """How an arm meets what comes, in one tick."""

    makes_way: float
    """Part of the speed of what comes that it makes way at, 0 to 1."""
    tool_stays: bool
    """It makes way by self-motion alone."""
    alert: bool
    """It stands, and may leave: its station is kept."""
    station: Station | None


COMMANDED: Final = Stance(1.0, False, False, None)
"""An arm that is told to move makes way as fast as what comes."""

STANDS: Final = Stance(0.0, True, False, None)
"""It stands, whatever comes."""


class Standing:
    """Decides how one arm that stands meets what comes."""

    def __init__(self, section: AvoidanceSection, capsules: Capsules | None, velocity: Array):
        """Build it; joints go at most at `velocity` (n,) [rad/s]."""
        self._section, self._capsules, self._velocity = section, capsules, velocity
        self._outside: tuple[ObjectiveGains, ObjectiveGains] | None = None

    def may_leave(self, moving: bool, held: bool) -> bool:
        """Return whether the cell lets an arm leave that stands in ENABLED, or is held in HOLD."""
        section = self._section
        return section.standing != "stand" and (moving or (held and section.standing_in_hold))

    def stance(self, station: Station | None, q: Array, placed: Placed | None) -> Stance:
        """Return how an arm at q (n,) [rad] meets what comes, where it may leave."""
        tool_stays = self._section.standing == "self_motion"
        if station is None:
            return Stance(1.0, tool_stays, True, None)
        left = 1.0 - self._moved(station, q, placed) / self._section.standing_reach
        return Stance(min(1.0, max(0.0, left / LAST_PART)), tool_stays, True, station)

    def begun(self, stop: Stop, T_world_mrf: Pose) -> Station:
        """Return the station of an arm that leaves: where its stop would end.

        Its tool is to stay where it is now.
        """
        q = stop.at(stop.to_go_s).q
        ends = None if self._capsules is None else self._capsules.place(q[None]).ends[0]
        return Station(q, T_world_mrf, ends)

    def back(self, station: Station, q: Array, J: Array, factor: float) -> Array:
        """Return the joint rates (n,) from q (n,) back to the station [rad/s].

        J (6, n) is the tool's, `factor` the reduced-speed setting.
        """
        error = station.q - q
        size = float(np.abs(error / self._velocity).max())
        rate = min(BACK_GAIN, factor * BACK_RATE / max(size, 1e-12))
        speed = rate * float(np.linalg.norm(J[:3] @ error))
        return np.asarray(rate * min(1.0, factor * BACK_SPEED / max(speed, 1e-12)) * error)

    def tool_back(self, station: Station, T_world_mrf: Pose) -> Array:
        """Return the twist (6,) of the MRF back to the station."""
        twist = BACK_GAIN * pose_error(station.T_world_mrf, T_world_mrf)
        size = float(np.abs(twist).max())
        return np.asarray(twist * min(1.0, BACK_SPEED / max(size, 1e-12)))

    def is_home(self, station: Station, q: Array, p: Array, led: bool) -> bool:
        """Return whether an arm at q (n,), its MRF at p (3,), is back.

        `led` says that a goal leads its tool.
        """
        if led:
            return math.dist(p, station.T_world_mrf.p) < HOME_M
        return float(np.abs(station.q - q).max()) < HOME

    def of_outside(self, objectives: ObjectiveGains) -> ObjectiveGains:
        """Return gains of which only those that look at obstacles are left."""
        if self._outside is None or self._outside[0] is not objectives:
            gains = {
                name: gain if name in OUTSIDE else 0.0 for name, gain in objectives.gains.items()
            }
            self._outside = objectives, objectives._replace(gains=gains)
        return self._outside[1]

    def _moved(self, station: Station, q: Array, placed: Placed | None) -> float:
        """Return how far any part of the arm is from where it was told to stand [m]."""
        if station.ends is None or self._capsules is None:
            return 0.0
        ends = (placed or self._capsules.place(q[None])).ends[0]
        return math.sqrt(float(((ends - station.ends) ** 2).sum(axis=2).max()))
