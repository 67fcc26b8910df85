"""Schema of the spare freedoms: redundancy objectives, potential field, virtual spheres."""

import math
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from .section import Name, Section, Vector3

# --- Schema of the potential field that spare freedoms slide downhill in --------------------------

Strength = Annotated[float, Field(ge=0, le=100)]


class VirtualLinkSection(Section):
    """Prismatic links between path and tool that are not there: along them the tool gives way.

    The field pushes the tool off its path, springs lead it back; they act while the tool follows a
    path, and at its end. An arm with spare joints uses these as well.
    """

    directions: tuple[Vector3, ...] = Field(
        ((0.0, 0.0, 1.0),),
        min_length=1,
        max_length=2,
        description="one for each link, along it, either way; two are square to each other",
    )
    axes: Literal["world", "mrf", "crf", "path"] = Field(
        "world",
        description="axes of directions: World's; the tool's; the operator's, which "
        "`operator/frame` changes and a camera may carry; or of a straight path: x along it, z as "
        "near to World's z as may be",
    )
    always: bool = Field(
        False, description="off a path too: while the tool stands, or is led by a stick"
    )
    stiffness: float = Field(5.0, gt=0, le=1e4, description="of each spring, k_p [N/m]")
    longest: float = Field(0.2, gt=0, le=2, description="furthest from the path, each link [m]")
    speed: float = Field(0.2, gt=0, le=5, description="fastest off the path and back [m/s]")

    @model_validator(mode="after")
    def _has_directions(self) -> "VirtualLinkSection":
        if not all(any(d) for d in self.directions):
            raise ValueError("a direction must not be zero")
        for d in self.directions[1:]:
            first = self.directions[0]
            across = sum(a * b for a, b in zip(first, d, strict=True))
            if abs(across) > 1e-6 * math.hypot(*first) * math.hypot(*d):
                raise ValueError(f"directions {first} and {d} must be square to each other")
        return self


class PotentialFieldSection(Section):
    """Strengths of what repels the links: obstacles, joint limits, singularities.

    The links of the arm are charged along their length. What slides downhill is `redundancy.field`
    (self-motion) and the virtual link, if any.
    """

    obstacles: Strength = Field(0.1, description="points and solids, k_obst [N·m]")
    lines: Strength = Field(0.1, description="sight lines, per metre of line [N]")
    joint_limits: Strength = Field(0.1, description="springs to mid-range, k_jlim [N·m]")
    rest: Literal["middle", "posture"] = Field(
        "middle",
        description="q_o, where the springs of joint_limits are at rest: the middle of every "
        "range, or the posture of redundancy.posture_name, which an operator may change",
    )
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
    search: int = Field(
        0,
        ge=0,
        le=8,
        description="steps of the search for the least potential in each period, each at most "
        "0.2 rad, from where the task will have the arm after 1 / redundancy.field: joints come "
        "back with the tool; 0: the slope where the arm is, behind which they stay [1]",
    )
    virtual_link: VirtualLinkSection | None = Field(
        None, description="lets the tool leave its path"
    )


# --- Schema of virtual spheres, and of how far avoiding precedes following ------------------------


class VirtualSphereSection(Section):
    """A place on the arm whose distance from obstacles counts."""

    name: Name = Field(description="what telemetry calls it")
    link: Name = Field(description="link of the URDF that it is fixed to")
    centre: Vector3 = Field((0.0, 0.0, 0.0), description="in the link's frame [m]")


class PrioritySection(Section):
    """Virtual spheres on the arm: obstacles push them by self-motion, and precede a hand's force.

    Soft, and no promise of a clearance: that is `avoidance`. Distances are from the centres to the
    obstacles' surfaces.
    """

    spheres: tuple[VirtualSphereSection, ...] = Field(
        min_length=1, max_length=16, description="places on the arm"
    )
    inner_radius: float = Field(
        0.15, gt=0, le=2, description="L_min: nearer than this no hand's force is followed [m]"
    )
    outer_radius: float = Field(0.25, gt=0, le=5, description="L_max: avoiding begins [m]")
    joints: tuple[Name, ...] = Field(
        (), max_length=64, description="whose rates avoid, in the null space (ξ); none: no joint's"
    )
    rate: float = Field(
        0.3,
        gt=0,
        le=5,
        description="k_a: of each at inner_radius, times redundancy.spheres [rad/s]",
    )
    precedence: bool = Field(
        True, description="near obstacles, less of a hand's force is followed: by 1 − α"
    )
    steepness: float = Field(
        5.0, gt=0, le=100, description="k_b: how quickly α falls with the distance [1]"
    )

    @model_validator(mode="after")
    def _fits(self) -> "PrioritySection":
        if self.outer_radius <= self.inner_radius:
            raise ValueError(
                f"outer_radius {self.outer_radius:g} must be above inner_radius "
                f"{self.inner_radius:g}"
            )
        for key, names in (("spheres", [s.name for s in self.spheres]), ("joints", self.joints)):
            twice = next((name for name in names if list(names).count(name) > 1), None)
            if twice is not None:
                raise ValueError(f"{key}: '{twice}' is there twice")
        return self


# --- Schema of the redundancy objectives ----------------------------------------------------------


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
    holding_torque: float = Field(
        0.0,
        ge=0,
        le=20,
        description="to postures that hold arm and payload with less of the drives' ratings [1/s]",
    )
    sigma_min: float = Field(
        0.0, ge=0, le=20, description="uphill in the least singular value [1/(m·s)]"
    )
    condition: float = Field(
        0.0, ge=0, le=20, description="uphill in least by greatest singular value [1/s]"
    )
    along: float = Field(
        0.0, ge=0, le=20, description="uphill in manipulability along along_direction [1/(m·s)]"
    )
    reflex: float = Field(
        1.0, ge=0, le=1, description="share of folding to pass below what is ahead [1]"
    )


OBJECTIVES = tuple(ObjectivesSection.model_fields)
"""Names of the redundancy objectives, in the order in which their rates are summed."""


class RedundancySection(ObjectivesSection):
    """Use of the null space; each gain 0 switches its objective off."""

    posture_name: Name = Field("ready", description="posture that the joints are pulled to")
    along_direction: Vector3 = Field(
        (0.0, 0.0, 1.0), description="that redundancy.along counts, either way, in World [1]"
    )
    max_rate: float = Field(
        0.5, ge=0, le=10, description="bound of the self-motion, as a part of V [1]"
    )
    arm_angle_speed: float = Field(
        0.5,
        gt=0,
        le=10,
        description="fastest that an operator turns the elbow about the line from shoulder to "
        "wrist, of an arm with such an elbow [rad/s]",
    )

    @field_validator("along_direction")
    @classmethod
    def _points_somewhere(cls, axis: tuple[float, float, float]) -> tuple[float, float, float]:
        if sum(x * x for x in axis) < 1e-12:
            raise ValueError("must point somewhere, but is no longer than 1e-6")
        return axis

    @property
    def gains(self) -> dict[str, float]:
        """The objectives' gains by name."""
        return {name: getattr(self, name) for name in OBJECTIVES}
