"""Plays a script: clients do what its steps say, when their time has come."""

from collections import deque
from collections.abc import Callable
from enum import Enum, auto
from functools import partial

from ...config.schema.reflection import Reflection as ReflectionConfig
from ...protocols import topics as t
from ...protocols.agreement import random_key
from ...protocols.codec import encode
from ...protocols.messages import messages as m
from ...protocols.messages import requests
from ...protocols.messages.moving import RigMotion
from ...protocols.messages.obstacles import ObstacleNews
from ...protocols.messages.reflection import Reflection
from ...protocols.messages.rig import RigFault
from ..operator.client.protocol_client import Ask, NoLease, ProtocolClient, Put
from ..reflect.client import ReflectingClient
from .delay_line import Conditions, DelayLine
from .handles import Handles
from .incidents import ObstacleStep
from .master import MovingMaster
from .moving_target import MovingTarget
from .obstacles import MovingObstacles
from .script import Script, Step
from .steps import MasterStep, WrenchStep

Inject = Callable[[RigFault | RigMotion], None]
"""Injects a fault into the virtual hardware, or moves what stands there."""


class Phase(Enum):
    """How far the player is."""

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
        reflection: ReflectionConfig | None = None,
        new_key: Callable[[], bytes] = random_key,
    ) -> None:
        self.script = script
        self.phase = Phase.WAITING
        self.start_s = 0.0
        """When the script's time began, on the clock of `run`."""
        self.refused: list[str] = []
        """What the daemon refused, and why."""
        self.failure = ""
        self._cell, self._new_key = cell, new_key
        self._put, self._ask, self._inject = put, ask, inject
        self._links: dict[str, DelayLine] = {}
        self._clients: dict[str, ProtocolClient] = {}
        self._masters: dict[str, MovingMaster] = {}
        self._obstacles = MovingObstacles(self._tell, inject)
        self._targets: list[MovingTarget] = []
        self.handles = Handles(reflection)
        self._steps = deque(script.steps)
        self._now_s = 0.0
        self.client = self._client("operator")

    @property
    def over(self) -> bool:
        """True once the script is played, or cannot be."""
        return self.phase in (Phase.OVER, Phase.FAILED)

    def on_state(self, state: m.State) -> None:
        """Take in a state."""
        for client in self._clients.values():
            arrive = partial(self._arrive, client, state)
            self._links[client.name].carry(arrive, self._now_s, t.STATE.key)

    def on_reflection(self, news: Reflection) -> None:
        """Take in what handles shall push with."""
        for name, device in self.handles.of_operator.items():
            arrive = partial(self._feel, device, news)
            self._links[name].carry(arrive, self._now_s, t.REFLECTION.key)

    def _arrive(self, client: ProtocolClient, state: m.State) -> None:
        client.on_state(state)
        self.handles.on_state(client.name, state, self._now_s)

    def _feel(self, device: ReflectingClient, news: Reflection) -> None:
        device.on_reflection(news, self._now_s)

    def run(self, now_s: float) -> None:
        """Do what is due at `now_s`."""
        self._now_s = now_s
        for line in self._links.values():
            line.run(now_s)
        if self.phase is Phase.WAITING:
            self._begin(now_s)
        elif self.phase is Phase.ENABLING and self._mode == "enabled":
            self.phase, self.start_s = Phase.PLAYING, now_s
        if self.phase is Phase.PLAYING:
            while self._steps and now_s >= self.start_s + self._steps[0].at_s - 1e-9:
                self._do(self._steps.popleft())
            if now_s >= self.start_s + self.script.duration_s - 1e-9:
                self.phase = Phase.OVER
        if self.client.state is not None:
            try:
                self._obstacles.run(now_s, self.client.state.tick)
            except ValueError as error:
                self._fail(str(error))
        self.handles.run(now_s)
        for client in self._clients.values():
            client.run(now_s)
        for target in self._targets:
            target.run(now_s, self._tick, self._put, self._inject)

    def move(self, step: ObstacleStep) -> None:
        """Move an obstacle beside the script: for a judge that plays its part."""
        self._obstacles.take(step, self._now_s)

    @property
    def _tick(self) -> int:
        """The newest telemetry tick."""
        return 0 if self.client.state is None else self.client.state.tick

    @property
    def _mode(self) -> str:
        return "" if self.client.state is None else self.client.state.mode

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

    def _client(self, name: str) -> ProtocolClient:
        client = self._clients.get(name)
        if client is None:
            client = self._clients[name] = self._connected(name)
        return client

    def _connected(self, name: str) -> ProtocolClient:
        """Return a client whose connection is a line of its own, both ways."""
        network = self.script.network
        conditions = Conditions(0.5 * network.rtt_s, network.jitter, network.loss)
        line = self._links[name] = DelayLine(network.seed + len(self._links), conditions)

        def put(topic: t.Topic, payload: bytes, proof: bytes) -> None:
            self.handles.sent(name, topic, client.seq, self._now_s)
            line.carry(lambda: self._put(topic, payload, proof), self._now_s, topic.key)

        def ask(
            topic: t.Topic, payload: bytes, answer: Callable[[bytes], None], proof: bytes
        ) -> None:
            def back(reply: bytes) -> None:
                line.carry(lambda: answer(reply), self._now_s)

            line.carry(lambda: self._ask(topic, payload, back, proof), self._now_s)

        client = ProtocolClient(name, self._cell, put, ask, self._new_key)
        return client

    def _do(self, step: Step) -> None:
        client = self._client(step.operator)
        if client.state is None:
            client.state = self.client.state
        try:
            self._speak(step, client)
        except NoLease as error:
            self.refused.append(f"{step.at_s:g} s: {error}")

    def _speak(self, step: Step, client: ProtocolClient) -> None:
        def ask(topic: t.Topic, **fields: object) -> None:
            client.request(topic, self._note(step, topic), **fields)

        if step.lease == "acquire":
            client.acquire(self._note(step, t.LEASE))
        elif step.lease == "release":
            client.release(self._note(step, t.RELEASE))
        if step.link is not None:
            link = step.link
            conditions = Conditions(link.delay_s, link.jitter, link.loss, link.cut)
            self._links[client.name].set(conditions)
        if step.mode is not None:
            ask(t.MODE, action=step.mode)
        if step.protective_stop is True:
            client.protective_stop(self._note(step, t.PROTECTIVE_STOP))
        elif step.protective_stop is False:
            client.clear_protective_stop(self._note(step, t.PROTECTIVE_CLEAR))
        if step.speed is not None:
            ask(t.SPEED, factor=step.speed)
        if step.store_view is not None:
            ask(t.STORE_VIEW, camera=step.store_view)
        if step.gain is not None:
            ask(t.GAIN, **dict(step.gain))
        if step.switch is not None:
            ask(t.SWITCH, **dict(step.switch))
        if step.frame is not None:
            ask(t.FRAME, **dict(step.frame))
        if step.payload is not None:
            ask(t.PAYLOAD, **dict(step.payload))
        if step.gripper is not None:
            ask(t.GRIPPER, closed=step.gripper == "close")
        if step.tare:
            ask(t.TARE)
        if step.acknowledge_load:
            ask(t.ACKNOWLEDGE_LOAD)
        if step.redundancy is not None:
            ask(t.REDUNDANCY, **dict(step.redundancy))
        if step.clutch is not None:
            ask(t.CLUTCH, **dict(step.clutch))
        if step.reflection is not None:
            ask(t.REFLECT, protected=step.reflection.protected)
        if step.path_control is not None:
            ask(t.PATH_CONTROL, action=step.path_control)
        if step.cancel:
            client.command(t.CANCEL)
        self._command(step, client)
        if step.target is not None:
            self._targets.append(MovingTarget(step.target, self._now_s))
        if step.raw is not None:
            topic = next(x for x in t.TOPICS if x.key == step.raw.topic)
            payload, proof = bytes.fromhex(step.raw.hex), step.raw.proof
            proven = proof == "lease"
            attached = client.prove(topic, payload) if proven else bytes.fromhex(proof)
            self._put(topic, payload, attached)
        if step.avoidance is not None:
            ask(t.AVOIDANCE, on=step.avoidance)
        if step.obstacle is not None:
            self._obstacles.take(step.obstacle, self._now_s)
        try:
            if step.fault is not None:
                self._inject(RigFault(**dict(step.fault)))
            if step.platform is not None:
                self._inject(RigMotion(target="platform", **dict(step.platform)))
            if step.carrier is not None:
                self._inject(RigMotion(target="carrier", **dict(step.carrier)))
        except ValueError as error:
            self._fail(f"{step.at_s:g} s: {error}")

    def _command(self, step: Step, client: ProtocolClient) -> None:
        if step.joystick is not None:
            if step.joystick.twist is None:
                client.end_stream(t.JOYSTICK)
            else:
                client.stream(t.JOYSTICK, **dict(step.joystick))
        if step.jog is not None:
            if step.jog.rates is None:
                client.end_stream(t.JOG)
            else:
                client.stream(t.JOG, **dict(step.jog))
        if step.position is not None:
            client.command(t.POSITION, **dict(step.position))
        if isinstance(step.posture, str):
            client.command(t.POSTURE, posture=step.posture)
        elif step.posture is not None:
            client.command(t.POSTURE, q=step.posture)
        if step.path is not None:
            client.command(t.PATH, **dict(step.path))
        if step.master is not None:
            self._move_master(step.master, client)
        if step.device is not None:
            try:
                self.handles.take(step.device, client, self._now_s)
            except ValueError as error:
                self._fail(f"{step.at_s:g} s: {error}")
        if isinstance(step.force, WrenchStep):
            client.command(t.FORCE, **dict(step.force))
        elif step.force is not None:
            client.command(t.FORCE, wrench=step.force)

    def _move_master(self, step: MasterStep, client: ProtocolClient) -> None:
        if step.twist is None:
            client.end_stream(t.MASTER_POSE)
            return
        master = self._masters.setdefault(client.name, MovingMaster())
        master.move(step.twist, step.expressed_in, self._now_s)
        client.stream_made(t.MASTER_POSE, master.fields)

    def _tell(self, news: ObstacleNews) -> None:
        self._put(t.OBSTACLE, encode(news), b"")

    def _note(self, step: Step, topic: t.Topic) -> Callable[[requests.Reply], None]:
        def note(reply: requests.Reply) -> None:
            if not reply.ok:
                self.refused.append(f"{step.at_s:g} s: {topic.key}: {reply.reason}: {reply.detail}")

        return note
