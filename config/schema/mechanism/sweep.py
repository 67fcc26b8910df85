"""Schema of an axis that sweeps: a scanner's tilt."""

import math

from pydantic import Field, model_validator

from ..section import Name, Section


class SweepSection(Section):
    """A joint beside the chain, with a drive like others, that goes to and fro while one may move.

    It is on the root link of the URDF. At a constant speed, but for where it turns round; in HOLD
    it stands.
    """

    joint: Name = Field(description="joint of the URDF, of type revolute, on its root link")
    low: float = Field(ge=-math.pi, le=math.pi, description="where it turns round [rad]")
    high: float = Field(ge=-math.pi, le=math.pi, description="the other end [rad]")
    period_s: float = Field(
        2.03, ge=0.2, le=60,
        description="to and fro again; no whole number of scans, or they look along the same "
        "planes every time [s]",
    )  # fmt: skip

    @model_validator(mode="after")
    def _goes_somewhere(self) -> "SweepSection":
        if self.low >= self.high:
            raise ValueError(f"low {self.low:g} must be below high {self.high:g}")
        return self
