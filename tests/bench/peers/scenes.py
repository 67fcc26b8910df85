"""Scene: start of the arm, its target, and obstacles at rest and in motion."""

import math
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field, TypeAdapter
from telerobot.config.schema.section import Section, Vector3
from telerobot.server.control.spatial import Array, Pose, rotation_rpy


class Way(NamedTuple):
    """Place and velocity of an obstacle at one instant, in World [m], [m/s]."""

    centre: Array
    velocity: Array


class Thing(Section):
    """A sphere, a capsule along its own z or a box; it stands, or swings about its centre."""

    name: str
    shape: Literal["sphere", "capsule", "box"]
    xyz: Vector3
    rpy: Vector3 = (0.0, 0.0, 0.0)
    radius: float = Field(0.0, ge=0)
    half_length: float = Field(0.0, ge=0)
    """Of a capsule's segment [m]."""
    half_size: Vector3 = (0.0, 0.0, 0.0)
    swing: Vector3 = (0.0, 0.0, 0.0)
    """Amplitude of the motion, in World [m]."""
    frequency: float = Field(0.0, ge=0)
    """Angular [rad/s]."""
    phase: float = 0.0

    @property
    def moves(self) -> bool:
        """True for one that swings."""
        return any(self.swing) and self.frequency > 0.0

    @property
    def max_speed(self) -> float:
        """Bound of its speed [m/s]."""
        return math.hypot(*self.swing) * self.frequency

    @property
    def max_acceleration(self) -> float:
        """Bound of its acceleration [m/s²]."""
        return self.max_speed * self.frequency

    @property
    def axis(self) -> Array:
        """Direction of a capsule (3,), World."""
        return np.asarray(rotation_rpy(*self.rpy)[:, 2])

    def at(self, time_s: float) -> Way:
        """Return where it is and how it moves at a time."""
        angle, swing = self.frequency * time_s + self.phase, np.array(self.swing)
        return Way(
            np.array(self.xyz) + math.sin(angle) * swing,
            self.frequency * math.cos(angle) * swing,
        )

    def swept(self, copies: int) -> tuple["Thing", ...]:
        """Return it standing at so many places that are spread over its swing."""
        if not self.moves:
            return (self,)
        parts = np.linspace(-1.0, 1.0, copies)
        return tuple(
            self.model_copy(
                update={
                    "name": f"{self.name}_{i}",
                    "xyz": tuple((np.array(self.xyz) + part * np.array(self.swing)).tolist()),
                    "swing": (0.0, 0.0, 0.0),
                    "frequency": 0.0,
                }
            )
            for i, part in enumerate(parts)
        )


class Target(Section):
    """A pose of the MRF in World, and whether it was shown beforehand that it can be reached."""

    xyz: Vector3
    rpy: Vector3
    feasible: bool = False
    why: str = "not judged"

    @property
    def pose(self) -> Pose:
        """The pose."""
        return Pose.from_xyz_rpy(self.xyz, self.rpy)


class PeerScene(Section):
    """One run: from a posture at rest to one target after the other."""

    seed: int
    cell: str
    start: tuple[float, ...]
    things: tuple[Thing, ...]
    targets: tuple[Target, ...]

    @property
    def feasible(self) -> bool:
        """True if every target was shown to be feasible, each from the one before it."""
        return all(target.feasible for target in self.targets)

    @property
    def moves(self) -> bool:
        """True if anything moves."""
        return any(thing.moves for thing in self.things)


_SCENES = TypeAdapter(tuple[PeerScene, ...])


def write(scenes: tuple[PeerScene, ...], path: Path) -> None:
    """Write scenes as JSON."""
    path.write_bytes(_SCENES.dump_json(scenes, indent=1))


def read(path: Path) -> tuple[PeerScene, ...]:
    """Read scenes. Raises `pydantic.ValidationError` for what is none."""
    return _SCENES.validate_json(path.read_bytes())
