"""Parts of every table of a cell file: the base class, poses and vectors."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

_Coordinate = Annotated[float, Field(ge=-1e4, le=1e4)]
_Component = Annotated[float, Field(ge=-1e6, le=1e6)]
Vector3 = Annotated[tuple[_Coordinate, _Coordinate, _Coordinate], Field(description="[x, y, z]")]
Vector6 = Annotated[
    tuple[_Component, _Component, _Component, _Component, _Component, _Component],
    Field(description="linear x, y, z, then angular x, y, z"),
]
Positive = Annotated[float, Field(gt=0, le=1e9)]
NonNegative = Annotated[float, Field(ge=0, le=1e9)]
Share = Annotated[float, Field(ge=0, le=1)]
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,31}$")]
LinkName = Annotated[str, Field(pattern=r"^([a-z][a-z0-9_]{0,31}\.)?[a-z][a-z0-9_]{0,31}$")]
"""A link; in a cell of several mechanisms it begins with the name of its own: `left.hand`."""


class Section(BaseModel):
    """A table of the cell file: unknown keys and non-finite numbers are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Pose(Section):
    """A frame's pose in its parent: translation, then fixed-axis roll, pitch, yaw."""

    xyz: Vector3 = Field((0.0, 0.0, 0.0), description="translation [m]")
    rpy: Vector3 = Field((0.0, 0.0, 0.0), description="roll, pitch, yaw about fixed x, y, z [rad]")
