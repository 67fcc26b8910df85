"""Leads an arm through attitudes and averages its sensor in each; given every state.

The same guide leads a real daemon, in wall time, and a simulated one, in virtual time: it knows no
clock but that of the states.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ...protocols import topics as t
from ...protocols.messages import messages as m
from ...protocols.messages import requests
from ...protocols.messages.telemetry import State, TaskState
from ...server.control.spatial import Array
from ..client.protocol_client import NoLease, ProtocolClient
from .attitudes import AttitudeStop
from .subject import Subject

SETTLE_S = 0.4
"""From arrival until the sensor is believed [s]."""
AVERAGE_S = 0.6
"""The sensor is averaged for this long [s]."""
ARRIVE_S = 30.0
"""A posture that is not reached by then will not be [s]."""


@dataclass
class AttitudeMean:
    """Means over one attitude."""

    q: Array
    """Measured joints (n,) [rad]."""
    wrench: Array
    """The sensor's reading, exerted sign (6,) [N, N·m]."""


@dataclass
class Guide:
    """Goes from stop to stop. `say` is told, in a line, how far it is."""

    client: ProtocolClient
    stops: list[AttitudeStop]
    say: Callable[[str], None] = lambda _line: None
    subject: Subject | None = None
    """The arm that it leads; None: the only one."""
    samples: list[AttitudeMean] = field(default_factory=list)
    failure: str = ""
    """Reason of a failure."""
    over: bool = False
    _at: int = -1
    _asked_seq: int = 0
    _since_s: float = 0.0
    _arrived_s: float | None = None
    _heard: list[tuple[tuple[float, ...], m.Vector6]] = field(default_factory=list)
    _allowed: bool = False

    def run(self, state: State) -> None:
        """Take in a state: average, or go on to the next attitude."""
        if self.over:
            return
        try:
            self._run(state)
        except NoLease as error:
            self._fail(str(error))

    def _run(self, state: State) -> None:
        if state.mode != "enabled":
            self._fail(f"mode became {state.mode}")
        elif self._at < 0:
            # Its weight is no contact to force control, and no push to collision detection.
            self._at = 0
            self.client.request(t.PAYLOAD, self._on_told, unknown=True, mechanism=self._mechanism)
        elif not self._allowed:
            return
        elif self._since_s == 0.0:
            self._leave(state)
        elif self._arrived_s is None:
            self._travel(state)
        elif state.time_s >= self._arrived_s + SETTLE_S:
            self._listen(state)

    def _on_told(self, reply: requests.Reply) -> None:
        self._allowed = reply.ok
        if not reply.ok:
            self._fail(f"{reply.reason}: {reply.detail}")

    def _leave(self, state: State) -> None:
        q = tuple(self.stops[self._at].q.tolist())
        self.client.command(t.POSTURE, q=q, mechanism=self._mechanism)
        self._asked_seq, self._since_s = self.client.seq, state.time_s
        self._arrived_s = None
        self._heard.clear()

    def _travel(self, state: State) -> None:
        if state.last_seq.get(t.POSTURE.key, 0) >= self._asked_seq and self._of(state).at_goal:
            self._arrived_s = state.time_s
            if not self.stops[self._at].measure:
                self._next()
        elif state.time_s > self._since_s + ARRIVE_S:
            self._fail(f"posture not reached within {ARRIVE_S:g} s")

    def _listen(self, state: State) -> None:
        wrench_sensor = self._of(state).wrench_sensor
        if wrench_sensor is None:
            self._fail("the force/torque sensor is stale or missing")
            return
        joints = slice(None) if self.subject is None else self.subject.joints
        self._heard.append((state.q[joints], wrench_sensor))
        if self._arrived_s is not None and state.time_s >= self._arrived_s + SETTLE_S + AVERAGE_S:
            q, wrench = (np.mean(part, axis=0) for part in zip(*self._heard, strict=True))
            self.samples.append(AttitudeMean(q, wrench))
            wanted = sum(stop.measure for stop in self.stops)
            self.say(f"attitude {len(self.samples)} of {wanted}")
            self._next()

    @property
    def _mechanism(self) -> str | None:
        return None if self.subject is None else self.subject.mechanism

    def _of(self, state: State) -> TaskState:
        return state.of(None if self.subject is None else self.subject.task)

    def _next(self) -> None:
        self._at += 1
        self._since_s = 0.0
        if self._at == len(self.stops):
            self._end()

    def _fail(self, why: str) -> None:
        self.failure = why
        self._end()

    def _end(self) -> None:
        self.over = True
        if self._allowed:
            self.say("force control waits until the payload is told (operator/payload), or a tare")
