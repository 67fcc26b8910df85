"""Messages that tell the daemon of obstacles, and switch their avoidance."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..messages import Attitude, Command, Count, Message, Place, Speed

ObstacleName = Annotated[str, Field(max_length=32, pattern=r"^[a-z][a-z0-9_]{0,31}$")]
Length = Annotated[float, Field(ge=0, le=10)]
HalfSide = Annotated[float, Field(gt=0, le=20)]

NEEDED: dict[str, tuple[str, ...]] = {
    "point": ("xyz",),
    "sphere": ("xyz", "radius"),
    "capsule": ("xyz", "to", "radius"),
    "box": ("xyz", "half_size"),
    "sight_line": ("xyz", "to"),
}
"""Fields that a new obstacle of each shape needs, beside those with a default."""


class ObstacleNews(Message):
    """Sets, moves or removes one obstacle; news of a sensor, not an order.

    `tick` is the telemetry tick in which it was seen: the daemon counts its age from there. With
    `shape` the obstacle is new, or replaced as a whole; without, it is known by its `name`, and
    what is not given stays as it was. `xyz` [m] is its centre, one end of a capsule or the start of
    a sight line, `to` the other end or the target, `rpy` [rad] and `half_size` [m] are a box's; all
    in World. Removing needs nothing else.

    `velocity` [m/s] is believed only together with a `max_acceleration` [m/s²]. No point of the
    obstacle is ever faster than `max_speed` [m/s]; with 0 it stands still for ever, and its news
    never age. When the newest is older than `timeout_s`, `stale` says what holds: keep (it has
    stopped where it may have got to), grow (it goes on growing), stop (verified stop of the arm).
    """

    name: ObstacleName
    tick: Count
    remove: bool = False
    shape: Literal["point", "sphere", "capsule", "box", "sight_line"] | None = None
    xyz: Place | None = None
    to: Place | None = None
    rpy: Attitude | None = None
    half_size: tuple[HalfSide, HalfSide, HalfSide] | None = None
    radius: Length | None = None
    velocity: tuple[Speed, Speed, Speed] | None = None
    max_speed: float | None = Field(None, ge=0, le=10)
    max_acceleration: float | None = Field(None, gt=0, le=100)
    timeout_s: float | None = Field(None, gt=0, le=60)
    stale: Literal["keep", "grow", "stop"] | None = None
    clearance: Length | None = None
    hard: bool | None = None

    @model_validator(mode="after")
    def _is_whole(self) -> "ObstacleNews":
        missing = [key for key in NEEDED.get(self.shape or "", ()) if getattr(self, key) is None]
        if missing:
            raise ValueError(f"a new {self.shape} needs {' and '.join(missing)}")
        if self.remove and (self.shape is not None or self.xyz is not None):
            raise ValueError("give either remove or a place")
        return self


class AvoidanceRequest(Command):
    """Switches the barriers of clearances on or off; bumpless."""

    on: bool


__all__ = ["AvoidanceRequest", "ObstacleName", "ObstacleNews"]
