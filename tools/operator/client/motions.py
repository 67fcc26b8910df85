"""Motions of an operator: paths, the master's clutch and scale, frames, the null space."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

from ....protocols import topics as t
from ....protocols.messages import messages as m
from ....protocols.messages import requests


class Motions(ABC):
    """The part of an operator that leads motions; how it sends is its heir's."""

    @abstractmethod
    def command(self, topic: t.Topic, **fields: Any) -> None:
        """Send any command."""

    @abstractmethod
    def request(self, topic: t.Topic, **fields: Any) -> requests.Reply:
        """Send any request and return its reply."""

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
