"""`telerobot.Operator`: a cell in ten lines."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Self

from ...config.load import Cell, load_cell
from ...drivers.network.identity import identity_of
from ...drivers.network.session import REPLY_TIMEOUT_S, MessageCarrier, NotCertified, Session
from ...protocols import topics as t
from ...protocols.codec import CodecError, decode_as, encode
from ...protocols.messages import messages as m
from ...protocols.messages import requests
from ...protocols.messages.messages import MechanismCommand, Reflection, TaskCommand
from ...protocols.messages.perception import RigMotion
from ...protocols.messages.rig import RigFault
from ...protocols.messages.telemetry import Description, Event, State, TaskDescription, TaskState
from ...protocols.topics import Role
from ...server.process import Clock, MonotonicClock
from ..host.address import moved
from .protocol_client import NoLease, OnReply, ProtocolClient, RoundTrip, ignore

# --- Live connection of an operator to a daemon: session, telemetry, keepalive, streams, lease ----
POLL_S = 0.002


class OperatorError(Exception):
    """The daemon refused, or did not answer: carries the reason by name."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
        self.detail = detail


class Connection:
    """A session that reads telemetry and sends what is due, inside `spin` and `turn`."""

    def __init__(
        self,
        cell: str | Cell,
        endpoint: str | None = None,
        name: str = "operator",
        identity: str | Path | None = None,
    ) -> None:
        loaded = cell if isinstance(cell, Cell) else load_cell(cell)
        loaded = moved(loaded, endpoint=endpoint, identity=identity)
        self.endpoint = loaded.config.zenoh.dialled
        shown = identity_of(loaded, Role.OPERATOR, name)
        try:
            session = Session(loaded.config.name, self.endpoint, shown)
        except ConnectionError as error:
            raise OperatorError("no_daemon", str(error)) from None
        self._begin(loaded, name, session, MonotonicClock())

    def _begin(self, cell: Cell, name: str, session: MessageCarrier, clock: Clock) -> None:
        """Listen to a cell's daemon over a line that is open."""
        self.cell = cell.config.name
        self.session, self.clock = session, clock
        # Of what is true only now, the newest that can be read; junk between does not push it out.
        depths = {t.STATE: 64, t.REFLECTION: 64, t.EVENT: 256, t.DESCRIPTION: 8}
        self._inboxes = {topic: session.subscribe(topic, n) for topic, n in depths.items()}
        self.client = ProtocolClient(name, self.cell, self._put, session.ask)
        self.description: Description | None = None
        """The daemon's description of its cell; comes within a second."""
        self.round_trip = RoundTrip()
        self.state_since_s: float | None = None
        """Time of reading the newest state, on `clock` [s]."""
        self.on_state: Callable[[State], None] = ignore
        """Called with every state that is read."""
        self.on_event: Callable[[Event], None] = ignore
        """Called with every event that is read."""
        self.on_reflection: Callable[[Reflection], None] = ignore
        """Called with every force for the handle that is read; none come of most cells."""
        self.reflection = cell.config.reflection
        """Section `[reflection]` of the cell."""

    @property
    def state(self) -> State | None:
        """The newest state that was read."""
        return self.client.state

    @property
    def events(self) -> list[Event]:
        """All events that were read."""
        return self.client.events

    @property
    def holds_lease(self) -> bool:
        """True from the grant of the lease until it is released or telemetry shows it lost."""
        return self.client.secret is not None

    def spin(self, seconds: float = 0.0, until: Callable[[], bool] | None = None) -> bool:
        """Keep the session alive for a while, or until something holds; return whether it did."""
        end = self.clock.now() + seconds
        while True:
            self.turn()
            if until is not None and until():
                return True
            if self.clock.now() >= end:
                return until is None
            self._rest()

    def turn(self) -> None:
        """Read what came in and send what is due, once; waits for nothing."""
        for topic, inbox in self._inboxes.items():
            payloads = list(inbox.take())
            if topic.life is not t.Life.STREAM:
                for payload in payloads:
                    self._take(topic, payload)
            elif payloads:
                any(self._take(topic, payload) for payload in reversed(payloads))
        self.session.poll()
        self.client.run(self.clock.now())

    def inject(self, fault: RigFault | RigMotion) -> None:
        """Inject a fault into the virtual hardware, or move what stands there."""
        topic = t.RIG_MOTION if isinstance(fault, RigMotion) else t.RIG_FAULT
        try:
            self.session.put(topic, encode(fault))
        except NotCertified as error:
            raise OperatorError("not_certified", str(error)) from None

    def close(self) -> None:
        """End the session."""
        self.session.close()

    def _wait(self, send: Callable[[OnReply], None]) -> requests.Reply:
        """Send a request, and return its reply. Raises `OperatorError` when refused."""
        replies: list[requests.Reply] = []
        try:
            send(replies.append)
        except NoLease as error:
            raise OperatorError("no_lease", str(error)) from None
        self.spin(REPLY_TIMEOUT_S + 1.0, lambda: bool(replies))
        if not replies:
            raise OperatorError("no_answer", "the daemon did not answer")
        if not replies[0].ok:
            raise OperatorError(replies[0].reason, replies[0].detail)
        return replies[0]

    def _rest(self) -> None:
        time.sleep(POLL_S)

    def _take(self, topic: t.Topic, payload: bytes) -> bool:
        """Take in what was told; return False for what cannot be read."""
        try:
            message = decode_as(topic.message, payload, topic.max_bytes)
        except CodecError:
            return False  # another version's telemetry; commands would be refused by name
        if isinstance(message, State):
            self._take_state(message, self.clock.now())
        elif isinstance(message, Reflection):
            self.on_reflection(message)
        elif isinstance(message, Event):
            self.client.on_event(message)
            self.on_event(message)
        elif isinstance(message, Description):
            self.description = message
        return True

    def _take_state(self, state: State, now_s: float) -> None:
        self.client.on_state(state)
        self.state_since_s = now_s
        if self.holds_lease:
            self.client.watch_lease(state)
            self.round_trip.echoed(state.last_seq, now_s)
        self.on_state(state)

    def _put(self, topic: t.Topic, payload: bytes, proof: bytes) -> None:
        self.round_trip.sent(topic.key, self.client.seq, self.clock.now())
        self.session.put(topic, payload, proof)


# --- Motions of a task: stick, targets, postures, paths, master, frames, the null space -----------
class Motions(ABC):
    """Base of a client that leads the motions of one task, through an operator's connection."""

    _led: TaskDescription | None = None
    """The task that is led; None: the first, which commands need not name."""

    @property
    @abstractmethod
    def _line(self) -> Connection:
        """Connection of the operator who leads."""

    def command(self, topic: t.Topic, **fields: Any) -> None:
        """Send any command. Raises `OperatorError` without the lease, `ValueError` for fields that
        its message does not take.
        """
        self.need_lease()
        self._line.client.command(topic, **self._named(topic), **fields)

    def request(self, topic: t.Topic, **fields: Any) -> requests.Reply:
        """Send any request and return its reply. Raises `OperatorError` when refused."""
        fields = {**self._named(topic), **fields}
        return self._line._wait(
            lambda on_reply: self._line.client.request(topic, on_reply, **fields)
        )

    def stream(self, topic: t.Topic, **fields: Any) -> None:
        """Keep sending a command at 100 Hz, inside `spin`, until the next call or `end_stream`.

        Raises `OperatorError` without the lease, `ValueError` for fields that its message does not
        take.
        """
        self.need_lease()
        self._line.client.stream(topic, **self._named(topic), **fields)

    def end_stream(self, topic: t.Topic, named: str | None = None) -> None:
        """Fall silent on a topic, for a task or mechanism; without a name, for all."""
        own = next(iter(self._named(topic).values()), None)
        self._line.client.end_stream(topic, named or own)

    def spin(self, seconds: float = 0.0, until: Callable[[], bool] | None = None) -> bool:
        """Keep the session alive for a while, or until something holds; return whether it did."""
        return self._line.spin(seconds, until)

    def need_lease(self) -> None:
        """Raise `OperatorError` without the lease."""
        if not self._line.holds_lease:
            raise OperatorError("no_lease", f"{self._line.client.name} does not hold the lease")

    def task_state(self) -> TaskState | None:
        """Return the newest state of the task; an operator's is the first, which needs no name."""
        state = self.cell_state
        return None if state is None else state.of(None if self._led is None else self._led.task)

    @property
    def cell_state(self) -> State | None:
        """The newest state of the cell."""
        return self._line.state

    @property
    def sent(self) -> int:
        """Number of the newest message that was sent."""
        return self._line.client.seq

    def _stream_for(self, seconds: float, topic: t.Topic, **fields: Any) -> None:
        self.stream(topic, **fields)
        if seconds > 0.0:
            self.spin(seconds)
            self.end_stream(topic)
            self.need_lease()

    def _named(self, topic: t.Topic) -> dict[str, str]:
        """Return what names the task, or its mechanism, in a topic's message."""
        if self._led is None:
            return {}
        if issubclass(topic.message, TaskCommand):
            return {"task": self._led.task}
        if issubclass(topic.message, MechanismCommand):
            return {"mechanism": self._led.mechanism}
        return {}

    def joystick(
        self,
        twist: Sequence[float],
        seconds: float = 0.0,
        expressed_in: str = "crf",
        relative_to: str = "crf",
    ) -> None:
        """Stream a stick twist (6,) [m/s, rad/s] for a while; with `seconds` 0, until told
        otherwise (and only while `spin` is called).

        Raises `OperatorError` without the lease, or when it is lost meanwhile, `ValueError` for
        what is no twist.
        """
        axes = {"expressed_in": m.Frame(expressed_in), "relative_to": m.Frame(relative_to)}
        self._stream_for(seconds, t.JOYSTICK, twist=tuple(twist), **axes)

    def drive(self, speed: float, turn: float | None = None, seconds: float = 0.0) -> None:
        """Drive a mechanism as a whole: a base on wheels, or an arm into its tunnels.

        With a `turn`, a base goes ahead at `speed` [m/s] and turns to the left [rad/s]. Without,
        an arm is inserted at `speed`, or withdrawn with a negative one. For a while; with `seconds`
        0, until told otherwise (and only while `spin` is called). Raises as `joystick` does.
        """
        rates = (speed,) if turn is None else (speed, turn)
        self._stream_for(seconds, t.DRIVE, rates=rates)

    def self_motion(self, rate: float, seconds: float = 0.0) -> None:
        """Move the spare joints while the tool stays, or goes its way, for a while.

        At a rate of the arm angle [rad/s], or of an arm without one at a part of its quickest [1].
        With `seconds` 0, until told otherwise (and only while `spin` is called). Raises as
        `joystick` does.
        """
        self._stream_for(seconds, t.SELF_MOTION, rate=rate)

    def arm_angle(self, angle: float, speed: float | None = None) -> None:
        """Turn the elbow to an arm angle [rad] while the tool stays, or goes its way.

        Returns at once; `task_state().arm_angle` tells where it is.
        """
        self.command(t.ARM_ANGLE, angle=angle, speed=speed)

    def insert(self, depth: float, speed: float | None = None) -> None:
        """Insert or withdraw an arm until its tip is so far past the entrance [m].

        Returns at once; `wait_goal` waits.
        """
        self.command(t.INSERT, depth=depth, speed=speed)

    def move_to(
        self, xyz: Sequence[float], rpy: Sequence[float], relative_to: str = "crf", **more: Any
    ) -> None:
        """Set a target pose of the MRF [m, rad]; returns at once."""
        self.command(
            t.POSITION, xyz=tuple(xyz), rpy=tuple(rpy), relative_to=m.Frame(relative_to), **more
        )

    def posture(self, posture: str | Sequence[float]) -> None:
        """Move to a joint posture, by name or angles [rad]; returns at once.

        It ends when it is reached, or when the stick is moved; until then stick and target wait.
        """
        if isinstance(posture, str):
            self.command(t.POSTURE, posture=posture)
        else:
            self.command(t.POSTURE, q=tuple(posture))

    def store_view(
        self, camera: str | None = None, *, again: bool = False, law: str | None = None
    ) -> None:
        """Make what a camera sees now the view that the vision source keeps.

        Without a name: of the camera whose view is kept. `again` keeps the view that was stored
        for the camera before. `law` keeps it by the tag's "pose" or by its "image" from now on.
        Raises `OperatorError` where it sees nothing, or nothing was stored. The source moves
        nothing before it is switched on.
        """
        self.request(t.STORE_VIEW, camera=camera, again=again, law=law)

    def cancel(self) -> None:
        """Drop target, posture and desired wrench."""
        self.command(t.CANCEL)

    def wait_goal(self, timeout_s: float) -> bool:
        """Wait until the goal that was set last is reached; return whether it was."""
        seq = self.sent

        def reached() -> bool:
            cell, s = self.cell_state, self.task_state()
            heard = cell is not None and max(cell.last_seq.values(), default=0) >= seq
            return s is not None and heard and s.at_goal

        return self.spin(timeout_s, reached)

    def follow(
        self,
        waypoints: Sequence[Sequence[float]],
        speeds: Sequence[float] = (),
        blend: float = 0.0,
        relative_to: str = "crf",
        **more: Any,
    ) -> None:
        """Lead the tool through poses `[x, y, z, roll, pitch, yaw]` [m, rad]; returns at once.

        `speeds` [m/s] is one for each, or none. With `blend` 0 it stops at each; else it turns to
        the next within `blend` [m] of it.
        """
        self.command(
            t.PATH,
            waypoints=tuple(tuple(w) for w in waypoints),
            speeds=tuple(speeds),
            blend=blend,
            relative_to=m.Frame(relative_to),
            **more,
        )

    def follow_twists(
        self,
        twists: Sequence[Sequence[float]],
        durations_s: Sequence[float],
        expressed_in: str = "crf",
    ) -> None:
        """Move at twists (6,) [m/s, rad/s], each for its time [s]; returns at once."""
        self.command(
            t.PATH,
            twists=tuple(tuple(twist) for twist in twists),
            durations_s=tuple(durations_s),
            expressed_in=m.Frame(expressed_in),
        )

    def pause_path(self) -> None:
        """Let the path stand; a stick may shift the tool meanwhile, and it returns."""
        self.request(t.PATH_CONTROL, action="pause")

    def resume_path(self) -> None:
        """Go on along a path that was paused."""
        self.request(t.PATH_CONTROL, action="resume")

    def abort_path(self) -> None:
        """Give the path up; the tool comes to rest."""
        self.request(t.PATH_CONTROL, action="abort")

    def clutch(self, engaged: bool) -> None:
        """Engage or disengage the master, stick and pose alike; the tool never jumps."""
        self.request(t.CLUTCH, engaged=engaged)

    def scale(self, translation: float | None = None, rotation: float | None = None) -> None:
        """Scale the master's motion [1]; what is not given stays."""
        self.request(t.CLUTCH, translation=translation, rotation=rotation)

    def master_pose(
        self, xyz: Sequence[float], rpy: Sequence[float], expressed_in: str = "crf"
    ) -> None:
        """Tell the master device's pose [m, rad], once; to be called at about 100 Hz."""
        self.command(
            t.MASTER_POSE, xyz=tuple(xyz), rpy=tuple(rpy), expressed_in=m.Frame(expressed_in)
        )

    def put_frame(
        self,
        frame: str,
        xyz: Sequence[float] = (0.0, 0.0, 0.0),
        rpy: Sequence[float] = (0.0, 0.0, 0.0),
        relative_to: str | None = None,
        **more: Any,
    ) -> None:
        """Redefine the "mrf" or the "crf"; nothing moves because of it.

        By default a pose [m, rad] in the Wrist or in World; relative to another frame, as that is
        now. `put_frame("crf", relative_to="mrf")` puts the CRF here. See `FrameRequest`.
        """
        there = None if relative_to is None else m.Frame(relative_to)
        self.request(
            t.FRAME, frame=frame, xyz=tuple(xyz), rpy=tuple(rpy), relative_to=there, **more
        )

    def redundancy(self, objective: str, gain: float, posture: str | None = None) -> None:
        """Set a redundancy objective's gain, 0 for off."""
        self.request(t.REDUNDANCY, objective=objective, gain=gain, posture=posture)

    def free_axes(self, *axes: str) -> None:
        """Leave axes of the MRF to the null space: "x", "y", "z", "rx", "ry", "rz"; hold the rest.

        A goal is reached when the axes that are held are there; nothing is asked along the others.
        """
        self.request(t.FREE_AXES, axes=axes)

    def load_shares(self, *weights: float | Sequence[float]) -> None:
        """Share the load of a payload in several hands out anew; without any, as the cell says.

        Diagonals of W, one for each mechanism of the task: six numbers (forces, then moments, along
        the axes of the MRF), or one for all six. The dearer, the less that arm carries.
        """
        rows = tuple((w,) * 6 if isinstance(w, int | float) else tuple(w) for w in weights)
        self.request(t.LOAD_SHARES, weights=rows)

    def tunnel(
        self, pieces: Sequence[Sequence[float]] = (), *, open_pieces: int = 0, **more: Any
    ) -> None:
        """Tell an arm its tunnel anew: [length, bend, climb, roll] of each piece.

        In [m, rad], from the entrance on; [length, x, y, z, roll, pitch, yaw] is a gap before the
        next passage, whose entrance is there in World. The last `open_pieces` have no walls.
        Without pieces the cell's holds again. Returns once it holds; up to where the tip is, or
        would come to rest, it must stay as it is.
        """
        told = tuple(tuple(piece) for piece in pieces)
        self.request(t.TUNNEL, pieces=told, open=open_pieces, **more)


# --- One task of a cell, led through an operator's session: what it sends names the task ----------
class TaskClient(Motions):
    """Leads a task; `operator.task(NAME)` makes one. Lease and mode are the operator's."""

    def __init__(self, operator: Connection, description: TaskDescription) -> None:
        self._operator = operator
        self.description = self._led = description

    @property
    def name(self) -> str:
        """Name of the task."""
        return self.description.task

    @property
    def _line(self) -> Connection:
        return self._operator


# --- Remote operator over Zenoh: `telerobot.Operator`, for a user's own scripts -------------------
#
# with Operator("pa10") as operator:
#     operator.acquire()
#     operator.enable()
#     operator.joystick([0.02, 0, 0, 0, 0, 0], seconds=2.0)
#
# Where the cell has several tasks, it leads the first; `operator.task(NAME)` leads another.
DESCRIBED_S = 2.0
"""A daemon describes its cell at least this often [s]."""


class Operator(Connection, Motions):
    """One operator's session with a daemon; a context manager.

    **Nothing runs in the background.** The lease is renewed, streams are sent and telemetry is
    read inside `spin` and the calls that wait. Call one of them at least every 0.1 s, or the
    lease runs out (0.5 s in most cells) and the arm stops and holds: that is meant, a script that
    hangs shall not keep an arm moving. In a large program a garbage collection may take that long:
    `gc.freeze()` once everything is set up. Not for use from several threads.

    `identity` is the certificate to show, without `.crt`, or the folder in which it lies; the
    cell's `zenoh.security.directory` unless given.

    Raises `OperatorError` when nobody answers, `ConfigError` for a cell that is wrong.
    """

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def _line(self) -> Connection:
        return self

    def wait_state(self, timeout_s: float = REPLY_TIMEOUT_S) -> State:
        """Return the newest state, waiting for the first. Raises `OperatorError` if none comes."""
        if not self.spin(timeout_s, lambda: self.state is not None) or self.state is None:
            shown = self.session.shown
            known = "" if shown is None else f"; does its daemon know {shown}?"
            raise OperatorError("no_daemon", f"no telemetry of cell {self.cell}{known}")
        return self.state

    def wait_mode(self, mode: str, timeout_s: float = REPLY_TIMEOUT_S) -> State:
        """Return the first state in a mode. Raises `OperatorError` if it is not reached."""
        self.spin(timeout_s, lambda: self.state is not None and self.state.mode == mode)
        state = self.wait_state()
        if state.mode != mode:
            raise OperatorError("not_now", f"mode is {state.mode}, not {mode}")
        return state

    def acquire(self) -> None:
        """Take the lease. Raises `OperatorError` while somebody else holds it."""
        end = self.clock.now() + REPLY_TIMEOUT_S
        while not self.holds_lease:
            try:
                self._wait(self.client.acquire)
            except OperatorError as error:
                # A session that is just open does not know yet what the daemon answers.
                if error.reason != "no_answer" or self.clock.now() > end:
                    raise
                self.spin(0.05)

    def release(self) -> None:
        """Give the lease back; a moving arm stops. Raises `OperatorError` if it was lost."""
        self._wait(self.client.release)

    def enable(self) -> None:
        """Switch the drives on, or go on after HOLD; returns once the arm may be moved."""
        self.wait_state()
        self.request(t.MODE, action="enable")
        self.wait_mode("enabled")

    def hold(self) -> None:
        """Stop and stand."""
        self.request(t.MODE, action="hold")

    def disable(self) -> None:
        """Stop, and switch the drives off."""
        self.request(t.MODE, action="disable")

    def reset(self) -> None:
        """Leave FAULT, once its cause is gone; returns with the drives ready to be enabled."""
        self.request(t.MODE, action="reset")
        self.wait_mode("ready")

    def protective_stop(self) -> None:
        """Stop the arm; works without the lease."""
        self._wait(self.client.protective_stop)

    def clear_protective_stop(self) -> None:
        """Clear all protective stops with the lease, else the newest of one's own."""
        self._wait(self.client.clear_protective_stop)

    def hold_together(self, on: bool = True, task: str | None = None) -> None:
        """Let the arms of a joint task hold its payload, or let go of it; only at rest."""
        self.request(t.HOLD_TOGETHER, task=task, on=on)

    def paced(self, rate: float, seconds: float) -> Iterator[int]:
        """Yield 0, 1, 2, … so many times a second [1/s] for a while, for a loop's body to follow.

        The session is kept alive between two of them. Times are absolute: a body that took long
        shortens the wait that follows; a time that is missed is skipped.
        """
        start = self.clock.now()
        for i in range(round(seconds * rate)):
            left = start + (i + 1) / rate - self.clock.now()
            if left > 0.0:
                yield i
                self.spin(max(0.0, start + (i + 1) / rate - self.clock.now()))

    def task(self, name: str) -> TaskClient:
        """Return what leads one task of the cell, by its name, through this session.

        Raises `OperatorError` where the cell has no such task, or does not describe itself.
        """
        self.spin(DESCRIBED_S, lambda: self.description is not None)
        if self.description is None:
            raise OperatorError("no_answer", f"cell {self.cell} did not describe itself")
        try:
            return TaskClient(self, self.description.of(name))
        except ValueError as error:
            raise OperatorError("unknown_task", str(error)) from None

    def close(self) -> None:
        """Release the lease, if held, and end the session."""
        if self.holds_lease and not self.client.mute:
            try:
                self.release()
            except OperatorError:
                self.client.secret = None  # it has run out already: there is nothing to release
        super().close()
