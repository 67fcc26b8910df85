"""One task of a cell, led through an operator's session: what it sends names the task."""

from collections.abc import Callable
from typing import Any

from ...protocols import topics as t
from ...protocols.messages import requests
from ...protocols.messages.messages import MechanismCommand, TaskCommand
from ...protocols.messages.telemetry import State, TaskDescription, TaskState
from .motions import Motions


class TaskClient(Motions):
    """Leads a task; `operator.task(NAME)` makes one. Lease and mode are the operator's."""

    def __init__(self, operator: Motions, description: TaskDescription) -> None:
        self._operator = operator
        self.description = description

    @property
    def name(self) -> str:
        """Name of the task."""
        return self.description.task

    def command(self, topic: t.Topic, **fields: Any) -> None:
        """Send any command for this task, or its mechanism. Raises as the operator's does."""
        self._operator.command(topic, **self._named(topic), **fields)

    def request(self, topic: t.Topic, **fields: Any) -> requests.Reply:
        """Send any request for this task, or its mechanism. Raises `OperatorError`."""
        return self._operator.request(topic, **self._named(topic), **fields)

    def stream(self, topic: t.Topic, **fields: Any) -> None:
        """Keep sending a command for this task at 100 Hz. Raises as the operator's does."""
        self._operator.stream(topic, **self._named(topic), **fields)

    def end_stream(self, topic: t.Topic, named: str | None = None) -> None:
        """Fall silent on a topic, for this task."""
        for own in self._named(topic).values():
            self._operator.end_stream(topic, named or own)

    def spin(self, seconds: float = 0.0, until: Callable[[], bool] | None = None) -> bool:
        """Keep the session alive for a while, or until something holds; return whether it did."""
        return self._operator.spin(seconds, until)

    def need_lease(self) -> None:
        """Raise `OperatorError` without the lease."""
        self._operator.need_lease()

    def task_state(self) -> TaskState | None:
        """Return the newest state of the task."""
        state = self.cell_state
        return None if state is None else state.of(self.name)

    @property
    def cell_state(self) -> State | None:
        """The newest state of the cell."""
        return self._operator.cell_state

    @property
    def sent(self) -> int:
        """Number of the newest message that was sent."""
        return self._operator.sent

    def _named(self, topic: t.Topic) -> dict[str, str]:
        if issubclass(topic.message, TaskCommand):
            return {"task": self.name}
        if issubclass(topic.message, MechanismCommand):
            return {"mechanism": self.description.mechanism}
        return {}
