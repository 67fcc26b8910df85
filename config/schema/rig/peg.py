"""Schema of a peg as the tool and of holes that it fits, in the virtual world."""

from pydantic import Field, model_validator

from ..section import Name, PoseSection, Section


class RigPegSection(Section):
    """A round peg as the tool: its axis is the MRF's z, the middle of its end the MRF's origin."""

    radius: float = Field(0.010, gt=0, le=0.2, description="of the peg [m]")
    length: float = Field(0.080, gt=0, le=1, description="from its end back to the hand [m]")
    rounding: float = Field(0.002, gt=0, le=0.05, description="of its edge [m]")
    mass: float = Field(0.2, ge=0, le=100, description="its mass, even along its length [kg]")
    friction: float = Field(
        0.15, ge=0, le=2, description="on whatever it touches; greased steel by default [1]"
    )

    @model_validator(mode="after")
    def _is_a_peg(self) -> "RigPegSection":
        if self.rounding >= self.radius:
            raise ValueError(f"rounding {self.rounding:g} must be below radius {self.radius:g}")
        if 2.0 * self.rounding >= self.length:
            raise ValueError(f"length {self.length:g} must be above 2 x rounding {self.rounding:g}")
        return self


class RigHoleSection(Section):
    """A block with a hole of eight flat sides through it, chamfered by 45 degrees at its mouth."""

    name: Name = Field(description="name of the body")
    T_world_hole: PoseSection = Field(
        description="where it is meant to be: middle of the mouth, z out of it, in World"
    )
    misplaced: PoseSection = Field(
        default_factory=PoseSection,
        description="where it really is, measured there: nobody is told",
    )
    radius: float = Field(
        0.01025, gt=0, le=0.2, description="from the axis to a side: the peg's plus clearance [m]"
    )
    chamfer: float = Field(0.003, gt=0, le=0.05, description="width and height of the chamfer [m]")
    depth: float = Field(0.045, gt=0, le=1, description="of the block, chamfer included [m]")
    half_size: float = Field(0.04, gt=0, le=1, description="from the axis to the outside [m]")

    @model_validator(mode="after")
    def _has_material(self) -> "RigHoleSection":
        if self.radius + 2.0 * self.chamfer >= self.half_size:
            raise ValueError(
                f"half_size {self.half_size:g} must be above radius {self.radius:g} + 2 x chamfer "
                f"{self.chamfer:g}"
            )
        if 2.0 * self.chamfer >= self.depth:
            raise ValueError(f"depth {self.depth:g} must be above 2 x chamfer {self.chamfer:g}")
        return self
