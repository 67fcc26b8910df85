"""Schema of an arm: chain, drives, sensor, payloads, gripper; its base, backbone, torque law."""

import math
from typing import Annotated, ClassVar, Final, Literal, Self

from pydantic import Field, PrivateAttr, field_validator, model_validator

from .bus import BusFrames, CanId, CanOpenNodeSection, OnBusSection
from .section import EachJoint, Name, PoseSection, Positive, Section, UrdfName, Vector3, Vector6

# --- Schema of a hyper-redundant arm: its curve, and the tunnels it goes through ------------------

_Turn = Annotated[float, Field(ge=-math.pi, le=math.pi)]


class SegmentSection(Section):
    """A straight, circular or helical piece of a tunnel; x of its frame is the tangent.

    Its frame turns evenly about an axis of its own: |(bend, climb)| / length is the curvature,
    roll / length the torsion.
    """

    length: float = Field(gt=1e-3, le=20, description="along the centre line [m]")
    bend: _Turn = Field(0.0, description="turn to the left, about its own z [rad]")
    climb: _Turn = Field(0.0, description="turn upward, about its own -y [rad]")
    roll: _Turn = Field(
        0.0,
        description="turn about its own x, the tangent; with a bend or climb the piece is a helix "
        "of torsion roll / length, right-handed where positive [rad]",
    )
    to: PoseSection | None = Field(
        None,
        description="entrance of the next tunnel in World: the piece is the gap before it, of this "
        "length, without walls; its curve is solved once",
    )
    open: bool = Field(
        False, description="true: no walls; the curve beyond the exit, at the end of the list"
    )


class FeedSection(Section):
    """A rail that advances the arm's foot along the entrance's x as the arm is inserted.

    In proportion to the free length, which is greatest with the foot back.
    """

    joint: UrdfName = Field(description="prismatic joint of the URDF, the first of the chain")
    back: float = Field(ge=-50, le=50, description="where it is at the greatest free length [m]")
    front: float = Field(ge=-50, le=50, description="where it is at the least free length [m]")


class BackboneSection(Section):
    """The arm is a curve through tunnels; its joints follow (Chirikjian & Burdick 1990)."""

    axes: Literal["planar", "universal", "alternating"] = Field(
        "planar", description="the joints' axes: all parallel, in crossing pairs, or in turn"
    )
    exterior: Literal["bessel", "modal"] = Field(
        "bessel",
        description="the free curve from the first joint to the entrance: one cosine of curvature, "
        "or a sum of modes",
    )
    modes: tuple[Annotated[float, Field(ge=-10, le=10)], ...] = Field(
        (1.0, -0.5),
        min_length=1,
        max_length=8,
        description="of a modal exterior: shares of 1, 2, … sine waves of attitude along it",
    )
    bow: float | None = Field(
        None,
        ge=-math.pi,
        le=math.pi,
        description="where it bows out to, about the entrance's x from its y; none: away from the "
        "first bend, and 0.79 off it unless planar [rad]",
    )
    entrance: PoseSection = Field(
        description="of the tunnel in World: x points into it, straight ahead of the first joint"
    )
    feed: FeedSection | None = Field(
        None, description="rail that carries the arm's foot; absent: it stands"
    )
    start: float = Field(gt=0, le=50, description="free length s1 of the posture 'start' [m]")
    least: float = Field(
        gt=0,
        le=50,
        description="least free length: at 1.05 of the way to the entrance, or more [m]",
    )
    half_width: float = Field(gt=0, le=1, description="of the tunnel, centre line to wall [m]")
    link_radius: float = Field(gt=0, le=1, description="of the links' housings [m]")
    clearance: float = Field(
        0.004, ge=0, le=1, description="kept to the walls along every stop [m]"
    )
    speed: float = Field(0.08, gt=0, le=1, description="greatest insertion speed [m/s]")
    acceleration: float = Field(0.3, gt=0, le=10, description="of the insertion [m/s²]")
    most_push: float = Field(
        10.0, gt=0, le=1e4, description="force of the head at which a drive inserts no further [N]"
    )
    quick_stop: Literal["in_proportion", "each"] = Field(
        "in_proportion",
        description="in_proportion: drives are told ramps by which all joints come to rest "
        "together, along the curve (6085h by RPDO2); each: every joint by its own "
        "quick_stop_deceleration",
    )
    tunnel: tuple[SegmentSection, ...] = Field(
        min_length=1, max_length=64, description="its pieces, from the entrance on"
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.start <= self.least:
            raise ValueError(f"start = {self.start:g} must be above least = {self.least:g}")
        if self.half_width <= self.link_radius + self.clearance:
            raise ValueError(
                f"half_width = {self.half_width:g} must be above link_radius + clearance = "
                f"{self.link_radius + self.clearance:g}"
            )
        for i, piece in enumerate(self.tunnel):
            turns = piece.bend or piece.climb or piece.roll
            if piece.to is not None and (turns or piece.open):
                raise ValueError(f"tunnel[{i}].to: a gap has no bend, climb or roll, and ends")
        if self.tunnel[0].to is not None or self.tunnel[-1].to is not None:
            raise ValueError("tunnel: a gap lies between two pieces with walls")
        if not any(self.modes):
            raise ValueError("modes: one must not be 0")
        walled = [not piece.open for piece in self.tunnel]
        if not walled[0] or walled != sorted(walled, reverse=True):
            raise ValueError("tunnel: open pieces come last, after one with walls")
        for i, piece in enumerate(self.tunnel):
            for name, turn in (("climb", piece.climb), ("roll", piece.roll)):
                if self.axes == "planar" and turn:
                    raise ValueError(f"tunnel[{i}].{name}: a planar arm cannot follow it")
            angle = math.hypot(piece.bend, piece.climb)
            if angle * self.half_width >= piece.length and not piece.open:
                raise ValueError(
                    f"tunnel[{i}]: a radius of {piece.length / angle:.4g} m is within the "
                    f"half width {self.half_width:g} m"
                )
        return self


# --- Schema of a base on wheels that carries the arm ----------------------------------------------


class WheelsSection(Section):
    """The driven wheels of a base, one on each side: joints of the URDF that turn for ever.

    Wheels on more than one axle skid as the base turns, so that it turns as if it were wider
    (Mandow et al. 2007: the instantaneous centres of its sides are farther apart than its wheels).
    """

    left: Name = Field(
        description="joint of the left wheel; it turns about the Base's y axis, or against it"
    )
    right: Name = Field(description="joint of the right wheel")
    radius: float = Field(gt=0.01, le=2, description="radius of either wheel [m]")
    track: float = Field(gt=0.05, le=5, description="between their points of contact [m]")
    followers: tuple[Name, ...] = Field(
        (),
        max_length=8,
        description="joints of further wheels, which a belt, chain or gear turns with the driven "
        "one of their side; they have no drives",
    )
    slip_factor: float = Field(
        1.0,
        ge=1,
        le=10,
        description="the base turns as if its track were so many times as wide: 1 for two wheels "
        "that roll; measured, where wheels skid as it turns [1]",
    )
    centre: float = Field(
        0.0,
        ge=-2,
        le=2,
        description="the base turns on the spot about a point so far ahead of Base: 0 for two "
        "wheels that roll; measured, where wheels skid, towards the heavier end [m]",
    )

    @model_validator(mode="after")
    def _differ(self) -> "WheelsSection":
        if self.left == self.right:
            raise ValueError(f"left and right are one joint: '{self.left}'")
        names = (self.left, self.right, *self.followers)
        if (twice := next((n for n in names if names.count(n) > 1), None)) is not None:
            raise ValueError(f"followers: '{twice}' is named twice")
        return self

    @property
    def turning_track(self) -> float:
        """Distance between the centres of turning of the two sides [m]."""
        return self.slip_factor * self.track


PostureObjective = Literal[
    "mid_range",
    "manipulability",
    "posture",
    "gravity_torque",
    "holding_torque",
    "sigma_min",
    "condition",
]
"""Objectives that depend on the arm's posture alone, wherever the base is."""


class DrivenSection(Section):
    """What an operator drives as a whole, beside the tool, by `cmd/drive`."""

    rate_units: ClassVar[tuple[str, ...]] = ("m/s", "rad/s")
    weight: float = Field(
        6.0,
        ge=0.1,
        le=100,
        description="cost of arm motion over that of the base, in its units [1]",
    )
    speed: float = Field(0.5, gt=0, le=10, description="cmd/drive asks for at most [m/s]")
    objectives: tuple[PostureObjective, ...] = Field(
        (),
        description="while one of these redundancy objectives acts, self-motion is that of base "
        "and arm together, as long as the tool is led in World and nobody drives: the base moves "
        "by itself below a tool that stays",
    )

    @property
    def most(self) -> tuple[float, ...]:
        """The greatest rates of `cmd/drive`, in `rate_units`."""
        raise NotImplementedError


class DifferentialBaseSection(DrivenSection):
    """A base with a driven wheel on either side; Base is midway between its wheels.

    Its x axis points ahead, its z axis up; it is on the floor, or as high above it as
    `T_world_base` says. The wheels' drives are in CSV, whatever the arm's are.
    """

    kind: Literal["differential"] = Field(description="how the base moves")
    wheels: WheelsSection = Field(description="what it rolls on")
    angular_speed: float = Field(1.0, gt=0, le=10, description="cmd/drive asks for at most [rad/s]")
    slip: tuple[Positive, Positive] = Field(
        (0.05, 0.05),
        description="odometry that disagrees with news of Base by more means that wheels slip "
        "[m], [rad]",
    )
    slip_rate: float = Field(
        0.03,
        gt=0,
        le=1,
        description="a gyroscope on Base that disagrees with the wheels by more is believed, and "
        "they are not [rad/s]",
    )
    slip_speed: float = Field(
        0.05,
        gt=0,
        le=5,
        description="an accelerometer on Base that disagrees with the wheels by more is believed "
        "of how fast it goes ahead, and they are not [m/s]",
    )
    correction: tuple[Positive, Positive] = Field(
        (0.05, 0.1),
        description="news of Base corrects the odometry by at most [m/s], [rad/s]",
    )

    @property
    def most(self) -> tuple[float, ...]:
        """The greatest rates ahead and about its axis."""
        return (self.speed, self.angular_speed)


class GantrySection(DrivenSection):
    """Rails that carry the arm: one to three prismatic joints, the first ones of the chain.

    Units of their drives are metres and newtons. `cmd/drive` and the keys v, b drive the first of
    them, the keys `,` and `.` the second; a tool that is led far takes all of them along.
    """

    rate_units: ClassVar[tuple[str, ...]] = ("m/s", "m/s")
    joints: tuple[UrdfName, ...] = Field(
        min_length=1, max_length=3, description="prismatic joints of the URDF, from the floor on"
    )

    @property
    def most(self) -> tuple[float, ...]:
        """The greatest rates along the first axis, and along the second one."""
        return (self.speed, self.speed if len(self.joints) > 1 else 0.0)


# --- Schema of a torso: joints that arms share ----------------------------------------------------


class TorsoSection(Section):
    """The mechanism carries others, which stand `on` its tip link: its joints move all their tools.

    Tools that are led in World share them (`server/control/torso.py`); where the torso is commanded
    itself, its arms answer it.
    """

    weight: Annotated[tuple[Annotated[float, Field(ge=0.01, le=100)], ...], EachJoint] = Field(
        (1.0,),
        min_length=1,
        max_length=16,
        description="cost of the arms' motion over that of its joints, in their units; one for all "
        "or one each [1]",
    )


# --- Schema of an axis that sweeps: a scanner's tilt ----------------------------------------------


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


# --- Schema of the arm: its chain, drives, sensor, payloads and gripper ---------------------------

RPDO_BYTES: Final = {"csp": 6, "csv": 6, "cst": 4}
"""Controlword, and the setpoint of each operation mode."""
FELT_S: Final = 0.03
"""Time after which the stop of a joint that felt something begins [s]."""
SPARE: Final = 1.5
"""A following window is so many times what a joint falls behind by alone: others push it [1]."""
MOST_WINDOW: Final = 2.0
"""Greatest following window [rad]."""
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
    following_window: float | None = Field(
        None,
        gt=0,
        le=MOST_WINDOW,
        description="following error that means quick stop, also 6065h; none: half more than what "
        "a joint that meets something at full speed falls behind until its stop has ended, "
        "1.5 (v²/(2 A) + 0.03 s · v), and at least twice the leash [rad]",
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
        if self.leash >= self.window:
            raise ValueError(f"leash {self.leash} must be below following_window {self.window}")
        return self

    @property
    def window(self) -> float:
        """The following window, told or not [rad]."""
        if self.following_window is not None:
            return self.following_window
        falls_behind = self.max_velocity**2 / (2.0 * self.max_acceleration)
        falls_behind += FELT_S * self.max_velocity
        return min(max(SPARE * falls_behind, 2.0 * self.leash), MOST_WINDOW)

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


HALF_COUNTS: Final = 32767
"""A reading of 16 bits goes so far either way [1]."""


class VirtualImuSection(Section):
    """Imperfections of the virtual unit; the daemon never reads them."""

    acceleration_bias: Vector3 = Field(
        (0.0, 0.0, 0.0), description="true reading in free fall, in its axes [m/s²]"
    )
    rate_bias: Vector3 = Field((0.0, 0.0, 0.0), description="true reading at rest [rad/s]")
    acceleration_noise: float = Field(
        0.02, ge=0, le=10, description="standard deviation of a sample, per axis [m/s²]"
    )
    rate_noise: float = Field(0.002, ge=0, le=1, description="the same [rad/s]")


class ImuSection(CanOpenNodeSection):
    """An inertial measurement unit: accelerometer and gyroscope, sampled at every SYNC.

    Any CANopen node whose readings are of 16 bits; counts and objects by default are those of
    SICK's TMM61. It is told of, and stops nothing.
    """

    on: Literal["base", "wrist"] = Field(
        "base", description="frame that it is fixed to: Base, which may roll, or the Wrist"
    )
    T_on_imu: PoseSection = Field(
        default_factory=PoseSection, description="the unit's frame in that one"
    )
    acceleration_object: int = Field(
        0x3102, ge=0x2000, le=0xFFFF, description="index of its specific force, sub-indices 1 to 3"
    )
    rate_object: int = Field(
        0x3103, ge=0x2000, le=0xFFFF, description="index of its angular rate, sub-indices 1 to 3"
    )
    acceleration_per_bit: float = Field(9.80665 / 4096, gt=0, le=1, description="of a count [m/s²]")
    rate_per_bit: float = Field(
        math.radians(7 / 800), gt=0, le=0.1, description="of a count [rad/s]"
    )
    acceleration_range: float = Field(
        78.0, gt=0, le=1e4, description="greatest reading of an axis, by its data sheet [m/s²]"
    )
    rate_range: float = Field(
        4.36, gt=0, le=1e3, description="the same; a reading at an end is none [rad/s]"
    )
    acceleration_bias: Vector3 = Field(
        (0.0, 0.0, 0.0), description="taken off the reading, in its axes [m/s²]"
    )
    rate_bias: Vector3 = Field((0.0, 0.0, 0.0), description="the same [rad/s]")
    virtual: VirtualImuSection = Field(
        default_factory=VirtualImuSection, description="imperfections of the virtual unit"
    )

    @model_validator(mode="after")
    def _range_fits_its_counts(self) -> "ImuSection":
        for what, unit in (("acceleration", "m/s²"), ("rate", "rad/s")):
            end = HALF_COUNTS * float(getattr(self, f"{what}_per_bit"))
            told = float(getattr(self, f"{what}_range"))
            if told > end:
                raise ValueError(
                    f"{what}_range {told:g} {unit}: 16 bits of {what}_per_bit end at {end:.4g}"
                )
        if self.acceleration_object == self.rate_object:
            raise ValueError(f"rate_object {self.rate_object:#x} is acceleration_object, too")
        return self

    def identifiers(self) -> tuple[tuple[str, int], ...]:
        """Return those of a node, and of its second TPDO."""
        return (*super().identifiers(), ("node", 0x280 + self.node))

    def frames(self, operation_mode: str) -> tuple[BusFrames, ...]:  # noqa: ARG002  it has none
        """Return its two answers to SYNC."""
        return (BusFrames(6, count=2),)

    def about(self) -> str:
        """Return what it measures, and how finely."""
        return (
            f"on {self.on.capitalize()}, ±{self.acceleration_range:g} m/s² in steps of "
            f"{self.acceleration_per_bit:.2g}, ±{self.rate_range:g} rad/s in steps of "
            f"{self.rate_per_bit:.2g}, every SYNC"
        )


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
    on: Name | None = Field(
        None, description="mechanism whose tip link it stands on, one with [torso]; none: World"
    )
    T_on: PoseSection | None = Field(
        None,
        description="Base frame in the tip link of the mechanism that it stands on, instead of "
        "T_world_base",
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
    imu: ImuSection | None = Field(None, description="inertial measurement unit, if any")
    backbone: BackboneSection | None = Field(
        None, description="curve through tunnels that the joints follow; absent: a plain arm"
    )
    sweep: SweepSection | None = Field(
        None, description="axis beside the chain that goes to and fro; absent: there is none"
    )
    base: DifferentialBaseSection | None = Field(
        None, description="wheels that carry the arm; absent: it stands where T_world_base says"
    )
    gantry: GantrySection | None = Field(
        None, description="rails that carry the arm; absent: it stands where T_world_base says"
    )
    torso: TorsoSection | None = Field(
        None, description="other mechanisms stand on it, and share its joints; absent: none does"
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

    @model_validator(mode="after")
    def _one_kind_of_body(self) -> "MechanismSection":
        if self.gantry is not None and (self.base is not None or self.backbone is not None):
            raise ValueError("gantry: an arm that rolls, or follows a curve, has none")
        return self

    @property
    def base_moves(self) -> bool:
        """Joints move its Base: wheels of its own, or those of what it stands on."""
        return self.base is not None or self.on is not None

    @property
    def driven(self) -> "DrivenSection | None":
        """What an operator drives as a whole, beside the tool; None for nothing."""
        return self.base or self.gantry

    @property
    def rails(self) -> tuple[str, tuple[str, ...]]:
        """Joints that slide ahead of the arm's own, and the key that names them."""
        if self.gantry is not None:
            return "mechanism.gantry.joints", self.gantry.joints
        feed = None if self.backbone is None else self.backbone.feed
        return "mechanism.backbone.feed.joint", () if feed is None else (feed.joint,)

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


# --- Schema of the law that turns commanded motion into torques (CST) -----------------------------

Share = Annotated[float, Field(ge=0, le=1)]


class TorqueSection(Section):
    """Computed torque in the tool's space, for drives in CST; one value for all joints or each.

    The errors of tool and joints die out as `ë + K_d ė + K_p e = 0` does.
    """

    stiffness: float = Field(100.0, gt=0, le=1e4, description="K_p of the tool's pose [1/s²]")
    damping: float = Field(20.0, gt=0, le=500, description="K_d of the tool's pose [1/s]")
    null_stiffness: float = Field(100.0, ge=0, le=1e4, description="K_p of self-motion [1/s²]")
    null_damping: float = Field(20.0, gt=0, le=500, description="K_v of self-motion [1/s]")
    friction_speed: float = Field(
        0.01,
        gt=0,
        le=1,
        description="commanded speed at which most of the joints' friction is fed forward [rad/s]",
    )
    friction_lead: float = Field(
        2.0, ge=0, le=50, description="joint error to speed, where friction may hold a joint [1/s]"
    )
    observer: float = Field(
        10.0, ge=0, le=100, description="bandwidth of the momentum observer; 0: off [1/s]"
    )
    observer_share: Share = Field(
        0.2, description="part of max_torque that the observer may compensate [1]"
    )
    compensation: Share = Field(
        1.0, description="share of the measured contact wrench that is compensated [1]"
    )
    lag_s: float = Field(
        0.0, ge=0, le=0.2, description="how late the tool is behind its command, as measured [s]"
    )
    velocity_filter_hz: float = Field(
        30.0, gt=0, le=500, description="corner of the correction of speeds by encoders [Hz]"
    )
    singular_region: float = Field(
        0.02, gt=0, le=10, description="tool mobility below which joints take over [1/kg]"
    )
    singular_damping: float = Field(
        0.01, gt=0, le=10, description="damping of the tool's inertia at no mobility [1/kg]"
    )
    speed_gain: float = Field(
        5.0, ge=0, le=50, description="CSV: joint error to speed, beside the commanded speed [1/s]"
    )


# --- Schema of collision detection by the drives' torques -----------------------------------------

Torque = Annotated[float, Field(gt=0, le=1e5)]


class TouchSection(Section):
    """Contact that no sensor sees: what the drives give beside what the model says they need."""

    torque: Annotated[tuple[Torque, ...], EachJoint] = Field(
        min_length=1,
        max_length=64,
        description="external torque that means contact, one for all joints or one each [N·m]",
    )
    doubt: float = Field(
        0.35,
        ge=0,
        le=2,
        description="part of the torque that accelerates the arm which may be wrong: inertias, and "
        "the drives' torque reported late [1]",
    )
    filter_hz: float = Field(
        6.0, gt=0, le=50, description="corner of the low-pass on the estimate [Hz]"
    )
    confirm_s: float = Field(
        0.02, ge=0, le=0.5, description="contact must last this long to stop the arm [s]"
    )
    leash: float = Field(
        0.1, gt=0, le=0.5, description="a joint gives way in HOLD after a touch by at most [rad]"
    )
