"""The frames of a cell as a small tree: where each is, and how it moves, seen from any other.

    World ─┬─ Base ── Wrist ─┬─ MRF
           │                 ├─ Sensor
           │                 └─ Lens, of a carried camera
           ├─ Carrier
           └─ Lens, of a camera that stands in World (or on Base)

The CRF is fixed to its *ground*: World, Base or Carrier. Base and Carrier may move; what their
news says is in `Moved`. The one place that resolves a frame's name.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from .spatial import Array, Pose, cross

GROUNDS: Final = ("world", "base", "carrier")
"""Frames that the CRF may be fixed to, and that a goal may be measured against for good."""

FRAMES: Final = (*GROUNDS, "crf", "wrist", "mrf", "sensor", "lens")


class UnknownFrame(Exception):
    """A cell lacks the frame of that name; the text says which there are."""


class Body(NamedTuple):
    """Where a rigid thing is in World, and its twist (6,) at its origin in World axes."""

    T: Pose
    twist: Array

    @staticmethod
    def standing(T: Pose) -> "Body":
        """Return a thing that stands at T."""
        return Body(T, np.zeros(6))

    def twist_at(self, p: Array) -> Array:
        """Return its twist (6,) at a point p (3,) of World, in World axes."""
        twist = self.twist.copy()
        twist[:3] += cross(twist[3:], p - self.T.p)
        return twist


class Moved(NamedTuple):
    """The grounds that may move, at the instant that this tick's command is for."""

    base: Body
    carrier: Body
    T_world_base_measured: Pose
    """Base when the joints were measured: a little earlier than `base`."""
    acceleration_base: Array | None = None
    """(6,) of its origin, World axes, where it is known."""

    def body(self, ground: str) -> Body | None:
        """Return a ground that may move, None for World."""
        if ground == "world":
            return None
        return self.base if ground == "base" else self.carrier

    def acceleration_at(self, p: Array) -> Array:
        """Return how a point p (3,) of World that is fixed to Base accelerates (3,) [m/s²]."""
        if self.acceleration_base is None:
            return np.zeros(3)
        a, r, w = self.acceleration_base, p - self.base.T.p, self.base.twist[3:]
        return np.asarray(a[:3] + cross(a[3:], r) + cross(w, cross(w, r)))

    def carries(self, ground: str, p: Array) -> Array:
        """Return a ground's twist (6,) seen from Base, at a point p (3,) of World, World axes.

        It is what an arm on Base has to do so that a tool at p stands still on that ground.
        """
        body = self.body(ground)
        seen = -self.base.twist_at(p)
        return seen if body is None else body.twist_at(p) + seen


class Mount(NamedTuple):
    """A frame's place on another one."""

    on: str
    T: Pose


@dataclass(frozen=True)
class FrameTree:
    """Every frame at one instant."""

    moved: Moved
    T_world_mrf: Pose
    T_wrist_mrf: Pose
    crf: Mount
    T_wrist_sensor: Pose | None = None
    lens: Mount | None = None
    twist_wrist: Array | None = None
    """Of the Wrist at its origin, World axes (6,); None: as far as Base carries it."""

    def pose(self, frame: str, seen_from: str = "world") -> Pose:
        """Return T_seen_from_frame. Raises `UnknownFrame`."""
        T = self._in_world(frame)
        return T if seen_from == "world" else self._in_world(seen_from).inverse() @ T

    def twist(self, frame: str, seen_from: str = "world", at: Array | None = None) -> Array:
        """Return the twist (6,) of a frame seen from another, in World axes.

        Taken at the point `at` (3,) of World, by default the frame's origin. Raises `UnknownFrame`.
        """
        p = self._in_world(frame).p if at is None else at
        return self._carrier_of(frame).twist_at(p) - self._carrier_of(seen_from).twist_at(p)

    def ground(self, frame: str) -> str:
        """Return what stands still for a motion relative to a frame: one of `GROUNDS`.

        What the arm itself carries, and a Lens, are measured against once: what follows is relative
        to the CRF's ground.
        """
        return frame if frame in GROUNDS else self.crf.on

    def _in_world(self, frame: str) -> Pose:
        match frame:
            case "world":
                return Pose.identity()
            case "base":
                return self.moved.base.T
            case "carrier":
                return self.moved.carrier.T
            case "mrf":
                return self.T_world_mrf
            case "wrist":
                return self.T_world_mrf @ self.T_wrist_mrf.inverse()
            case "crf":
                return self._mounted(self.crf)
            case "sensor" if self.T_wrist_sensor is not None:
                return self._mounted(Mount("wrist", self.T_wrist_sensor))
            case "lens" if self.lens is not None:
                return self._mounted(self.lens)
        raise UnknownFrame(f"{frame!r}: the frames of this cell are {', '.join(self.names)}")

    def _mounted(self, mount: Mount) -> Pose:
        return mount.T if mount.on == "world" else self._in_world(mount.on) @ mount.T

    @property
    def names(self) -> tuple[str, ...]:
        """The frames that this cell has."""
        lacking = {"sensor": self.T_wrist_sensor, "lens": self.lens}
        return tuple(name for name in FRAMES if lacking.get(name, True) is not None)

    def _carrier_of(self, frame: str) -> Body:
        """Return the rigid thing that a frame is fixed to."""
        self._in_world(frame)
        if frame in ("crf", "lens"):
            mount = self.crf if frame == "crf" else self.lens
            frame = "world" if mount is None else mount.on
        if frame == "world":
            return Body.standing(Pose.identity())
        body = self.moved.body(frame) if frame in GROUNDS else None
        if body is not None:
            return body
        T = self._in_world("wrist")
        carried = self.moved.base.twist_at(T.p) if self.twist_wrist is None else self.twist_wrist
        return Body(T, carried)
