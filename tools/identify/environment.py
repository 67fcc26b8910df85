"""Stiffness and delay of what a tool touches, by gentle presses; gains for it, with their margins.

The tool is pressed by force control with a gain so low that it cannot bounce, up and down between
two forces. At each the command stands until the force is steady, for force control and friction in
the joints would hunt for ever. What that tells is `server/identification/environment.py`'s.
"""

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from ...config.errors import ConfigError
from ...config.load import Cell
from ...protocols import topics as t
from ...protocols.messages import requests
from ...protocols.messages.telemetry import State, TaskState
from ...server.control.spatial import Array, rotation_rpy
from ...server.identification.environment import Along, Environment, Proposal, Sample, Steady
from ...server.identification.payload import NotIdentified
from ..client.protocol_client import NoLease, ProtocolClient, ignore


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
        return self._state.time_s > since_s + seconds

    def _to(self, **posture: object) -> None:
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
TOGETHER = 5  # noise is taken off contact by the mean of so many states [1]
BOUNCES = 3  # so often contact may be lost at the first touch [1]
SET_OUT = 5e-4  # after so long a way the joints show which way they go [m]
LEAST_WAY = 20  # so many states on the way through the air tell how late joints are [1]
RETURN_SPEED = 0.01  # [m/s]
ARRIVE_S = 60.0  # a posture, or the way back, takes no longer [s]


@dataclass(frozen=True)
class Press:
    """What is asked for."""

    along: Along
    way: float  # contact is looked for no further than this [m]
    force: float  # of the harder press [N]
    posture: str | None = None  # from which it sets out; None: from where the arm stands


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
    _newest: deque[float] = field(default_factory=lambda: deque(maxlen=TOGETHER))
    """Forces in contact, the newest ones [N]."""

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
        self._newest.clear()
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
            enough = len(self._recent) >= LEAST_WAY and np.mean(self._newest) > 0.7 * low
            if enough or self._later(since_s, SETTLE_S):
                break
            yield
        rough = _stiffness(list(self._recent))
        self.say(f"about {rough / 1e3:.2g} kN/m")
        before = APPROACH_GAIN if self._before is None else self._before.gains["force"]
        own = float(np.broadcast_to(before, 6)[self.press.along.axis])
        return min(1.0 / (rough * SETTLES_S), own)

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
        self._newest.append(force)
        if keep:
            self._recent.append(sample)
        hard, most = float(np.linalg.norm(felt)), bound * self.press.force
        if hard > most:
            raise GaveUpError(f"force bound reached: {hard:.3g} N of {most:.3g} N")
        return sample

    def _watch_contact(self, sample: Sample) -> None:
        """Notice where contact is lost and found again; half the threshold is none."""
        if self._in_contact and np.mean(self._newest) < 0.5 * self._threshold:
            self._in_contact, self._lost = False, self._lost + 1
        elif not self._in_contact and sample.force > self._threshold:
            self._in_contact = True
            self._newest.clear()
            self._newest.append(sample.force)

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
    """Return how stiff something is at most, by force over measured depth [N/m].

    That is the slope of least squares, and twice its standard deviation: who knows little presses
    the more gently.
    """
    depth, force = np.array([(s.measured, s.force) for s in samples]).T
    (slope, _), spread = np.polyfit(depth - depth[0], force, 1, cov=True)
    return max(float(slope), 0.0) + 2.0 * math.sqrt(spread[0, 0])


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
