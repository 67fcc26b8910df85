"""Schema of the virtual hardware, and of what stands about the arm."""

import math
from typing import Annotated

from pydantic import Field, model_validator

from .mechanism import SegmentSection
from .section import EachJoint, Name, NonNegative, PoseSection, Positive, Section, Vector3, Vector6
from .surroundings import RigFramesSection, RigTagSection

# --- Schema of the bridge that a rover drives under, and of the simulated laser scanner -----------


class RigBridgeSection(Section):
    """Two pillars and a beam on them, across the way ahead.

    Their bodies are `bridge_left`, `bridge_right` and `bridge_beam`.
    """

    height: float = Field(0.95, gt=0, le=10, description="of the beam's underside [m]")
    width: float = Field(1.4, gt=0, le=10, description="between the pillars [m]")
    thickness: float = Field(0.1, gt=0, le=5, description="of pillars and beam, ahead [m]")
    side: float = Field(0.1, gt=0, le=2, description="of the pillars across, of the beam up [m]")
    skew: float = Field(0.0, ge=-1, le=1, description="turned about the vertical by [rad]")
    offset: float = Field(0.0, ge=-5, le=5, description="of its middle, to the left [m]")
    distance: float = Field(
        2.5, ge=-20, le=50, description="of its middle's near face, ahead of World's origin [m]"
    )

    @property
    def blocks(self) -> dict[str, tuple[Vector3, Vector3]]:
        """Middle in World and half size [m] of each of its bodies, all turned by `skew`."""
        c, s = math.cos(self.skew), math.sin(self.skew)
        depth, side = 0.5 * self.thickness, 0.5 * self.side
        across, high = 0.5 * self.width + side, 0.5 * self.height
        pillar, beam = (depth, side, high), (depth, across + side, side)
        return {
            name: ((self.distance + c * depth - s * y, self.offset + s * depth + c * y, z), half)
            for name, y, z, half in (
                ("bridge_left", across, high, pillar),
                ("bridge_right", -across, high, pillar),
                ("bridge_beam", 0.0, self.height + side, beam),
            )
        }


class RigPersonSection(Section):
    """Somebody who stands on the floor, and may walk in: body `person`, which can be placed."""

    xyz: Vector3 = Field(description="between the feet [m]")
    height: float = Field(1.7, gt=0.5, le=3, description="of an upright capsule [m]")
    radius: float = Field(0.2, gt=0.05, le=0.24, description="of that capsule [m]")


class RigScannerSection(Section):
    """Imperfections of the simulated laser scanner."""

    noise: NonNegative = Field(0.012, description="standard deviation of distances [m]")
    range: float = Field(20.0, gt=0.5, le=100, description="farther things give no echo [m]")
    least: float = Field(0.05, ge=0, le=5, description="nearer things give none either [m]")


# --- Schema of a peg as the tool and of holes that it fits, in the virtual world ------------------


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


# --- Schema of the payload that arms hold together, in the virtual world --------------------------

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


# --- Schema of the virtual hardware, and of what stands about the arm -----------------------------


class RigDriveSection(Section):
    """The physics behind one simulated drive; one value for all joints or one each.

    None given: as the arm's own inertia wants them, so that the drives are alike to all arms.
    """

    stiffness: Annotated[tuple[Positive, ...], EachJoint] = Field(
        (), description="position loop K_p; none: by the arm's inertia [N·m/rad]"
    )
    damping: Annotated[tuple[Positive, ...], EachJoint] = Field(
        (), description="position loop K_d, likewise [N·m·s/rad]"
    )
    integral: Annotated[tuple[NonNegative, ...], EachJoint] = Field(
        (), description="position loop K_i, likewise [N·m/(rad·s)]"
    )
    armature: Annotated[tuple[NonNegative, ...], EachJoint] = Field(
        (), description="rotor inertia at the joint, likewise [kg·m²]"
    )
    friction: Annotated[tuple[NonNegative, ...], EachJoint] = Field(
        (), description="Coulomb friction; none: a part of max_torque [N·m]"
    )
    torque_filter_s: float = Field(
        0.005, ge=0, le=0.1, description="time constant of the torque that it reports [s]"
    )
    brake_delay_s: float = Field(
        0.02, ge=0, le=0.5, description="brake opens this long after the drive holds the joint [s]"
    )
    brake_closes_s: float = Field(
        0.0, ge=0, le=0.5, description="brake closes this long after its coil is switched off [s]"
    )
    brake_torque: Annotated[tuple[Positive, ...], EachJoint] = Field(
        (), description="torque with which a closing brake slips [N·m]; none: it locks at once"
    )
    torque_delay_s: float = Field(
        0.0,
        ge=0,
        le=0.5,
        description="a wrongly set drive: its brake opens this long before it holds the joint [s]",
    )


class RigForceTorqueSection(Section):
    """Imperfections of the simulated force/torque sensor."""

    noise: Vector6 = Field(
        (0.05, 0.05, 0.05, 0.002, 0.002, 0.002), description="standard deviation [N, N·m]"
    )
    bias: Vector6 = Field((0.0,) * 6, description="reading without load [N, N·m]")
    mounting_rpy: Vector3 | None = Field(
        None,
        description="true attitude of the Sensor frame in the Wrist; none: as T_wrist_sensor says "
        "[rad]",
    )
    cross_talk: float = Field(
        0.0,
        ge=0,
        le=0.2,
        description="part of each axis that shows in the others, signs by seed [1]",
    )


class RigGripperSection(Section):
    """Object that the simulated gripper takes hold of when it closes."""

    mass: float = Field(0.0, ge=0, le=500, description="its mass [kg]")
    com: Vector3 = Field(
        (0.0, 0.0, 0.0), description="its centre of mass in the true Sensor frame [m]"
    )


class WallSection(Section):
    """A plate on a sprung, damped slide: its stiffness is a number."""

    xyz: Vector3 = Field(description="centre of the plate's face, in World [m]")
    normal: Vector3 = Field((-1.0, 0.0, 0.0), description="out of the face, in World")
    half_size: float = Field(0.25, gt=0, le=5, description="half the side of the plate [m]")
    stiffness: float = Field(20_000.0, gt=0, le=1e6, description="of the slide [N/m]")
    damping: float = Field(300.0, ge=0, le=1e5, description="of the slide [N·s/m]")
    mass: float = Field(1.0, gt=0, le=1000, description="of the plate [kg]")

    @model_validator(mode="after")
    def _has_a_side(self) -> "WallSection":
        if not any(self.normal):
            raise ValueError("'normal' must not be zero")
        return self


class BoxSection(Section):
    """A fixed box, such as a table."""

    name: Name = Field(description="name of the body")
    xyz: Vector3 = Field(description="centre, in World [m]")
    rpy: Vector3 = Field((0.0, 0.0, 0.0), description="attitude, in World [rad]")
    half_size: Vector3 = Field(description="half the sides [m]")


class RigTunnelSection(Section):
    """How the walls of a backbone's tunnel stand in truth."""

    pieces: tuple[SegmentSection, ...] = Field(
        (), max_length=64, description="from the entrance on; none: those of the cell's tunnel"
    )
    shift: Vector3 = Field((0.0, 0.0, 0.0), description="from where the cell has them [m]")
    half_width: float | None = Field(
        None, gt=0, le=1, description="from centre line to wall; none: as the cell says [m]"
    )
    narrow_from: float = Field(
        0.0, ge=0, le=1000, description="that holds for pieces that begin so deep, or deeper [m]"
    )
    thickness: float = Field(0.01, gt=0, le=1, description="of the walls [m]")
    half_height: float = Field(
        0.05, gt=0, le=5, description="of the walls beside a planar arm, which are open above [m]"
    )


class RigSection(Section):
    """The virtual hardware: never read by the daemon."""

    seed: int = Field(1, ge=0, description="seed of the sensor noise [1]")
    physics_step_s: float = Field(0.001, ge=1e-4, le=0.002, description="physics step [s]")
    drive: RigDriveSection = Field(
        default_factory=RigDriveSection, description="what is behind every simulated drive"
    )
    force_torque: RigForceTorqueSection = Field(
        default_factory=RigForceTorqueSection, description="sensor imperfections"
    )
    tool_radius: float = Field(
        0.012, ge=0, le=0.2, description="ball at the MRF that touches things, 0 for none [m]"
    )
    payload_mass: float = Field(0.0, ge=0, le=500, description="true mass outboard of sensor [kg]")
    payload_com: Vector3 = Field(
        (0.0, 0.0, 0.0), description="its true centre of mass in the true Sensor frame [m]"
    )
    gripper: RigGripperSection = Field(
        default_factory=RigGripperSection, description="what the gripper takes hold of"
    )
    wall: WallSection | None = Field(None, description="a wall of known stiffness")
    boxes: tuple[BoxSection, ...] = Field((), description="fixed boxes, such as a table")
    tunnel: RigTunnelSection = Field(
        default_factory=RigTunnelSection,
        description="walls of the tunnel, where the arm has a backbone",
    )
    peg: RigPegSection | None = Field(None, description="a peg as the tool")
    holes: tuple[RigHoleSection, ...] = Field(
        (), max_length=16, description="holes to insert it into"
    )
    beam: RigBeamSection | None = Field(None, description="what the arms of a joint task hold")
    tags: tuple[RigTagSection, ...] = Field((), description="planar tags that cameras can see")
    frames: RigFramesSection = Field(
        default_factory=RigFramesSection,
        description="motion of platform and Carrier, and their news",
    )
    scanner: RigScannerSection = Field(
        default_factory=RigScannerSection, description="imperfections of the laser scanner"
    )
    bridge: RigBridgeSection | None = Field(
        None, description="two pillars and a beam that nobody tells the daemon of"
    )
    person: RigPersonSection | None = Field(None, description="somebody who may walk in")
