"""Plays a script into a cell: operators, their lines' delays, and generators."""

import heapq
import random
from collections import deque
from collections.abc import Callable, Iterator
from enum import Enum, auto
from functools import partial

import numpy as np

from ...config.schema.network import ReflectionSection
from ...protocols import topics as t
from ...protocols.codec import encode
from ...protocols.messages import requests
from ...protocols.messages.messages import Reflection
from ...protocols.messages.perception import ObstacleNews, RigMotion
from ...protocols.messages.rig import RigFault
from ...protocols.messages.telemetry import State
from ...protocols.proof import random_key
from ..client.protocol_client import Ask, NoLease, OnReply, ProtocolClient, Put, ignore
from ..client.reflection import ReflectingClient
from .generators import InsertionMotion, MasterHandle, ObstacleMotions, TargetMotion
from .script import (
    SCRIPT,
    SPOKEN,
    HandleMotion,
    LinkConditions,
    MovingMaster,
    MovingObstacle,
    Network,
    Raw,
    Script,
    Step,
    TopicMessage,
    in_order,
)

# --- Simulated connection of an operator: late, jittery, lossy, or cut ----------------------------
UNDISTURBED = LinkConditions()


class DelayLine:
    """Carries datagrams, of which the newest wins, and reliable messages, in order.

    A datagram that is lost is gone, and so is one that a newer one of its stream has overtaken. A
    reliable message that is lost is sent anew after a round trip, and holds up those behind it. The
    line draws from its own seed: the same calls at the same times are carried alike.
    """

    def __init__(self, seed: int = 1, conditions: LinkConditions = UNDISTURBED) -> None:
        self._draw = random.Random(seed)
        self._conditions = conditions
        self._underway: list[tuple[float, int, str | None, Callable[[], None]]] = []
        self._count = 0
        self._newest: dict[str, int] = {}
        self._reliable_s = 0.0

    def set(self, conditions: LinkConditions) -> None:
        """Carry under new conditions from now on; what is under way arrives as it was to."""
        self._conditions = conditions

    def carry(self, deliver: Callable[[], None], now_s: float, stream: str | None = None) -> None:
        """Carry a datagram of a stream; or a reliable message, where none is named."""
        now, self._count = self._conditions, self._count + 1
        if now.cut:
            return
        arrival_s = now_s + self._way(now)
        while now.loss and self._draw.random() < now.loss:
            if stream is not None:
                return
            arrival_s += 2.0 * self._way(now)
        if stream is None:
            arrival_s = self._reliable_s = max(arrival_s, self._reliable_s)
        if arrival_s <= now_s and not self._underway:
            self._arrive(self._count, stream, deliver)
        else:
            heapq.heappush(self._underway, (arrival_s, self._count, stream, deliver))

    def run(self, now_s: float) -> None:
        """Deliver what has arrived by now."""
        while self._underway and self._underway[0][0] <= now_s + 1e-9:
            self._arrive(*heapq.heappop(self._underway)[1:])

    def _way(self, now: LinkConditions) -> float:
        if not now.jitter:
            return now.delay_s
        return now.delay_s * (1.0 + now.jitter * self._draw.uniform(-1.0, 1.0))

    def _arrive(self, number: int, stream: str | None, deliver: Callable[[], None]) -> None:
        if stream is not None:
            if number < self._newest.get(stream, 0):
                return
            self._newest[stream] = number
        deliver()


# --- Operators of a script: each with a client, a connection of its own, and perhaps a handle -----
class Operators:
    """All operators of one script, by name; told the time and what the daemon sends."""

    def __init__(
        self,
        cell: str,
        put: Put,
        ask: Ask,
        network: Network,
        reflection: ReflectionSection | None,
        new_key: Callable[[], bytes],
    ) -> None:
        self._reflection = reflection
        self.handles: dict[str, ReflectingClient] = {}
        """By the operators' names, at most one each; none in a cell that reflects no forces."""
        self._cell, self._put, self._ask, self._new_key = cell, put, ask, new_key
        self._network = network
        self._now_s = 0.0
        self._lines: dict[str, DelayLine] = {}
        self._clients: dict[str, ProtocolClient] = {}
        self._masters: dict[str, MasterHandle] = {}

    def __iter__(self) -> Iterator[ProtocolClient]:
        return iter(self._clients.values())

    def __getitem__(self, name: str) -> ProtocolClient:
        """Return an operator's client; a new operator is connected first."""
        client = self._clients.get(name)
        if client is None:
            client = self._clients[name] = self._connected(name)
        return client

    def on_state(self, state: State) -> None:
        for client in self:
            arrive = partial(self._arrive, client, state)
            self._lines[client.name].carry(arrive, self._now_s, t.STATE.key)

    def on_reflection(self, news: Reflection) -> None:
        """Send the force of reflection down the line of every operator with a handle."""
        for name, handle in self.handles.items():
            feel = partial(self._feel, handle, news)
            self._lines[name].carry(feel, self._now_s, t.REFLECTION.key)

    def receive(self, now_s: float) -> None:
        """Deliver what has arrived on the lines by now."""
        self._now_s = now_s
        for line in self._lines.values():
            line.run(now_s)

    def run(self, now_s: float) -> None:
        """Move all handles on, and send keepalives and streams that are due."""
        for each in (*self.handles.values(), *self):
            each.run(now_s)

    def connect(self, name: str, to: LinkConditions) -> None:
        """Change an operator's connection; what is under way arrives as before."""
        self._lines[name].set(to)

    def move_master(self, name: str, step: MovingMaster) -> None:
        """Move an operator's master device on at a twist, and stream its pose."""
        master = self._masters.setdefault(name, MasterHandle())
        master.move(step.twist, step.expressed_in, self._now_s)
        self[name].stream_made(t.MASTER_POSE, master.fields)

    def move_device(self, name: str, step: HandleMotion) -> None:
        """Move an operator's reflecting handle. Raises `ValueError` in a cell without them."""
        client, handle = self[name], self.handles.get(name)
        if handle is None:
            if self._reflection is None:
                raise ValueError("device: the cell has no [reflection]")
            handle = self.handles[name] = ReflectingClient(self._reflection, self._now_s)
        handle.set_mode(step.mode or handle.mode, step.expressed_in or handle.axes)
        if step.hand is not None:
            handle.device.path.move(np.array(step.hand), step.seconds, self._now_s)
        if step.held is not None:
            handle.device.held = step.held
        posed = handle.mode == "pose"
        client.end_stream(t.JOYSTICK if posed else t.MASTER_POSE)
        client.stream_made(
            t.MASTER_POSE if posed else t.JOYSTICK, handle.pose if posed else handle.stick
        )

    def _arrive(self, client: ProtocolClient, state: State) -> None:
        client.on_state(state)
        if (handle := self.handles.get(client.name)) is not None:
            handle.on_state(state, self._now_s)

    def _feel(self, handle: ReflectingClient, news: Reflection) -> None:
        handle.on_reflection(news, self._now_s)

    def _connected(self, name: str) -> ProtocolClient:
        """Return a client whose connection is a line of its own, both ways."""
        network = self._network
        conditions = LinkConditions(
            delay_s=0.5 * network.rtt_s, jitter=network.jitter, loss=network.loss
        )
        line = self._lines[name] = DelayLine(network.seed + len(self._lines), conditions)

        def put(topic: t.Topic, payload: bytes, proof: bytes) -> None:
            if (handle := self.handles.get(name)) is not None:
                handle.trip.sent(topic.key, client.seq, self._now_s)
            line.carry(lambda: self._put(topic, payload, proof), self._now_s, topic.key)

        def ask(
            topic: t.Topic, payload: bytes, answer: Callable[[bytes], None], proof: bytes
        ) -> None:
            def back(reply: bytes) -> None:
                line.carry(lambda: answer(reply), self._now_s)

            line.carry(lambda: self._ask(topic, payload, back, proof), self._now_s)

        client = ProtocolClient(name, self._cell, put, ask, self._new_key)
        return client


# --- Plays a script: sends its messages and runs its generators when their time has come ----------
Inject = Callable[[RigFault | RigMotion], None]
"""Gives the virtual hardware a message: a fault, or a motion of what stands there."""

DUE_S = 1e-9  # a step is due this much before its time: sums of decimal fractions are not exact [s]


class Phase(Enum):
    """Progress of the player."""

    WAITING = auto()  # for telemetry to show a daemon that is READY
    ACQUIRING = auto()
    ENABLING = auto()
    PLAYING = auto()
    OVER = auto()
    FAILED = auto()


class Player:
    """Plays one script for one or more operators; told the time and the states that come in."""

    def __init__(
        self,
        script: Script,
        cell: str,
        put: Put,
        ask: Ask,
        inject: Inject,
        reflection: ReflectionSection | None = None,
        new_key: Callable[[], bytes] = random_key,
    ) -> None:
        self.script = script
        self.phase = Phase.WAITING
        self.start_s = 0.0  # beginning of the script's time, on the clock of `run`
        self.refused: list[str] = []  # steps that the daemon refused, with its reasons
        self.failure = ""
        self.on_step: Callable[[Step], None] = ignore
        """Called with every step just before it is done."""
        self.operators = Operators(cell, put, ask, script.network, reflection, new_key)
        self.client = self.operators["operator"]
        self._put, self._inject = put, inject
        self._obstacles = ObstacleMotions(self._tell, inject)
        self._targets: list[TargetMotion] = []
        self._steps = deque(script.steps)
        self._waiting: Step | None = None
        self._said = 0  # number of the newest message that was sent before the wait
        self._stands_s = 0.0  # so long the script's time has stood still [s]
        self._now_s = 0.0

    @property
    def over(self) -> bool:
        """True once the script is played, or cannot be."""
        return self.phase in (Phase.OVER, Phase.FAILED)

    def run(self, now_s: float) -> None:
        """Advance to `now_s`: deliver messages, do due steps, move generators."""
        self._now_s = now_s
        self.operators.receive(now_s)
        if self.phase is Phase.WAITING:
            self._begin(now_s)
        elif self.phase is Phase.ENABLING and self._mode == "enabled":
            self.phase, self.start_s = Phase.PLAYING, now_s
        if self.phase is Phase.PLAYING:
            while self._goes_on() and self._steps and self._time_s >= self._steps[0].at_s - DUE_S:
                self._do(self._steps.popleft())
            if self._waiting is None and self._time_s >= self.script.duration_s - DUE_S:
                self.phase = Phase.OVER if self.phase is Phase.PLAYING else self.phase
        if self.client.state is not None:
            try:
                self._obstacles.run(now_s, self.client.state.tick)
            except ValueError as error:
                self._fail(str(error))
        self.operators.run(now_s)
        for target in self._targets:
            target.run(now_s, self._tick, self._put, self._inject)

    def move(self, obstacle: MovingObstacle) -> None:
        """Move an obstacle beside the script: for a judge that plays its part."""
        self._obstacles.take(obstacle, self._now_s)

    @property
    def _time_s(self) -> float:
        """The script's own time [s]."""
        return self._now_s - self.start_s - self._stands_s

    def _goes_on(self) -> bool:
        """Return whether the script waits for nothing, now that it is looked at."""
        step = self._waiting
        if step is None or step.until is None:
            return self.phase is Phase.PLAYING
        state = self.operators[step.operator].state
        missing: str | None = "not heard yet"
        if state is not None and max(state.last_seq.values(), default=0) >= self._said:
            missing = step.until.missing(state)
        late = self._time_s - step.at_s >= step.until.timeout_s - DUE_S
        if missing is not None and not late:
            return False
        self._waiting, self._stands_s = None, self._now_s - self.start_s - step.at_s
        if missing is None:
            return True
        self._steps = deque(in_order(step.until.otherwise, step.at_s))
        if not self._steps:
            self._fail(f"{step.at_s:g} s: after {step.until.timeout_s:g} s: {missing}")
        return self.phase is Phase.PLAYING

    @property
    def _tick(self) -> int:
        return 0 if self.client.state is None else self.client.state.tick

    @property
    def _mode(self) -> str:
        return "" if self.client.state is None else self.client.state.mode

    # --- before time starts ------------------------------------------------------------------

    def _begin(self, now_s: float) -> None:
        if not self.script.auto_enable:
            if self.client.state is not None:
                self.phase, self.start_s = Phase.PLAYING, now_s
        elif self._mode in ("ready", "hold"):
            self.phase = Phase.ACQUIRING
            self.client.acquire(self._on_lease)
        elif self._mode == "fault":
            self._fail("the daemon is in FAULT: reset it first")

    def _on_lease(self, reply: requests.Reply) -> None:
        if not reply.ok:
            self._fail(f"no lease: {reply.reason}: {reply.detail}")
            return
        self.phase = Phase.ENABLING
        self.client.request(t.MODE, self._on_enabled, action="enable")

    def _on_enabled(self, reply: requests.Reply) -> None:
        if not reply.ok:
            self._fail(f"not enabled: {reply.reason}: {reply.detail}")

    def _fail(self, why: str) -> None:
        self.phase, self.failure = Phase.FAILED, why

    # --- steps -------------------------------------------------------------------------------

    def _do(self, step: Step) -> None:
        self.on_step(step)
        client = self.operators[step.operator]
        if client.state is None:
            client.state = self.client.state
        try:
            self._run(step, client)
        except NoLease as error:
            self.refused.append(f"{step.at_s:g} s: {error}")
        except ValueError as error:
            self._fail(f"{step.at_s:g} s: {error}")

    def _run(self, step: Step, client: ProtocolClient) -> None:
        if step.message is not None:
            topic = step.message.topic

            def note(reply: requests.Reply) -> None:
                if not reply.ok:
                    why = f"{reply.reason}: {reply.detail}"
                    self.refused.append(f"{step.at_s:g} s: {topic.key}: {why}")

            self._send(step.message, client, note)
        for stream in step.silence:
            key, _, named = stream.partition(":")
            client.end_stream(SPOKEN[key], named or None)
        if step.link is not None:
            self.operators.connect(client.name, step.link)
        if step.master is not None:
            self.operators.move_master(client.name, step.master)
        if step.device is not None:
            self.operators.move_device(client.name, step.device)
        if step.target is not None:
            self._targets.append(TargetMotion(step.target, self._now_s))
        if step.insertion is not None:
            motion, task = InsertionMotion(step.insertion), step.insertion.task
            client.stream_made(
                t.JOYSTICK, lambda now_s: motion.fields(now_s, client.state), named=task
            )
        if step.obstacle is not None:
            self._obstacles.take(step.obstacle, self._now_s)
        if step.raw is not None:
            self._put_raw(step.raw, client)
        if step.until is not None:
            self._waiting, self._said = step, client.seq

    def _send(self, message: TopicMessage, client: ProtocolClient, on_reply: OnReply) -> None:
        topic = message.topic
        if topic.flow.sender is t.Role.OPERATOR:
            client.send(topic, on_reply, **message.fields)
            return
        made = message.make(self._tick)
        if isinstance(made, RigFault | RigMotion):
            self._inject(made)
        else:
            self._put(topic.by(SCRIPT), encode(made), b"")

    def _put_raw(self, raw: Raw, client: ProtocolClient) -> None:
        topic = next(x for x in t.TOPICS if x.key == raw.topic)
        payload, proven = bytes.fromhex(raw.hex), raw.proof == "lease"
        proof = client.prove(topic, payload) if proven else bytes.fromhex(raw.proof)
        self._put(topic, payload, proof)

    def _tell(self, news: ObstacleNews) -> None:
        self._put(t.OBSTACLE.by(SCRIPT), encode(news), b"")
