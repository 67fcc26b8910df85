"""Motions of a task: stick, targets, postures, paths, master, frames, the null space."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

from ...protocols import topics as t
from ...protocols.messages import messages as m
from ...protocols.messages import requests
from ...protocols.messages.telemetry import State, TaskState


class Motions(ABC):
    """Base of a client that leads the motions of one task; subclasses say how it sends."""

    @abstractmethod
    def command(self, topic: t.Topic, **fields: Any) -> None:
        """Send any command."""

    @abstractmethod
    def request(self, topic: t.Topic, **fields: Any) -> requests.Reply:
        """Send any request and return its reply."""

    @abstractmethod
    def stream(self, topic: t.Topic, **fields: Any) -> None:
        """Keep sending a command at 100 Hz."""

    @abstractmethod
    def end_stream(self, topic: t.Topic, named: str | None = None) -> None:
        """Fall silent on a topic, for a task or mechanism; without a name, for all."""

    @abstractmethod
    def spin(self, seconds: float = 0.0, until: Callable[[], bool] | None = None) -> bool:
        """Keep the session alive for a while, or until something holds; return whether it did."""

    @abstractmethod
    def need_lease(self) -> None:
        """Raise `OperatorError` without the lease."""

    @abstractmethod
    def task_state(self) -> TaskState | None:
        """Return the newest state of the task."""

    @property
    @abstractmethod
    def cell_state(self) -> State | None:
        """The newest state of the cell."""

    @property
    @abstractmethod
    def sent(self) -> int:
        """Number of the newest message that was sent."""

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
        self.stream(
            t.JOYSTICK,
            twist=tuple(twist),
            expressed_in=m.Frame(expressed_in),
            relative_to=m.Frame(relative_to),
        )
        if seconds > 0.0:
            self.spin(seconds)
            self.end_stream(t.JOYSTICK)
            self.need_lease()

    def drive(self, speed: float, turn: float | None = None, seconds: float = 0.0) -> None:
        """Drive a mechanism as a whole: a base on wheels, or an arm into its tunnels.

        With a `turn`, a base goes ahead at `speed` [m/s] and turns to the left [rad/s]. Without,
        an arm is inserted at `speed`, or withdrawn with a negative one. For a while; with `seconds`
        0, until told otherwise (and only while `spin` is called). Raises as `joystick` does.
        """
        self.stream(t.DRIVE, rates=(speed,) if turn is None else (speed, turn))
        if seconds > 0.0:
            self.spin(seconds)
            self.end_stream(t.DRIVE)
            self.need_lease()

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

    def store_view(self, camera: str | None = None) -> None:
        """Make what a camera sees now the view that the vision source keeps.

        Without a name: of the camera whose view is kept. Raises `OperatorError` where it sees
        nothing. The source moves nothing before it is switched on.
        """
        self.request(t.STORE_VIEW, camera=camera)

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
