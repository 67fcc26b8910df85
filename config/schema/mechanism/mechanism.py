"""Schema of the arm: its chain, drives, sensor, payloads and gripper."""

import math
from typing import Annotated, Final, Literal, Self

from pydantic import Field, PrivateAttr, field_validator, model_validator

from ..bus.on_bus import BusFrames, CanId, CanOpenNodeSection, OnBusSection
from ..section import Name, PoseSection, Section, UrdfName, Vector3, Vector6
from .backbone import BackboneSection
from .base import DifferentialBaseSection
from .sweep import SweepSection

RPDO_BYTES: Final = {"csp": 6, "csv": 6, "cst": 4}
"""Controlword, and the setpoint of each operation mode."""
MOST_DRIVES: Final = 64
"""Joints of a cell [1]."""
JointName = UrdfName
TPDO_BYTES: Final = 8
"""Statusword, position and torque."""


class DriveSection(CanOpenNodeSection):
    """One CAN servo drive and the joint it moves; what differs from arm to arm stands here."""

    joint: JointName = Field(
        description="joint of the URDF that this drive moves; 'j1..j15': fifteen drives of "
        "consecutive nodes"
    )
    counts_per_radian: float = Field(
        gt=100, le=1e9, description="encoder counts per radian of the joint [1/rad]"
    )
    direction: Literal[1, -1] = Field(1, description="+1 if counts grow with the joint angle")
    zero_rad: float = Field(
        0.0, ge=-100, le=100, description="joint angle at encoder count zero [rad]"
    )
    lower: float | None = Field(
        None,
        ge=-1e3,
        le=1e3,
        description="least position, where the URDF has none, or a lower one [rad]",
    )
    upper: float | None = Field(
        None, ge=-1e3, le=1e3, description="greatest position, likewise [rad]"
    )
    rated_torque: float = Field(
        ge=1e-6, le=1e5, description="torque at the joint that 6077h reports as 1000 [N·m]"
    )
    max_torque: float = Field(ge=1e-6, le=1e5, description="torque limit of the drive [N·m]")
    rotor_inertia: float = Field(
        0.0, ge=0, le=1e4, description="what its rotor adds at the joint, for dynamics [kg·m²]"
    )
    friction: float = Field(
        0.0, ge=0, le=1e5, description="Coulomb friction at the joint, for dynamics [N·m]"
    )
    max_velocity: float = Field(ge=1e-3, le=50, description="joint speed bound V [rad/s]")
    max_acceleration: float = Field(
        ge=1e-3, le=500, description="joint acceleration bound A [rad/s²]"
    )
    max_jerk: float = Field(ge=1e-3, le=50_000, description="joint jerk bound J [rad/s³]")
    position_margin: float = Field(
        0.01, ge=0, le=1, description="kept from the URDF's position limits on either side [rad]"
    )
    leash: float = Field(
        0.03, gt=0, le=1, description="command may run ahead of the joint by at most [rad]"
    )
    following_window: float = Field(
        0.06, gt=0, le=2, description="following error that means quick stop, also 6065h [rad]"
    )
    max_torque_rate: float | None = Field(
        None, gt=0, le=1e7, description="what a commanded torque may change by in CST [N·m/s]"
    )
    quick_stop_deceleration: float = Field(
        10.0, ge=1e-6, le=1000, description="6085h: the drive's own quick-stop ramp [rad/s²]"
    )
    coasting_s: float | None = Field(
        None,
        ge=0,
        le=1,
        description="without new setpoints the drive goes on at its speed for so long, then "
        "stands; none: one period [s]",
    )
    brake_closes_s: float = Field(
        0.02, ge=0, le=1, description="without power the joint's brake holds after at most [s]"
    )
    brake_torque: float | None = Field(
        None, gt=0, le=1e6, description="the brake holds with so much; none: rated_torque [N·m]"
    )

    _table: int | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _leash_inside_window(self) -> "DriveSection":
        if self.leash >= self.following_window:
            raise ValueError(
                f"leash {self.leash} must be below following_window {self.following_window}"
            )
        return self

    def frames(self, operation_mode: str) -> tuple[BusFrames, ...]:
        """Return its answer to SYNC and its setpoint."""
        return (BusFrames(TPDO_BYTES), BusFrames(RPDO_BYTES[operation_mode]))

    def of_table(self, table: int, joint: str, node: int) -> Self:
        """Return the drive of one of the joints that the table of that index means."""
        drive = self.model_copy(update={"joint": joint, "node": node})
        drive._table = table
        return drive

    def key(self, index: int) -> str:
        """Return where the table of the drive of that index stands in its mechanism's."""
        return f"drives[{index if self._table is None else self._table}]"


LONGEST_TOOL: Final = 2.0
"""Tools reach no farther from the Wrist [m]."""
Lever = Annotated[float, Field(ge=-LONGEST_TOOL, le=LONGEST_TOOL)]
"""From the sensor to a payload's centre of mass along an axis [m]; farther is on no arm."""


class PayloadSection(Section):
    """Everything outboard of the force/torque sensor: its weight is taken off the reading."""

    mass: float = Field(0.0, ge=0, le=500, description="mass [kg]")
    com: tuple[Lever, Lever, Lever] = Field(
        (0.0, 0.0, 0.0), description="centre of mass in the Sensor frame [m]"
    )


Moment = Annotated[float, Field(ge=-1e6, le=1e6)]
"""Of inertia [kg·m²]."""

MostForce = Annotated[float, Field(gt=0, le=655.34)]
MostMoment = Annotated[float, Field(gt=0, le=16.3835)]
"""Of a measuring range [N], [N·m]: 16 bits hold no more in the sensor's counts."""
MeasuringRange = tuple[MostForce, MostForce, MostForce, MostMoment, MostMoment, MostMoment]


class LinkInertialSection(Section):
    """Mass and inertia of a link, where the URDF has none or one that no body can have."""

    link: UrdfName = Field(description="link of the URDF")
    mass: float = Field(gt=0, le=1e6, description="mass [kg]")
    com: Vector3 = Field((0.0, 0.0, 0.0), description="centre of mass in the link's frame [m]")
    inertia: tuple[Moment, Moment, Moment, Moment, Moment, Moment] = Field(
        description="xx, yy, zz, xy, xz, yz about the centre of mass, in the link's axes [kg·m²]"
    )


class ForceTorqueSection(OnBusSection):
    """A Robotous RFT force/torque sensor on a CAN bus that has a drive, too."""

    device: Literal["robotous"] = Field("robotous", description="protocol of the sensor")
    command_id: CanId = Field(0x64, description="CAN id that the sensor listens on")
    reply_ids: tuple[CanId, CanId] = Field(
        (0x01, 0x02), description="CAN ids of the two halves of a sample"
    )
    rate_hz: Literal[100, 200, 333, 500, 1000] = Field(200, description="output rate [Hz]")
    pairing_window_s: float = Field(
        0.002, gt=0, le=0.02, description="the two halves of a sample arrive within [s]"
    )
    timeout_s: float = Field(0.05, gt=0, le=1, description="a sample is stale after [s]")
    measuring_range: MeasuringRange = Field(
        (655.34,) * 3 + (16.3835,) * 3,
        description="greatest reading of each axis, by its data sheet; one at an end is none: the "
        "sensor is stale [N, N·m]",
    )
    essential: bool = Field(
        False, description="true: a stale sensor stops the arm; false: the force source fades"
    )
    T_wrist_sensor: PoseSection = Field(
        default_factory=PoseSection, description="Sensor frame in the Wrist (tip_link) frame"
    )
    payload: PayloadSection = Field(
        default_factory=PayloadSection, description="outboard of the sensor"
    )
    bias: Vector6 = Field(
        (0.0,) * 6, description="reading without load, in the Sensor frame [N, N·m]"
    )
    calibration: tuple[Vector6, Vector6, Vector6, Vector6, Vector6, Vector6] | None = Field(
        None,
        description="reading less bias to wrench, row by row, against cross-talk; none: as it is",
    )
    inertia: bool = Field(
        True, description="take off the payload's inertial forces: one period of delay"
    )
    filter_hz: float = Field(
        40.0, gt=0, le=500, description="first-order low-pass of the wrench [Hz]"
    )
    unexplained_force: float = Field(
        3.0, gt=0, le=1e3, description="force in the air beyond which a load was told wrong [N]"
    )
    unexplained_moment: float = Field(0.4, gt=0, le=1e3, description="the same of a moment [N·m]")
    stiffest_environment: float = Field(
        20_000.0,
        gt=0,
        le=1e8,
        description="k_e: stiffest contact expected, in series with the arm's own [N/m]",
    )
    stiffest_environment_rotation: float = Field(
        500.0, gt=0, le=1e6, description="the same about an axis through the MRF [N·m/rad]"
    )
    contact_length: float | None = Field(
        None,
        ge=0,
        le=2,
        description="length of tool, from T_wrist_mrf back to the sensor, that the stiffest "
        "environment may touch; none: all of it [m]",
    )

    def identifiers(self) -> tuple[tuple[str, int], ...]:
        """Return those of its commands and of the halves of a sample."""
        first, second = self.reply_ids
        return (("command_id", self.command_id), ("reply_ids[0]", first), ("reply_ids[1]", second))

    def frames(self, operation_mode: str) -> tuple[BusFrames, ...]:  # noqa: ARG002  it has none
        """Return the two frames of its samples."""
        return (BusFrames(8, self.rate_hz, count=2),)


class GripperSection(CanOpenNodeSection):
    """A gripper on a digital output of a CiA 401 module."""

    output: int = Field(0, ge=0, le=7, description="its bit in 6200h:01 [1]")
    closed: Literal[0, 1] = Field(1, description="the bit's value when the gripper is closed")
    open_payload: Name | None = Field(
        None, description="payload to switch to when it opens; none: as it is"
    )
    closed_payload: Name | None = Field(None, description="the same when it closes")

    def frames(self, operation_mode: str) -> tuple[BusFrames, ...]:  # noqa: ARG002  it has none
        """Return none: its output is sent when it changes."""
        return ()


class MechanismSection(Section):
    """One kinematic chain: a URDF, its place in the World, its drives and its tool."""

    name: Name = Field(description="name of the mechanism")
    urdf: str = Field(description="path, or the name of a URDF that is shipped")
    bus: Name | None = Field(
        None, description="bus of its drives, sensor and gripper; none: the first of the cell"
    )
    T_world_base: PoseSection = Field(
        default_factory=PoseSection, description="Base frame in World"
    )
    on: Name | None = Field(None, description="mechanism that it stands on; none: World")
    T_on: PoseSection | None = Field(
        None, description="Base frame on the mechanism that it stands on, instead of T_world_base"
    )
    operation_mode: Literal["csp", "csv", "cst"] = Field(
        "csp",
        description="what the drives are sent: positions, speeds, or the torques of [torque]",
    )
    drive_hz: float = Field(
        25.0,
        gt=0,
        le=1000,
        description="natural frequency of the drives' own loops, for bounds; a [rig] tells its own",
    )
    rated_payload: float | None = Field(
        None, gt=0, le=500, description="greatest mass at the tool that the arm is rated for [kg]"
    )
    tip_link: str = Field(description="last link of the chain: the Wrist frame")
    first_joint: JointName | None = Field(
        None,
        description="joint of the URDF that the chain begins with; those before it, as of a base "
        "or a torso, stand at zero; none: the first that moves",
    )
    without: tuple[UrdfName, ...] = Field(
        (),
        max_length=16,
        description="links of the URDF that other mechanisms have, each with all that it carries; "
        "what first_joint carries stays",
    )
    T_wrist_mrf: PoseSection = Field(
        default_factory=PoseSection, description="moving reference frame in the Wrist frame"
    )
    drives: tuple[DriveSection, ...] = Field(
        min_length=1, max_length=MOST_DRIVES, description="one per joint"
    )
    inertials: tuple[LinkInertialSection, ...] = Field(
        (), max_length=128, description="masses and inertias in place of the URDF's"
    )
    force_torque: ForceTorqueSection | None = Field(None, description="sensor at the wrist, if any")
    gripper: GripperSection | None = Field(None, description="gripper at the tool, if any")
    backbone: BackboneSection | None = Field(
        None, description="curve through tunnels that the joints follow; absent: a plain arm"
    )
    sweep: SweepSection | None = Field(
        None, description="axis beside the chain that goes to and fro; absent: there is none"
    )
    base: DifferentialBaseSection | None = Field(
        None, description="wheels that carry the arm; absent: it stands where T_world_base says"
    )
    payloads: dict[Name, PayloadSection] = Field(
        default_factory=dict, description="named payloads to switch to, as a whole"
    )
    postures: dict[Name, tuple[float, ...]] = Field(
        description="named postures of the chain's joints [rad]; 'start' and 'ready' are required"
    )

    @field_validator("T_wrist_mrf")
    @classmethod
    def _within_reach(cls, mrf: PoseSection) -> PoseSection:
        far = math.hypot(*mrf.xyz)
        if far > LONGEST_TOOL:
            raise ValueError(
                f"xyz: {far:g} m from the Wrist: no tool reaches farther than {LONGEST_TOOL:g} m"
            )
        return mrf

    @property
    def beside_chain(self) -> tuple[str, ...]:
        """Joints that move the tool not at all, or all of the arm."""
        return (*self.wheels, *(() if self.sweep is None else (self.sweep.joint,)))

    @property
    def wheels(self) -> tuple[str, ...]:
        """Joints of the wheels, left and right; none of an arm that stands."""
        return () if self.base is None else (self.base.wheels.left, self.base.wheels.right)

    def mode_of(self, drive: DriveSection) -> str:
        """Return the operation mode of one of its drives: wheels run at speeds."""
        return "csv" if drive.joint in self.wheels else self.operation_mode
