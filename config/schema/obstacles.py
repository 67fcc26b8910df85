"""Schema of obstacles, of the promised clearance, and of the arm's shape."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from .section import LinkName, Name, Section, Vector3

Shape = Literal["point", "sphere", "capsule", "box", "sight_line"]
Stale = Literal["keep", "grow", "stop"]
Standing = Literal["stand", "self_motion", "step_aside"]
Length = Annotated[float, Field(ge=0, le=10)]
HalfSide = Annotated[float, Field(gt=0, le=20)]

SHORTEST = 1e-4
"""A capsule or a sight line that is shorter has no direction [m]."""
NEEDED: dict[str, tuple[str, ...]] = {
    "point": ("xyz",),
    "sphere": ("xyz", "radius"),
    "capsule": ("xyz", "to", "radius"),
    "box": ("xyz", "half_size"),
    "sight_line": ("to",),
}
"""Fields that each shape needs, beside those with a default."""


class ObstacleSection(Section):
    """Something that the arm keeps away from: what the daemon knows, not what the physics holds.

    One with `max_speed` 0 stands still for ever. One that may move is known by messages on
    `sensor/obstacle`; between two of them it is somewhere within its bounds.
    """

    name: Name = Field(description="name of the obstacle")
    shape: Shape = Field(description="what it is")
    xyz: Vector3 | None = Field(
        None, description="centre; one end of a capsule; start of a sight line, in World [m]"
    )
    to: Vector3 | None = Field(
        None, description="other end of a capsule; target of a sight line, in World [m]"
    )
    camera: Name | None = Field(
        None, description="camera whose Lens a sight line starts from, in place of xyz"
    )
    radius: Length | None = Field(
        None, description="of a sphere, a capsule or a sight line (0 unless given) [m]"
    )
    rpy: Vector3 = Field((0.0, 0.0, 0.0), description="attitude of a box, in World [rad]")
    half_size: tuple[HalfSide, HalfSide, HalfSide] | None = Field(
        None, description="half the sides of a box [m]"
    )
    clearance: Length | None = Field(
        None, description="promised distance of every link from it; none: avoidance.clearance [m]"
    )
    hard: bool | None = Field(
        None, description="keeps a barrier; none: true, but false for a sight line"
    )
    max_speed: float = Field(
        0.0, ge=0, le=10, description="no point of it is ever faster; 0: it stands still [m/s]"
    )
    max_acceleration: float | None = Field(
        None,
        gt=0,
        le=100,
        description="of any of its points; none: unbounded, and its velocity is not believed "
        "[m/s²]",
    )
    timeout_s: float = Field(
        0.25, gt=0, le=60, description="news of one that may move is stale when older than [s]"
    )
    stale: Stale = Field(
        "stop",
        description="then: keep (it has stopped where it may have got to), grow (it goes on "
        "growing by max_speed), or stop (verified stop of the arm)",
    )

    @model_validator(mode="after")
    def _is_whole(self) -> "ObstacleSection":
        missing = [key for key in NEEDED[self.shape] if getattr(self, key) is None]
        if missing:
            raise ValueError(f"a {self.shape} needs {' and '.join(missing)}")
        if self.xyz is not None and self.to is not None and math.dist(self.xyz, self.to) < SHORTEST:
            raise ValueError(f"a {self.shape} from xyz to the same place has no length")
        if self.shape == "sight_line" and (self.xyz is None) == (self.camera is None):
            raise ValueError("a sight_line starts either at xyz or at a camera")
        if self.shape != "sight_line" and self.camera is not None:
            raise ValueError("only a sight_line starts at a camera")
        return self


class LinkCapsuleSection(Section):
    """A part of the arm: all points within `radius` of a segment in a link's frame."""

    link: LinkName = Field(description="link of the URDF that it is fixed to")
    start: Vector3 = Field(description="one end of the segment, in the link [m]")
    end: Vector3 = Field(description="the other end [m]")
    radius: float = Field(gt=0, le=2, description="around the segment [m]")
    holds: tuple[LinkName, ...] = Field(
        (), max_length=64,
        description="other links of the same body whose shapes lie inside this one and others "
        "around that link",
    )  # fmt: skip


class AllowedContactSection(Section):
    """A link and an obstacle, or two links, that may touch: they are not kept apart."""

    link: LinkName = Field(description="link of the arm")
    other: LinkName = Field(description="obstacle, or another link")


class WorkspaceSection(Section):
    """The box, along the axes of World, that the MRF stays in."""

    low: Vector3 = Field(description="least x, y, z [m]")
    high: Vector3 = Field(description="greatest x, y, z [m]")

    @model_validator(mode="after")
    def _is_a_box(self) -> "WorkspaceSection":
        if any(a >= b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError("every coordinate of 'low' must be below that of 'high'")
        return self


class AvoidanceSection(Section):
    """Clearances that are kept as barriers, and that the verified stop covers."""

    enabled: bool = Field(False, description="switch at start")
    clearance: Length = Field(0.02, description="promised distance of links from obstacles [m]")
    self_clearance: Length = Field(0.01, description="promised distance of links, one another [m]")
    margin: float = Field(
        0.005, ge=0.001, le=0.2, description="barriers stand so much further out [m]"
    )
    near_distance: float = Field(
        0.10, gt=0, le=5, description="the tool is near things from this distance on [m]"
    )
    near_speed: float | None = Field(
        None, gt=0, le=10, description="MRF speed bound at the clearance; none: limits.speed [m/s]"
    )
    standing: Standing = Field(
        "stand",
        description="what an arm that stands does when something comes: stand, self_motion (its "
        "tool stays), or step_aside; it comes back",
    )
    standing_in_hold: bool = Field(False, description="it does so in HOLD, too")
    standing_reach: float = Field(
        0.25,
        gt=0,
        le=2,
        description="no part of it goes further from where it was told to stand [m]",
    )
    workspace: WorkspaceSection | None = Field(
        None, description="where the MRF stays; none: everywhere"
    )
    capsules: tuple[LinkCapsuleSection, ...] = Field(
        (), max_length=64, description="shape of links that have none in the URDF, or more of it"
    )
    allowed_contacts: tuple[AllowedContactSection, ...] = Field(
        (), max_length=64, description="who may touch whom"
    )


__all__ = [
    "AllowedContactSection",
    "AvoidanceSection",
    "LinkCapsuleSection",
    "ObstacleSection",
    "Shape",
    "Stale",
    "WorkspaceSection",
]
