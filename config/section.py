"""What every table of a cell file is made of: the base class, poses and vectors."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Vector3 = Annotated[tuple[float, float, float], Field(description="[x, y, z]")]
Vector6 = Annotated[
    tuple[float, float, float, float, float, float],
    Field(description="linear x, y, z, then angular x, y, z"),
]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,31}$")]


class Section(BaseModel):
    """A table of the cell file: unknown keys and non-finite numbers are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Pose(Section):
    """A frame's pose in its parent: translation, then fixed-axis roll, pitch, yaw."""

    xyz: Vector3 = Field((0.0, 0.0, 0.0), description="translation [m]")
    rpy: Vector3 = Field((0.0, 0.0, 0.0), description="roll, pitch, yaw about fixed x, y, z [rad]")
