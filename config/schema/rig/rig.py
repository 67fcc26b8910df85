"""Schema of the virtual hardware, and of what stands about the arm."""

from typing import Annotated

from pydantic import Field

from ..moving import RigFramesSection
from ..section import EachJoint, Name, NonNegative, Positive, Section, Vector3, Vector6
from ..sensors.cameras import RigTagSection
from .beam import RigBeamSection
from .bridge import RigBridgeSection, RigPersonSection, RigScannerSection
from .peg import RigHoleSection, RigPegSection


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


class BoxSection(Section):
    """A fixed box, such as a table."""

    name: Name = Field(description="name of the body")
    xyz: Vector3 = Field(description="centre, in World [m]")
    rpy: Vector3 = Field((0.0, 0.0, 0.0), description="attitude, in World [rad]")
    half_size: Vector3 = Field(description="half the sides [m]")


class RigTunnelSection(Section):
    """How the walls of a backbone's tunnel stand in truth."""

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
