"""Schema of the redundancy objectives."""

from typing import Annotated

from pydantic import AfterValidator, Field

from ..section import Name, Section


class ObjectivesSection(Section):
    """Gains of the redundancy objectives: one field each."""

    mid_range: float = Field(
        0.2, ge=0, le=10, description="pull of every joint to the middle of its range [1/s]"
    )
    manipulability: float = Field(
        0.0, ge=0, le=10, description="away from singularities, times the slope of √det(JJᵀ) [1/s]"
    )
    posture: float = Field(
        0.0, ge=0, le=10, description="pull of every joint to the posture of that name [1/s]"
    )
    least_energy: float = Field(
        0.0, ge=0, le=1, description="share of the way to the least kinetic energy [1]"
    )
    field: float = Field(
        0.0, ge=0, le=10, description="how quickly to the least of the potential field [1/s]"
    )
    spheres: float = Field(
        0.0, ge=0, le=10, description="share of the rates that [priority] asks for [1]"
    )
    gravity_torque: float = Field(
        0.0, ge=0, le=10, description="to postures in which joints carry less weight [1/s]"
    )
    reflex: float = Field(
        1.0, ge=0, le=1, description="share of folding to pass below what is ahead [1]"
    )


OBJECTIVES = tuple(ObjectivesSection.model_fields)
"""Names of the redundancy objectives, in the order in which their rates are summed."""


def _known(name: str) -> str:
    if name not in OBJECTIVES:
        raise ValueError(f"no such objective: the objectives are {', '.join(OBJECTIVES)}")
    return name


ObjectiveName = Annotated[str, AfterValidator(_known)]


class RedundancySection(ObjectivesSection):
    """Use of the null space; each gain 0 switches its objective off."""

    posture_name: Name = Field("ready", description="posture that the joints are pulled to")
    max_rate: float = Field(
        0.5, ge=0, le=10, description="bound of the self-motion, as a part of V [1]"
    )

    @property
    def gains(self) -> dict[str, float]:
        """The objectives' gains by name."""
        return {name: getattr(self, name) for name in OBJECTIVES}
