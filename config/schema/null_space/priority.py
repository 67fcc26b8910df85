"""Schema of virtual spheres, and of how far avoiding precedes following."""

from pydantic import Field, model_validator

from ..section import Name, Section, Vector3


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


__all__ = ["PrioritySection", "VirtualSphereSection"]
