"""Schema of the payload that arms hold together, in the virtual world."""

from pydantic import Field

from ..section import PoseSection, Positive, Section, Vector3
from .peg import RigPegSection

HalfSize = tuple[Positive, Positive, Positive]


class RigBeamSection(Section):
    """A box on sprung pads, one in each grasp of the cell's first joint task; its frame: the MRF.

    Springs of six freedoms stand for what yields between a flange and the payload.
    """

    half_size: HalfSize = Field(description="half its sides, along the axes of the MRF [m]")
    mass: float = Field(gt=0, le=500, description="true mass, pegs included [kg]")
    com: Vector3 = Field((0.0, 0.0, 0.0), description="true centre of mass, in the MRF [m]")
    grasp_stiffness: tuple[Positive, Positive] = Field(
        (50_000.0, 1000.0), description="of each pad [N/m], [N·m/rad]"
    )
    grasp_damping: tuple[Positive, Positive] = Field(
        (200.0, 1.0), description="of each pad [N·s/m], [N·m·s/rad]"
    )
    misfit: tuple[Vector3, ...] = Field(
        (), description="how far each pad is from where it fits, in the MRF's axes [m]"
    )
    pegs: tuple[PoseSection, ...] = Field(
        (), max_length=8, description="middle of each peg's end, x out of it, in the MRF"
    )
    peg: RigPegSection = Field(
        default_factory=lambda: RigPegSection(length=0.06, mass=0.0),
        description="what each peg is like",
    )
