"""Parts of every table of a cell file: the base class, poses and vectors."""

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

_Coordinate = Annotated[float, Field(ge=-1e4, le=1e4)]
_Component = Annotated[float, Field(ge=-1e6, le=1e6)]
Vector3 = Annotated[tuple[_Coordinate, _Coordinate, _Coordinate], Field(description="[x, y, z]")]
Vector6 = Annotated[
    tuple[_Component, _Component, _Component, _Component, _Component, _Component],
    Field(description="linear x, y, z, then angular x, y, z"),
]


def _listed(value: object) -> object:
    """Return a tuple of one for a number: it stands for a list of equal ones."""
    if isinstance(value, list):
        return tuple(value)
    return (value,) if isinstance(value, int | float) and not isinstance(value, bool) else value


EachJoint = BeforeValidator(_listed)
"""One number stands for a list of equal ones, one per joint."""
Positive = Annotated[float, Field(gt=0, le=1e9)]
NonNegative = Annotated[float, Field(ge=0, le=1e9)]
Share = Annotated[float, Field(ge=0, le=1)]
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,31}$")]
UrdfName = Annotated[
    str,
    Field(
        pattern=r"^[^\s\x00-\x1f\x7f\"'](?:[^\x00-\x1f\x7f\"']*[^\s\x00-\x1f\x7f\"'])?$",
        max_length=128,
    ),
]
"""A name as URDFs have them: no quotes, no control characters, no blank at either end."""
LinkName = UrdfName
"""A link; in a cell of several mechanisms it begins with the name of its own: `left.hand`."""


class Section(BaseModel):
    """A table of the cell file: unknown keys and non-finite numbers are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with other values, judged as those of a file are.

        Pydantic's own takes any key and any value. Raises `ValidationError`.
        """
        if not update:
            return super().model_copy(deep=deep)
        told = {name: getattr(self, name) for name in self.model_fields_set}
        judged = type(self).model_validate({**told, **update})
        values = {name: getattr(judged, name) for name in update}
        return super().model_copy(update=values, deep=deep)


class PoseSection(Section):
    """A frame's pose in its parent: translation, then fixed-axis roll, pitch, yaw."""

    xyz: Vector3 = Field((0.0, 0.0, 0.0), description="translation [m]")
    rpy: Vector3 = Field((0.0, 0.0, 0.0), description="roll, pitch, yaw about fixed x, y, z [rad]")
