"""Remote operator over Zenoh: `telerobot.Operator`, for a user's own scripts.

with Operator("pa10") as operator:
    operator.acquire()
    operator.enable()
    operator.joystick([0.02, 0, 0, 0, 0, 0], seconds=2.0)

Where the cell has several tasks, it leads the first; `operator.task(NAME)` leads another.
"""

from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any, Self

from ...drivers.network.session import REPLY_TIMEOUT_S
from ...protocols import topics as t
from ...protocols.messages import requests
from ...protocols.messages.telemetry import State, TaskState
from .connection import Connection, OperatorError
from .motions import Motions
from .protocol_client import NoLease, OnReply
from .task import TaskClient

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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

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

    def request(self, topic: t.Topic, **fields: Any) -> requests.Reply:
        """Send any request and return its reply. Raises `OperatorError` when refused."""
        return self._wait(lambda on_reply: self.client.request(topic, on_reply, **fields))

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

    def stream(self, topic: t.Topic, **fields: Any) -> None:
        """Keep sending a command at 100 Hz, inside `spin`, until the next call or `end_stream`.

        Raises `OperatorError` without the lease, `ValueError` for fields that its message does not
        take.
        """
        self.need_lease()
        self.client.stream(topic, **fields)

    def end_stream(self, topic: t.Topic, named: str | None = None) -> None:
        """Fall silent on a topic, for a task or mechanism; without a name, for all."""
        self.client.end_stream(topic, named)

    def task_state(self) -> TaskState | None:
        """Return the newest state of the task that commands without a name are for."""
        return None if self.state is None else self.state.of(None)

    @property
    def cell_state(self) -> State | None:
        """The newest state of the cell."""
        return self.state

    @property
    def sent(self) -> int:
        """Number of the newest message that was sent."""
        return self.client.seq

    def command(self, topic: t.Topic, **fields: Any) -> None:
        """Send any command. Raises `OperatorError` without the lease, `ValueError` for fields that
        its message does not take.
        """
        self.need_lease()
        self.client.command(topic, **fields)

    def close(self) -> None:
        """Release the lease, if held, and end the session."""
        if self.holds_lease and not self.client.mute:
            try:
                self.release()
            except OperatorError:
                self.client.secret = None  # it has run out already: there is nothing to release
        super().close()

    def need_lease(self) -> None:
        """Raise `OperatorError` without the lease."""
        if not self.holds_lease:
            raise OperatorError("no_lease", f"{self.client.name} does not hold the lease")

    def _wait(self, send: Callable[[OnReply], None]) -> requests.Reply:
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
