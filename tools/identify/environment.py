"""Stiffness and delay of what a tool touches, by gentle presses; gains for it, with their margins.

The tool is pressed by force control with a gain so low that it cannot bounce, up and down between
two forces. At each the command stands until the force is steady, for force control and friction in
the joints would hunt for ever. Stiffness is the change of the steady force for that of the measured
depth. It holds all that gives way outside of the
drives' encoders: what is touched, the tool, the sensor, links, and gears where the encoders sit on
the motors. What joints sag by against their drives is measured with them, and is not part of it.

The delay is what is seen at that pace, in two parts: measured depth behind the commanded one on the
way through the air, and the force behind the measured depth. Drives are slower to turn than to go
on, so the cell's own model, which `check` judges by, may tell more; the greater one counts.
"""

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np

from ...config.errors import ConfigError
from ...config.load import Cell, altered
from ...protocols import topics as t
from ...protocols.messages import requests
from ...protocols.messages.telemetry import State, TaskState
from ...server.control.spatial import Array, rotation_rpy
from ...server.stability.judgement import LoopBounds
from ...server.stability.loops import ForceLoop, bound
from ..client.protocol_client import NoLease, ProtocolClient, ignore
from .estimate import NotIdentified


# --- Who leads an arm, on a daemon or in virtual time: a course that goes on with every state -----
class GaveUpError(Exception):
    """A course cannot go on: says why."""


Course = Generator[None, None, None]
"""Steps of a course: it does what is to be done at a state, and yields until the next one."""


@dataclass
class Leader(ABC):
    """Base of what leads one arm, told of every state: it knows no clock but that of the states."""

    client: ProtocolClient
    say: Callable[[str], None] = field(default=ignore, kw_only=True)
    """Told, in a line, how far it is."""
    mechanism: str | None = field(default=None, kw_only=True)  # the arm's name; None: the only one
    task: str | None = field(default=None, kw_only=True)
    failure: str = field(default="", init=False)  # reason of a failure
    over: bool = field(default=False, init=False)
    _restores: bool = field(default=False, init=False)
    """True once the rest of the course needs no arm that is enabled."""
    _asked_seq: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._steps = self._course()

    def run(self, state: State) -> None:
        """Take in a state, and lead on."""
        if self.over:
            return
        self._state, self._told = state, state.of(self.task)
        try:
            if state.mode == "enabled" or self._restores:
                next(self._steps)
            else:
                self._steps.throw(GaveUpError(f"mode became {state.mode}"))
        except StopIteration:
            self._end(self.failure)
        except (GaveUpError, NoLease) as error:
            self._end(str(error))

    def checked(self) -> Self:
        """Return it once it has led to the end. Raises `NotIdentified` where it could not."""
        if self.failure or not self.over:
            raise NotIdentified(self.failure or "it took too long")
        return self

    @abstractmethod
    def _course(self) -> Course:
        """Lead the arm from its first state to the end. Raises `GaveUpError`."""

    def _later(self, since_s: float, seconds: float) -> bool:
        """Return whether it is later than so long after a time [s]."""
        return self._state.time_s > since_s + seconds

    def _to(self, **posture: object) -> None:
        """Send the arm to a posture."""
        self.client.command(t.POSTURE, mechanism=self.mechanism, **posture)
        self._asked_seq = self.client.seq

    def _arriving(self, topic: t.Topic, within_s: float) -> Generator[None, None, bool]:
        """Wait from the next state on until a goal is reached; return whether it was in time."""
        since_s = self._state.time_s
        yield
        while self._state.last_seq.get(topic.key, 0) < self._asked_seq or not self._told.at_goal:
            if self._later(since_s, within_s):
                return False
            yield
        return True

    def _end(self, why: str) -> None:
        self.failure, self.over = why, True


# --- The presses ----------------------------------------------------------------------------------
APPROACH_SPEED = 1e-3  # through free space [m/s]
APPROACH_GAIN = 1e-4  # K_F until the stiffness is known about; stable to 300 kN/m and more [m/s/N]
SETTLES_S = 0.25  # time constant of the force in the presses [s]
LOW = 1.0 / 3.0  # the lighter press' part of the harder one [1]
PRESSES = 3  # so often it goes from the lighter press to the harder one [1]
BOUND = 1.5  # a force beyond so many of the harder press ends it [1]
REST_S = 0.5  # noise and offset are read for so long before the tool moves [s]
NEAR = 0.1  # the command stands once the force is so near, of the harder press [1]
STAND_S = 0.4  # and has stood for so long before the force is believed [s]
WINDOW_S = 0.6  # a steady force is averaged over so long [s]
SETTLE_S = 30.0  # what is not steady by then will not be [s]
TOUCHED = 6.0  # contact is a force of so many standard deviations of the noise, [1]
LEAST_N = 1.0  # and of so much at least [N]
OFFSET_N = 3.0  # the sensor may read so much in the air [N]
BOUNCES = 3  # so often contact may be lost at the first touch [1]
SET_OUT = 5e-4  # after so long a way the joints show which way they go [m]
LEAST_WAY = 20  # so many states on the way through the air tell how late joints are [1]
RETURN_SPEED = 0.01  # [m/s]
ARRIVE_S = 60.0  # a posture, or the way back, takes no longer [s]


class Along(NamedTuple):
    """An axis of the MRF, and which way along it."""

    axis: int
    sign: float

    @classmethod
    def of(cls, name: str) -> "Along":
        """Return it by its name, such as "z" or "-x"."""
        return cls("xyz".index(name[-1]), -1.0 if name.startswith("-") else 1.0)


@dataclass(frozen=True)
class Press:
    """What is asked for."""

    along: Along
    way: float  # contact is looked for no further than this [m]
    force: float  # of the harder press [N]
    posture: str | None = None  # from which it sets out; None: from where the arm stands


class Sample(NamedTuple):
    """One state along the press."""

    time_s: float
    tick: int
    force: float  # less the offset in the air [N]
    commanded: float  # depth from where it set out [m]
    measured: float  # [m]


@dataclass(frozen=True)
class Steady:
    """Means over a steady press."""

    force: float  # [N]
    commanded: float  # depth [m]
    measured: float  # [m]


@dataclass
class PressGuide(Leader):
    """Presses a tool against what is before it."""

    press: Press
    steady: list[Steady] = field(default_factory=list)
    way: list[Sample] = field(default_factory=list)
    """States on the way through the air, once the tool has set out."""
    samples: list[Sample] = field(default_factory=list)
    """States from the first press on."""
    _replies: int = 0
    _before: TaskState | None = None
    """The task as it was: its gains and switches are set again at the end."""
    _home: Array = field(default_factory=lambda: np.zeros(6))
    _normal: Array = field(default_factory=lambda: np.zeros(3))
    _offset: Array = field(default_factory=lambda: np.zeros(3))
    _threshold: float = LEAST_N
    _lost: int = 0
    _in_contact: bool = False
    _recent: deque[Sample] = field(default_factory=lambda: deque(maxlen=2000))

    # --- from step to step -------------------------------------------------------------------

    def _course(self) -> Course:
        if self.press.posture is not None:
            self._to(posture=self.press.posture)
            if not (yield from self._arriving(t.POSTURE, ARRIVE_S)):
                posture = self.press.posture
                raise GaveUpError(f"posture {posture!r} not reached within {ARRIVE_S:g} s")
        yield
        try:
            yield from self._prepared()
            try:
                yield from self._rested()
                yield from self._approached()
                gain = yield from self._touched()
                for _ in range(2 * PRESSES):
                    yield from self._pressed(gain)
            except GaveUpError as error:
                if self._state.mode != "enabled":
                    raise
                self.failure = str(error)
            yield from self._gone_back()
        except GaveUpError as error:
            self.failure = self.failure or str(error)
        yield from self._restored()

    def _prepared(self) -> Course:
        """Make force control gentle, and the only source."""
        task = self._told
        moving = [name for name, twist in task.sources.items() if np.abs(twist).max() > 1e-3]
        if moving and moving != ["force"]:
            raise GaveUpError(f"source {moving[0]} moves the tool: switch it off first")
        self._before = task
        self._home = np.array(task.pose_mrf)
        axis = self.press.along
        self._normal = axis.sign * rotation_rpy(*self._home[3:])[:, axis.axis]
        self._ask(t.FORCE, wrench=(0.0,) * 6)
        self._soften(APPROACH_GAIN)
        if not task.on["force"]:
            self._request(t.SWITCH, source="force", on=True)
        yield
        while self._replies:
            yield

    def _rested(self) -> Course:
        """Read the sensor's offset and noise in the air; then set out."""
        since_s, air = self._state.time_s, []
        yield
        while True:
            self._look(bound=math.inf)
            air.append((self._told.wrench_mrf or ())[:3])
            if self._state.time_s >= since_s + REST_S:
                break
            yield
        read = np.array(air)
        self._offset, noise = read.mean(axis=0), float(read.std(axis=0).max())
        off = float(np.linalg.norm(self._offset))
        if off > OFFSET_N:
            raise GaveUpError(
                f"the sensor reads {off:.3g} N before anything is touched, at most {OFFSET_N:g} N: "
                "tare it, or set out further away"
            )
        self._threshold = max(LEAST_N, TOUCHED * noise)
        self._exert(APPROACH_SPEED / APPROACH_GAIN)

    def _approached(self) -> Course:
        """Go on through the air until something is touched."""
        since_s, way = self._state.time_s, self.press.way
        yield
        while (sample := self._look()).force <= self._threshold:
            if sample.commanded > SET_OUT:
                self.way.append(sample)
            if sample.force < -self._threshold:
                raise GaveUpError(
                    f"the sensor reads {sample.force:.3g} N where the tool presses: the sign of "
                    "its axis, or of the joints"
                )
            if sample.commanded > SET_OUT and sample.measured < 0.25 * sample.commanded:
                raise GaveUpError(
                    "joints in the wrong direction, or held: commanded "
                    f"{1e3 * sample.commanded:.2f} mm, measured {1e3 * sample.measured:.2f} mm"
                )
            if sample.commanded > way:
                raise GaveUpError(f"nothing touched within {1e3 * way:g} mm")
            if self._later(since_s, SETTLE_S + 2.0 * way / APPROACH_SPEED):
                raise GaveUpError("the tool does not come on: something limits its motion")
            yield
        if sample.commanded > SET_OUT:
            self.way.append(sample)
        if len(self.way) < LEAST_WAY:
            raise GaveUpError(
                f"touched within {1e3 * sample.commanded:.2f} mm: set out further away"
            )
        self.say(f"touched {1e3 * sample.measured:.2f} mm on")
        self._in_contact = True
        self._exert(LOW * self.press.force)
        self._recent.clear()
        self._recent.append(sample)

    def _touched(self) -> Generator[None, None, float]:
        """Press lightly until the stiffness is known about; return the gain that fits."""
        since_s, low = self._state.time_s, LOW * self.press.force
        yield
        while True:
            sample = self._look()
            self._watch_contact(sample)
            if self._lost >= BOUNCES:
                raise GaveUpError(f"the tool bounces: contact was lost {self._lost} times")
            if not self._in_contact and self._later(self._recent[0].time_s, SETTLE_S):
                raise GaveUpError("contact lost")
            if sample.force > 0.7 * low or self._later(since_s, SETTLE_S):
                break
            yield
        rough = _stiffness(list(self._recent))
        self.say(f"about {rough / 1e3:.2g} kN/m")
        return min(1.0 / (rough * SETTLES_S), self._own_gain)

    def _pressed(self, gain: float) -> Course:
        """Press until the force is about right; then let the command stand until it is steady."""
        wanted = self.press.force * (1.0 if len(self.steady) % 2 == 1 else LOW)
        self._exert(wanted)
        self._soften(gain)
        standing, since_s = False, self._state.time_s
        while True:
            yield
            sample = self._look(keep=not standing)
            self.samples.append(sample)
            self._watch_contact(sample)
            if not self._in_contact:
                raise GaveUpError("contact lost")
            if not standing and abs(sample.force - wanted) < NEAR * self.press.force:
                self._soften(0.0)
                self._recent.clear()
                standing, since_s = True, self._state.time_s
            elif standing and self._later(since_s, STAND_S):
                self._recent.append(sample)
                if (window := self._steady()) is not None:
                    break
            if self._later(since_s, SETTLE_S):
                now_s = self._state.time_s
                recent = [s.force for s in self.samples if s.time_s > now_s - WINDOW_S]
                raise GaveUpError(
                    f"not steady within {SETTLE_S:g} s: {np.mean(recent):.3g} N of {wanted:.3g} "
                    f"N, swinging by {max(recent) - min(recent):.2g} N"
                )
        self.steady.append(window)
        self.say(f"press {len(self.steady)} of {2 * PRESSES}: {window.force:.2f} N")

    def _gone_back(self) -> Course:
        """Leave what is touched, as softly as it was pressed, for where the tool set out."""
        self._ask(t.FORCE, wrench=(0.0,) * 6)
        xyz, rpy = (tuple(part.tolist()) for part in np.split(self._home, 2))
        self._ask(t.POSITION, xyz=xyz, rpy=rpy, relative_to="world", speed=RETURN_SPEED)
        if not (yield from self._arriving(t.POSITION, ARRIVE_S)):
            self.failure = self.failure or "the tool does not come back to where it set out"
        self._ask(t.CANCEL)

    def _restored(self) -> Course:
        """Leave the task as it was, wherever the arm is: an operator may go on at once."""
        self._restores = True
        if self._before is None:
            return
        self._request(t.GAIN, source="force", gain=self._before.gains["force"])
        if not self._before.on["force"]:
            self._request(t.SWITCH, source="force", on=False)
        yield
        while self._replies:
            yield

    # --- looking -----------------------------------------------------------------------------

    def _look(self, bound: float = BOUND, *, keep: bool = True) -> Sample:
        """Return the state as a sample of the press. Raises `GaveUpError` for too hard a one.

        A force beyond `bound` of the harder press [1]; one to `keep` is among the recent ones.
        """
        state, task = self._state, self._told
        if task.wrench_mrf is None:
            raise GaveUpError("the force/torque sensor is stale or missing")
        axis, felt = self.press.along, np.array(task.wrench_mrf[:3]) - self._offset
        at = (
            float(self._normal @ (np.array(pose[:3]) - self._home[:3]))
            for pose in (task.pose_mrf, task.pose_mrf_measured)
        )
        force = axis.sign * float(felt[axis.axis])
        sample = Sample(state.time_s, state.tick, force, *at)
        if keep:
            self._recent.append(sample)
        hard, most = float(np.linalg.norm(felt)), bound * self.press.force
        if hard > most:
            raise GaveUpError(f"force bound reached: {hard:.3g} N of {most:.3g} N")
        return sample

    def _watch_contact(self, sample: Sample) -> None:
        """Notice where contact is lost and found again; half the threshold is none."""
        if self._in_contact and sample.force < 0.5 * self._threshold:
            self._in_contact, self._lost = False, self._lost + 1
        elif sample.force > self._threshold:
            self._in_contact = True

    def _steady(self) -> Steady | None:
        """Return the means of the newest window where it is steady; None where it is not."""
        if not self._recent:
            return None
        newest = self._recent[-1].time_s
        window = np.array([s for s in self._recent if s.time_s > newest - WINDOW_S])
        if self._recent[0].time_s > newest - WINDOW_S or len(window) < 10:
            return None
        early, late = np.array_split(window[:, 2], 2)
        noise = float(np.concatenate([early - early.mean(), late - late.mean()]).std())
        allowed = 4.0 * noise / math.sqrt(len(early)) + 2e-3 * self.press.force
        if abs(late.mean() - early.mean()) > allowed or noise > 0.5 * self._threshold:
            return None
        return Steady(*window[:, 2:].mean(axis=0))

    @property
    def _own_gain(self) -> float:
        """K_F of the task along the press, as it was."""
        gains = APPROACH_GAIN if self._before is None else self._before.gains["force"]
        return float(np.broadcast_to(gains, 6)[self.press.along.axis])

    # --- speaking ----------------------------------------------------------------------------

    def _ask(self, topic: t.Topic, **fields: object) -> None:
        self.client.command(topic, task=self.task, **fields)
        self._asked_seq = self.client.seq

    def _exert(self, force: float) -> None:
        wrench = [0.0] * 6
        wrench[self.press.along.axis] = self.press.along.sign * force
        wrench[self.press.along.axis] += float(self._offset[self.press.along.axis])
        self._ask(t.FORCE, wrench=tuple(wrench))

    def _soften(self, gain: float) -> None:
        """Let force control act along the press alone, with that K_F [m/s/N]."""
        gains = [0.0] * 6
        gains[self.press.along.axis] = gain
        self._request(t.GAIN, source="force", gain=tuple(gains))

    def _request(self, topic: t.Topic, **fields: object) -> None:
        self._replies += 1
        self.client.request(topic, self._on_reply, task=self.task, **fields)

    def _on_reply(self, reply: requests.Reply) -> None:
        self._replies -= 1
        if not reply.ok and not self.over:
            self._end(self.failure or f"{reply.reason}: {reply.detail}")


def _stiffness(samples: list[Sample]) -> float:
    """Return the slope of force over measured depth, by both ends of what was sampled [N/m]."""
    rows = np.array([(s.measured, s.force) for s in samples])
    hard = rows[rows[:, 1] > 0.5 * rows[:, 1].max()]
    depth, force = hard.mean(axis=0) - rows[0]
    return float(force / max(depth, 1e-7))


# --- What the presses tell ------------------------------------------------------------------------
LATEST = 8.0  # a force is looked for no further behind the depth [periods]
TELLING = 0.25  # stiffnesses that differ by more of their mean tell too little [1]


@dataclass(frozen=True)
class Environment:
    """What a tool touched."""

    stiffness: float  # by the measured depth [N/m]
    repeatability: float  # half the range over the presses [N/m]
    with_drives: float  # by the commanded depth: what drives sag by gives way as well [N/m]
    damping: float  # [N·s/m]
    delay_periods: float  # of the loop as seen, without the lag of the jerk limit [periods]
    model_periods: float  # the same by the cell's own model [periods]
    forces: tuple[float, float]  # of the lighter and the harder press [N]
    depth: float  # between them, measured [m]


def environment(cell: Cell, guide: PressGuide) -> Environment:
    """Return what the presses of a guide tell of what it touched. Raises `NotIdentified`."""
    rows = np.array([(s.force, s.measured, s.commanded) for s in guide.checked().steady])
    # Each press against the one before: what drifts slowly falls out of it.
    steps = np.diff(rows, axis=0)
    depth = float(np.abs(steps[:, 1]).mean())
    if (steps[:, 0] * steps[:, 1] <= 0.0).any():
        raise NotIdentified(
            f"pressed harder, the tool goes back by {1e6 * depth:.3g} µm: the direction of a joint "
            "or of an axis of the sensor, or what is touched is stiffer than encoders tell"
        )
    each = steps[:, 0] / steps[:, 1]
    stiffness, apart = float(each.mean()), float(np.ptp(each)) / 2.0
    if apart > TELLING * stiffness:
        raise NotIdentified(
            f"presses tell {each.min():.3g} to {each.max():.3g} N/m, over {1e6 * depth:.3g} µm: "
            "too far apart"
        )
    loop = ForceLoop(cell)
    gains = cell.config.sources.force.gain
    axis = loop.axes(gains)[guide.press.along.axis]
    if axis is None:
        raise NotIdentified("the arm cannot move along that axis")
    behind, damping = _force_delay(guide.samples)
    return Environment(
        stiffness=stiffness,
        repeatability=apart,
        with_drives=float((steps[:, 0] / steps[:, 2]).mean()),
        damping=damping,
        # A state tells the command of the tick before, and what is decided now acts a period later.
        delay_periods=_drive_delay(guide.way) + behind,
        model_periods=axis.delay_periods - axis.delays["jerk limit"],
        forces=(float(rows[0::2, 0].mean()), float(rows[1::2, 0].mean())),
        depth=depth,
    )


def _drive_delay(way: list[Sample]) -> float:
    """Return by how much the measured depth is behind the commanded one [periods]."""
    ticks, commanded, measured = np.array([(s.tick, s.commanded, s.measured) for s in way]).T
    speed = float(np.polyfit(ticks - ticks[0], commanded, 1)[0])
    return float((commanded - measured).mean()) / speed


def _force_delay(samples: list[Sample]) -> tuple[float, float]:
    """Return by how much the force is behind the measured depth [periods], and damping [N·s/m].

    Least squares of `F(t) = k x(t − d) + b ẋ(t − d) + c`.
    """
    ticks, times, force, depth = np.array(
        [(s.tick, s.time_s, s.force, s.measured) for s in samples]
    ).T
    inner = (ticks - ticks[0] > LATEST) & (ticks[-1] - ticks > LATEST)
    speed = np.gradient(depth, times)

    def fit(delay: float) -> tuple[float, float]:
        then = ticks[inner] - delay
        moved, moving = np.interp(then, ticks, depth), np.interp(then, ticks, speed)
        regressor = np.column_stack([moved - depth.mean(), moving, np.ones(len(moved))])
        found, rest, *_ = np.linalg.lstsq(regressor, force[inner], rcond=None)
        return float(rest[0]) if len(rest) else math.inf, float(found[1])

    candidates = np.arange(0.0, LATEST, 0.05)
    fits = [fit(float(d)) for d in candidates]
    best = int(np.argmin([rest for rest, _ in fits]))
    return float(candidates[best]), fits[best][1]


# --- Gains for what was touched -------------------------------------------------------------------
SHARE = 0.5
"""Proposed gains are that part of what is stable: a gain margin of two [1]."""
MOST_DAMPING = 1e4  # of following, that a cell may have [N·s/m]
_HALVINGS = 30


@dataclass(frozen=True)
class Proposal:
    """Gains for a stiffness, and how far from their bounds they are."""

    stiffness: float  # as the loop feels it, with what damps [N/m]
    gain: tuple[float, ...]  # K_F (6,) [m/s/N, rad/s/(N·m)]
    loop_gain: float  # K_F k T along the press, k as the loop feels it [1]
    bound: float  # greatest stable one, with the greater delay of both [1]
    share: float  # of the tool's worst contact: loop gain over bound, as `check` judges it [1]
    damping: float | None  # B [N·s/m]; None where none that a cell may have is enough
    hand_share: float  # stiffness over the stiffest that following bears with it [1]


def felt_stiffness(found: Environment, period_s: float) -> float:
    """Return the stiffness of a spring that the loop bears as well as what was found [N/m].

    What damps pushes back against a change as well, and is not counted where it helps. Of the loop
    `K (k T + b (1 − z⁻¹)) z⁻ᵈ / (z − 1)` with the greater delay d, the greatest stable K is found
    where its phase is −π; with b = 0 it is `2 sin(π/(2(2d + 1))) / (k T)`.
    """
    delay = max(found.delay_periods, found.model_periods)
    spring = max(found.stiffness, found.with_drives) * period_s
    w = np.linspace(1e-3, math.pi, 4000)
    felt = spring + max(found.damping, 0.0) * -np.expm1(-1j * w)
    phase = np.angle(felt) - (delay + 0.5) * w - 0.5 * math.pi
    at = int(np.argmax(phase <= -math.pi))
    most = 2.0 * math.sin(0.5 * w[at]) / abs(felt[at])
    return float(max(bound(delay) / most, spring) / period_s)


def propose(cell: Cell, found: Environment, along: Along) -> Proposal:
    """Return force control's K_F, and following's B, for what was touched.

    The cell's own K_F is scaled, so that no contact of the tool is nearer to its bound than
    `SHARE`. Only along the press is it raised: how stiff things are sideways, and about an axis,
    was not felt. Raises `ConfigError` where the cell may not have that stiffness.
    """
    stiffness = felt_stiffness(found, cell.config.timing.period_s)
    hard = altered(cell, {"mechanism.force_torque.stiffest_environment": stiffness})
    bounds, own = LoopBounds(hard), np.array(cell.config.sources.force.gain)

    def scaled(factor: float) -> Array:
        factors = np.full(6, min(factor, 1.0))
        factors[along.axis] = factor
        return np.asarray(own * factors)

    scale = _greatest(lambda s: bounds.gain("force", scaled(s)).share <= SHARE, 1e-6, 1e3)
    axis = ForceLoop(hard).axes(scaled(scale))[along.axis]
    late = 0.0 if axis is None else max(0.0, found.delay_periods - found.model_periods)
    told = 0.0 if axis is None else axis.delay_periods
    scale *= bound(told + late) / bound(told)
    gain = scaled(scale)
    damping, hand_share = _damping(cell, stiffness)
    return Proposal(
        stiffness=stiffness,
        gain=tuple(float(f"{g:.3g}") for g in gain),
        loop_gain=float(gain[along.axis]) * stiffness * cell.config.timing.period_s,
        bound=bound(told + late),
        share=bounds.gain("force", gain).share * bound(told) / bound(told + late),
        damping=damping,
        hand_share=hand_share,
    )


def _damping(cell: Cell, stiffness: float) -> tuple[float | None, float]:
    """Return the least B with which following bears a stiffness, and its share of the bound."""

    def share(damping: float) -> float:
        changes = {"damping": damping, "stiffest_hand": stiffness}
        following = altered(cell, changes, "sources.following")
        return LoopBounds(following).gain("following", cell.config.sources.following.gain).share

    at_most = share(MOST_DAMPING)
    if at_most > SHARE:
        return None, at_most
    less = _greatest(lambda s: share(MOST_DAMPING / s) <= SHARE, 1.0, 1e6)
    damping = float(f"{MOST_DAMPING / less:.3g}")
    return damping, share(damping)


def _greatest(holds: Callable[[float], bool], least: float, most: float) -> float:
    """Return the greatest factor for which something holds that holds at `least`."""
    low, high = math.log10(least), math.log10(most)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(10.0**middle) else (low, middle)
    return float(10.0**low)


def allowed(cell: Cell, press: Press) -> None:
    """Raise `ConfigError` for a press that the cell does not allow."""
    mechanism, force = cell.config.mechanism, cell.config.sources.force
    if mechanism.force_torque is None:
        raise ConfigError(f"{cell.path}: mechanism.force_torque: missing: no force is felt")
    if press.posture is not None and press.posture not in mechanism.postures:
        known = ", ".join(mechanism.postures)
        raise ConfigError(f"{cell.path}: mechanism.postures.{press.posture}: none of {known}")
    most = force.hold_threshold / BOUND
    if press.force > most:
        raise ConfigError(
            f"{cell.path}: sources.force.hold_threshold: value {force.hold_threshold:g}: a press "
            f"of {press.force:g} N may reach {BOUND * press.force:g} N; press with {most:.3g} N"
        )
    if force.gain[press.along.axis] <= 0.0:
        raise ConfigError(
            f"{cell.path}: sources.force.gain[{press.along.axis}]: value 0: force control does not "
            "act along that axis"
        )


# --- The report: for people, for programs, for the cell file --------------------------------------
def report(cell: Cell, found: Environment, gains: Proposal) -> str:
    """Return what was found, a line each, and the lines of the cell file that are proposed."""
    light, hard = found.forces
    model = f"{found.model_periods:.2f} by the cell's model"
    kilo = found.stiffness / 1e3
    lines = [
        f"stiffness    {kilo:.4g} kN/m, repeated within {found.repeatability / 1e3:.2g} kN/m: "
        f"{light:.1f} and {hard:.1f} N, {1e6 * found.depth:.3g} µm apart",
        f"with drives  {found.with_drives / 1e3:.4g} kN/m, by the commanded depth",
        f"damping      {found.damping:.3g} N·s/m: in the loop as stiff as "
        f"{gains.stiffness / 1e3:.4g} kN/m without",
        f"delay        {found.delay_periods:.2f} periods as seen, {model}: the greater one counts",
        f"K_F          loop gain {gains.loop_gain:.3g}, stable below {gains.bound:.3g}: margin "
        f"{gains.bound / gains.loop_gain:.2g}; of the tool's worst contact {1 / gains.share:.2g}",
    ]
    if gains.damping is None:
        lines.append(
            f"B            none up to 10000 N·s/m: {gains.hand_share:.2g} of what is stable"
        )
    else:
        lines.append(f"B            {gains.damping:g} N·s/m: margin {1 / gains.hand_share:.2g}")
    return "\n".join(lines) + "\n\n" + snippet(cell, gains)


def snippet(cell: Cell, gains: Proposal) -> str:
    """Return the lines of the cell file; of one of several arms, for its own tables."""
    stiffness = f"{gains.stiffness:.3g}"
    whose = "" if cell.place == "mechanism" else "tasks."
    lines = [
        f"[{cell.place.split('[')[0]}.force_torque]",
        f"stiffest_environment = {float(stiffness):g}",
        "",
        f"[{whose}sources.force]",
        "gain = [" + ", ".join(f"{g:g}" for g in gains.gain) + "]",
    ]
    if gains.damping is not None:
        lines += [
            "",
            f"[{whose}sources.following]",
            f"damping = {gains.damping:g}",
            f"stiffest_hand = {float(stiffness):g}",
        ]
    return "\n".join(lines)


def as_dict(cell: Cell, found: Environment, gains: Proposal) -> dict[str, object]:
    """Return what was found, and what is proposed, as JSON's types."""
    proposed = {**vars(gains), "felt_stiffness": gains.stiffness}
    told = {"cell": cell.config.name, **proposed, **vars(found)}
    return {**told, "toml": snippet(cell, gains)}
