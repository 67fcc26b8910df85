"""Schema of the potential field that spare freedoms slide downhill in."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..section import Section, Vector3

Strength = Annotated[float, Field(ge=0, le=100)]


class VirtualLinkSection(Section):
    """A prismatic link between path and tool that is not there: along it the tool gives way.

    For an arm without spare freedom. The field pushes the tool off its path, the spring leads it
    back; it acts while the tool follows a path, and at its end.
    """

    direction: Vector3 = Field((0.0, 0.0, 1.0), description="along it, either way, in World")
    stiffness: float = Field(5.0, gt=0, le=1e4, description="of the spring, k_p [N/m]")
    longest: float = Field(0.2, gt=0, le=2, description="furthest from the path [m]")
    speed: float = Field(0.2, gt=0, le=5, description="fastest off the path and back [m/s]")

    @model_validator(mode="after")
    def _has_a_direction(self) -> "VirtualLinkSection":
        if not any(self.direction):
            raise ValueError("direction must not be zero")
        return self


class PotentialFieldSection(Section):
    """Strengths of what repels the links: obstacles, joint limits, singularities.

    The links of the arm are charged along their length. What slides downhill is `redundancy.field`
    (self-motion) and the virtual link, if any.
    """

    obstacles: Strength = Field(0.1, description="points and solids, k_obst [N·m]")
    lines: Strength = Field(0.1, description="sight lines, per metre of line [N]")
    joint_limits: Strength = Field(0.1, description="springs to mid-range, k_jlim [N·m]")
    manipulability: Strength = Field(
        0.0, description="away from singularities, k_manip, times √det(JJᵀ) [N·m]"
    )
    line_model: Literal["smooth", "closest"] = Field(
        "smooth",
        description="a sight line is charged all along, or, as in the paper, stands as its point "
        "closest to each link, which jumps where the two are parallel",
    )
    least_distance: float = Field(
        0.02, ge=0.001, le=0.5, description="bounds the field: distances count no less [m]"
    )
    virtual_link: VirtualLinkSection | None = Field(
        None, description="lets the tool leave its path"
    )


__all__ = ["PotentialFieldSection", "VirtualLinkSection"]
