"""Schema of gains that change with something measured."""

from typing import Literal

from pydantic import Field, model_validator

from ..section import NonNegative, Section, Share
from .sources import SourceName


class ScheduleSection(Section):
    """A source's gain as a function of something measured: a table of factors, interpolated."""

    source: SourceName = Field(description="name of the source whose gain it is")
    by: Literal["contact_force", "distance", "time"] = Field(
        description="what decides: contact force at the MRF [N], distance from the MRF to the "
        "target [m], or time since enable [s]"
    )
    at: tuple[NonNegative, ...] = Field(
        min_length=2, max_length=32, description="where the table's points are, rising [N, m or s]"
    )
    factor: tuple[Share, ...] = Field(
        min_length=2, max_length=32, description="the gain's factor at each, 0 to 1 [1]"
    )
    axes: tuple[Share, Share, Share, Share, Share, Share] = Field(
        (1.0,) * 6, description="how much each axis heeds the factor: 1 in full, 0 not at all [1]"
    )

    @model_validator(mode="after")
    def _is_a_table(self) -> "ScheduleSection":
        if len(self.at) != len(self.factor):
            raise ValueError(f"{len(self.at)} points in 'at', {len(self.factor)} in 'factor'")
        if any(b <= a for a, b in zip(self.at, self.at[1:], strict=False)):
            raise ValueError("'at' must rise from point to point")
        return self
