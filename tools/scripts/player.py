"""Plays a script: sends its messages and runs its generators when their time has come."""

from collections import deque
from collections.abc import Callable
from enum import Enum, auto

from ...config.schema.network import ReflectionSection
from ...protocols import topics as t
from ...protocols.codec import encode
from ...protocols.messages import requests
from ...protocols.messages.messages import Reflection
from ...protocols.messages.perception import ObstacleNews, RigMotion
from ...protocols.messages.rig import RigFault
from ...protocols.messages.telemetry import State
from ...protocols.proof import random_key
from ..client.protocol_client import Ask, NoLease, OnReply, ProtocolClient, Put
from .generators.insertion import InsertionMotion
from .generators.obstacles import ObstacleMotions
from .generators.tables import SCRIPT, MovingObstacle, Raw
from .generators.targets import TargetMotion
from .message import SPOKEN, TopicMessage
from .operators import Operators
from .script import Script
from .step import Step

Inject = Callable[[RigFault | RigMotion], None]
"""Gives the virtual hardware a message: a fault, or a motion of what stands there."""

DUE_S = 1e-9
"""A step is due this much before its time: sums of decimal fractions are not exact [s]."""


class Phase(Enum):
    """Progress of the player."""

    WAITING = auto()
    """For telemetry to show a daemon that is READY."""
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
        self.start_s = 0.0
        """Beginning of the script's time, on the clock of `run`."""
        self.refused: list[str] = []
        """Steps that the daemon refused, with its reasons."""
        self.failure = ""
        self.on_step: Callable[[Step], None] = _ignore
        """Called with every step just before it is done."""
        self.operators = Operators(cell, put, ask, script.network, reflection, new_key)
        self.client = self.operators["operator"]
        self._put, self._inject = put, inject
        self._obstacles = ObstacleMotions(self._tell, inject)
        self._targets: list[TargetMotion] = []
        self._steps = deque(script.steps)
        self._now_s = 0.0

    @property
    def over(self) -> bool:
        """True once the script is played, or cannot be."""
        return self.phase in (Phase.OVER, Phase.FAILED)

    def on_state(self, state: State) -> None:
        """Take in a state."""
        self.operators.on_state(state)

    def on_reflection(self, news: Reflection) -> None:
        """Take in the force that handles shall push with."""
        self.operators.on_reflection(news)

    def run(self, now_s: float) -> None:
        """Advance to `now_s`: deliver messages, do due steps, move generators."""
        self._now_s = now_s
        self.operators.receive(now_s)
        if self.phase is Phase.WAITING:
            self._begin(now_s)
        elif self.phase is Phase.ENABLING and self._mode == "enabled":
            self.phase, self.start_s = Phase.PLAYING, now_s
        if self.phase is Phase.PLAYING:
            while self._steps and now_s >= self.start_s + self._steps[0].at_s - DUE_S:
                self._do(self._steps.popleft())
            if now_s >= self.start_s + self.script.duration_s - DUE_S:
                self.phase = Phase.OVER
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
    def _tick(self) -> int:
        """The newest telemetry tick."""
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
            self._send(step.message, client, self._noted(step.at_s, step.message.topic))
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

    def _noted(self, at_s: float, topic: t.Topic) -> OnReply:
        """Return what notes a refusal of a topic's message."""

        def note(reply: requests.Reply) -> None:
            if not reply.ok:
                self.refused.append(f"{at_s:g} s: {topic.key}: {reply.reason}: {reply.detail}")

        return note


def _ignore(_step: Step) -> None:
    """Stand in for a listener."""
