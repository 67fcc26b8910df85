"""The reflecting handles of a script's operators, as its steps have them."""

import numpy as np

from ...config.schema.reflection import Reflection as Config
from ...protocols import topics as t
from ...protocols.messages import messages as m
from ..operator.client.protocol_client import Pilot
from ..reflect.client import ReflectingClient
from .steps import DeviceStep


class Handles:
    """At most one handle for each operator; none in a cell that reflects no forces."""

    def __init__(self, config: Config | None) -> None:
        self._config = config
        self.clients: dict[str, ReflectingClient] = {}
        """By the operators' names."""

    def take(self, step: DeviceStep, pilot: Pilot, now_s: float) -> None:
        """Do what a step says. Raises `ValueError` in a cell that reflects no forces."""
        client = self.clients.get(pilot.name)
        if client is None:
            if self._config is None:
                raise ValueError("device: the cell has no [reflection]")
            client = self.clients[pilot.name] = ReflectingClient(self._config, now_s)
        client.set_mode(step.mode or client.mode, step.expressed_in or client.axes)
        if step.hand is not None:
            client.device.path.move(np.array(step.hand), step.seconds, now_s)
        if step.held is not None:
            client.device.held = step.held
        if client.mode == "pose":
            pilot.end_stream(t.JOYSTICK)
            pilot.stream_made(t.MASTER_POSE, client.pose)
        else:
            pilot.end_stream(t.MASTER_POSE)
            pilot.stream_made(t.JOYSTICK, client.stick)

    def sent(self, name: str, topic: t.Topic, seq: int, now_s: float) -> None:
        """Note that an operator sent a command."""
        client = self.clients.get(name)
        if client is not None:
            client.trip.sent(topic.key, seq, now_s)

    def on_state(self, name: str, state: m.State, now_s: float) -> None:
        """Hand an operator's handle a state that has reached that operator."""
        client = self.clients.get(name)
        if client is not None:
            client.on_state(state, now_s)

    def run(self, now_s: float) -> None:
        """Let all handles move on to now."""
        for client in self.clients.values():
            client.run(now_s)
