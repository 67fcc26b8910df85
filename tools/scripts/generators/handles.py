"""Reflecting handles of a script's operators."""

import numpy as np

from ....config.schema.network import ReflectionSection
from ....protocols import topics as t
from ....protocols.messages.telemetry import State
from ...client.protocol_client import ProtocolClient
from ...reflect.client import ReflectingClient
from .tables import HandleMotion


class Handles:
    """At most one handle for each operator; none in a cell that reflects no forces."""

    def __init__(self, config: ReflectionSection | None) -> None:
        self._config = config
        self.of_operator: dict[str, ReflectingClient] = {}
        """By the operators' names."""

    def take(self, step: HandleMotion, client: ProtocolClient, now_s: float) -> None:
        """Move a handle as a step says. Raises `ValueError` in a cell that reflects no forces."""
        handle = self.of_operator.get(client.name)
        if handle is None:
            if self._config is None:
                raise ValueError("device: the cell has no [reflection]")
            handle = self.of_operator[client.name] = ReflectingClient(self._config, now_s)
        handle.set_mode(step.mode or handle.mode, step.expressed_in or handle.axes)
        if step.hand is not None:
            handle.device.path.move(np.array(step.hand), step.seconds, now_s)
        if step.held is not None:
            handle.device.held = step.held
        if handle.mode == "pose":
            client.end_stream(t.JOYSTICK)
            client.stream_made(t.MASTER_POSE, handle.pose)
        else:
            client.end_stream(t.MASTER_POSE)
            client.stream_made(t.JOYSTICK, handle.stick)

    def sent(self, name: str, topic: t.Topic, seq: int, now_s: float) -> None:
        """Note that an operator sent a command."""
        handle = self.of_operator.get(name)
        if handle is not None:
            handle.trip.sent(topic.key, seq, now_s)

    def on_state(self, name: str, state: State, now_s: float) -> None:
        """Hand an operator's handle a state that has reached that operator."""
        handle = self.of_operator.get(name)
        if handle is not None:
            handle.on_state(state, now_s)

    def run(self, now_s: float) -> None:
        """Let all handles move on to now."""
        for handle in self.of_operator.values():
            handle.run(now_s)
