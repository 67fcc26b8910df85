"""What a cell file may say: every field with its unit, bound, default and meaning.

One TOML file describes one cell. Unknown keys are errors, numbers are finite, SI throughout
(metres, radians, seconds, newtons). `load.py` reads a file into these models and adds the robot
description; `check.py` in the tools judges what a schema cannot see.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .cameras import Camera, RigTag, Vision
from .following import Following
from .moving import Frames, RigFrames
from .obstacles import Avoidance, Obstacle
from .peg import RigHole, RigPeg
from .potential import PotentialField
from .priority import Priority
from .reflection import Reflection
from .section import Name as Name
from .section import Pose as Pose
from .section import Section as Section
from .section import Vector3 as Vector3
from .section import Vector6 as Vector6
from .torque import Torque
from .touch import Touch

NodeId = Annotated[int, Field(ge=1, le=127)]
CanId = Annotated[int, Field(ge=0, le=0x7FF)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]


OBJECTIVES = ("mid_range", "manipulability", "posture", "least_energy", "field", "spheres")
"""The redundancy objectives."""


class Timing(Section):
    """The clockwork: T < tolerated overruns * T < setpoint < heartbeat < lease timeout."""

    period_s: float = Field(0.010, ge=0.001, le=0.1, description="control and SYNC period T [s]")
    tolerated_overruns: int = Field(
        4, ge=1, le=50, description="late ticks in a row before the verified stop [1]"
    )
    setpoint_timeout_s: float = Field(
        0.080, gt=0, le=1, description="a drive without a new setpoint stops by itself after [s]"
    )
    heartbeat_period_s: float = Field(
        0.050, gt=0, le=1, description="heartbeats are produced every [s]"
    )
    heartbeat_timeout_s: float = Field(
        0.200, gt=0, le=5, description="a silent heartbeat is a dead peer after [s]"
    )
    lease_timeout_s: float = Field(
        0.500, gt=0, le=10, description="an operator's lease that is not renewed ends after [s]"
    )
    stream_timeout_s: float = Field(
        0.150, gt=0, le=5, description="a stream (stick, jog) fades when its news is older than [s]"
    )
    max_command_age_s: float = Field(
        0.500, gt=0, le=10, description="oldest telemetry a command may be based on [s]"
    )


class Bus(Section):
    """The CAN bus: any python-can interface, or one of the two that need no hardware."""

    interface: str = Field(
        "loopback",
        description="'loopback' (UDP pinned to 127.0.0.1, between processes), 'in_process', or any "
        "python-can interface, for instance 'socketcan'",
    )
    channel: str = Field(
        "239.74.163.10",
        description="python-can channel: 'can0' for socketcan, a multicast group for loopback",
    )
    port: int = Field(43210, ge=1024, le=65535, description="UDP port of a loopback bus [1]")
    bitrate: int = Field(1_000_000, ge=10_000, le=1_000_000, description="bits per second [1/s]")
    options: dict[str, str | int | float | bool] = Field(
        default_factory=dict, description="passed to python-can as they stand"
    )


class Zenoh(Section):
    """Where operators reach the daemon. Loopback only unless said otherwise."""

    listen: str = Field(
        "tcp/127.0.0.1:7447",
        pattern=r"^[a-z][a-z0-9-]*/\S+$",
        description="endpoint that the daemon listens on and operators dial",
    )


class Drive(Section):
    """One CAN servo drive and the joint it moves; what differs from arm to arm stands here."""

    joint: Name = Field(description="joint of the URDF that this drive moves")
    node: NodeId = Field(description="CANopen node id [1]")
    counts_per_radian: float = Field(
        gt=100, le=1e9, description="encoder counts per radian of the joint [1/rad]"
    )
    direction: Literal[1, -1] = Field(1, description="+1 if counts grow with the joint angle")
    zero_rad: float = Field(
        0.0, ge=-100, le=100, description="joint angle at encoder count zero [rad]"
    )
    rated_torque: float = Field(
        gt=0, le=1e5, description="torque at the joint that 6077h reports as 1000 [N·m]"
    )
    max_torque: float = Field(gt=0, le=1e5, description="torque limit of the drive [N·m]")
    rotor_inertia: float = Field(
        0.0, ge=0, le=1e4, description="what its rotor adds at the joint, for dynamics [kg·m²]"
    )
    friction: float = Field(
        0.0, ge=0, le=1e5, description="Coulomb friction at the joint, for dynamics [N·m]"
    )
    max_velocity: float = Field(gt=0, le=50, description="joint speed bound V [rad/s]")
    max_acceleration: float = Field(gt=0, le=500, description="joint acceleration bound A [rad/s²]")
    max_jerk: float = Field(gt=0, le=50_000, description="joint jerk bound J [rad/s³]")
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
        10.0, gt=0, le=1000, description="6085h: the drive's own quick-stop ramp [rad/s²]"
    )

    @model_validator(mode="after")
    def _leash_inside_window(self) -> "Drive":
        if self.leash >= self.following_window:
            raise ValueError(
                f"leash {self.leash} must be below following_window {self.following_window}"
            )
        return self


class Payload(Section):
    """Everything outboard of the force/torque sensor: its weight is taken off the reading."""

    mass: float = Field(0.0, ge=0, le=500, description="mass [kg]")
    com: Vector3 = Field((0.0, 0.0, 0.0), description="centre of mass in the Sensor frame [m]")


class ForceTorque(Section):
    """A Robotous RFT force/torque sensor on the same CAN bus."""

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
    essential: bool = Field(
        False, description="true: a stale sensor stops the arm; false: the force source fades"
    )
    T_wrist_sensor: Pose = Field(
        default_factory=Pose, description="Sensor frame in the Wrist (tip_link) frame"
    )
    payload: Payload = Field(default_factory=Payload, description="outboard of the sensor")
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
    stiffest_environment: float = Field(
        20_000.0,
        gt=0,
        le=1e8,
        description="k_e: stiffest contact expected, in series with the arm's own [N/m]",
    )
    stiffest_environment_rotation: float = Field(
        500.0, gt=0, le=1e6, description="the same about an axis through the MRF [N·m/rad]"
    )


class Gripper(Section):
    """A gripper on a digital output of a CiA 401 module, on the same CAN bus."""

    node: NodeId = Field(description="CANopen node id of the module [1]")
    output: int = Field(0, ge=0, le=7, description="its bit in 6200h:01 [1]")
    closed: Literal[0, 1] = Field(1, description="the bit's value when the gripper is closed")
    open_payload: Name | None = Field(
        None, description="payload to switch to when it opens; none: as it is"
    )
    closed_payload: Name | None = Field(None, description="the same when it closes")


class Mechanism(Section):
    """One kinematic chain: a URDF, its place in the World, its drives and its tool."""

    name: Name = Field(description="name of the mechanism")
    urdf: str = Field(description="path, or the name of a URDF that is shipped")
    T_world_base: Pose = Field(default_factory=Pose, description="Base frame in World")
    operation_mode: Literal["csp", "csv", "cst"] = Field(
        "csp",
        description="what the drives are sent: positions, speeds, or the torques of [torque]",
    )
    tip_link: str = Field(description="last link of the chain: the Wrist frame")
    T_wrist_mrf: Pose = Field(
        default_factory=Pose, description="moving reference frame in the Wrist frame"
    )
    drives: tuple[Drive, ...] = Field(min_length=1, max_length=64, description="one per joint")
    force_torque: ForceTorque | None = Field(None, description="sensor at the wrist, if any")
    gripper: Gripper | None = Field(None, description="gripper at the tool, if any")
    payloads: dict[Name, Payload] = Field(
        default_factory=dict, description="named payloads to switch to, as a whole"
    )
    postures: dict[Name, tuple[float, ...]] = Field(
        description="named joint postures [rad]; 'start' and 'ready' are required"
    )


class Joystick(Section):
    """Rates from a stick, times a gain per axis (K_HC)."""

    enabled: bool = Field(True, description="switch at start")
    gain: Vector6 = Field((1.0,) * 6, description="K_HC [1]")


class Position(Section):
    """Target poses: a jerk-limited path, followed with error feedback (K_P)."""

    enabled: bool = Field(True, description="switch at start")
    gain: Vector6 = Field((2.0,) * 6, description="K_P: error to rate [1/s]")
    speed: float = Field(0.15, gt=0, le=5, description="path speed [m/s]")
    angular_speed: float = Field(0.5, gt=0, le=10, description="path speed [rad/s]")


class Force(Section):
    """Force–moment accommodation: rate = K_F (desired wrench − wrench), per axis."""

    enabled: bool = Field(True, description="switch at start")
    gain: Vector6 = Field(
        (7e-4, 7e-4, 7e-4, 0.03, 0.03, 0.03), description="K_F [m/s/N, rad/s/(N·m)]"
    )
    hold_threshold: float = Field(
        30.0, gt=0, le=1e4, description="contact force in HOLD that FMA bleeds off [N]"
    )
    hold_leash: float = Field(
        0.02, ge=0, le=0.2, description="largest tool travel while bleeding off [m]"
    )


class Sources(Section):
    """What may ask the tool for a rate. All on at once; the rates add."""

    joystick: Joystick = Field(default_factory=Joystick, description="the operator's stick")
    position: Position = Field(default_factory=Position, description="target poses")
    vision: Vision = Field(default_factory=Vision, description="a camera's view")
    force: Force = Field(default_factory=Force, description="force control")
    following: Following = Field(default_factory=Following, description="a hand at the tool")


class Schedule(Section):
    """A source's gain as a function of something measured: a table of factors, interpolated."""

    source: Literal["joystick", "position", "force", "following"] = Field(
        description="whose gain it is"
    )
    by: Literal["contact_force", "distance", "time"] = Field(
        description="what decides: contact force at the MRF [N], distance from the MRF to the "
        "target [m], or time since enable [s]"
    )
    at: tuple[NonNegative, ...] = Field(
        min_length=2, max_length=32, description="where the table's points are, rising [N, m or s]"
    )
    factor: tuple[Share, ...] = Field(
        min_length=2, max_length=32, description="the gain's factor at each, 0 to 1 [1]"
    )
    axes: tuple[Share, Share, Share, Share, Share, Share] = Field(
        (1.0,) * 6, description="how much each axis heeds the factor: 1 in full, 0 not at all [1]"
    )

    @model_validator(mode="after")
    def _is_a_table(self) -> "Schedule":
        if len(self.at) != len(self.factor):
            raise ValueError(f"{len(self.at)} points in 'at', {len(self.factor)} in 'factor'")
        if any(b <= a for a, b in zip(self.at, self.at[1:], strict=False)):
            raise ValueError("'at' must rise from point to point")
        return self


class Limits(Section):
    """Bounds of the tool's motion; joint bounds stand with the drives."""

    speed: float = Field(0.5, gt=0, le=10, description="MRF speed [m/s]")
    angular_speed: float = Field(1.5, gt=0, le=20, description="MRF angular speed [rad/s]")
    acceleration: float = Field(2.0, gt=0, le=100, description="shaping of commands [m/s²]")
    angular_acceleration: float = Field(6.0, gt=0, le=300, description="the same [rad/s²]")
    jerk: float = Field(40.0, gt=0, le=10_000, description="shaping of commands [m/s³]")
    angular_jerk: float = Field(120.0, gt=0, le=30_000, description="the same [rad/s³]")
    speed_factor: float = Field(
        1.0, ge=0.01, le=1.0, description="reduced speed: one factor on all limits, at start [1]"
    )


class Resolve(Section):
    """Damped resolution of tool rates into joint rates near singularities."""

    characteristic_length: float = Field(
        0.3, gt=0, le=5, description="weighs radians against metres [m]"
    )
    singular_region: float = Field(
        0.05, gt=0, le=2, description="σ0: damping begins below this singular value [m]"
    )
    damping: float = Field(0.02, gt=0, le=2, description="λm: damping at σ = 0 [m]")
    floor: float = Field(
        0.01, gt=0, le=1, description="singular value below which motion into it is held off [m]"
    )


class Redundancy(Section):
    """What the null space is used for; each gain 0 switches its objective off."""

    mid_range: float = Field(
        0.2, ge=0, le=10, description="pull of every joint to the middle of its range [1/s]"
    )
    manipulability: float = Field(
        0.0, ge=0, le=10, description="away from singularities, times the slope of √det(JJᵀ) [1/s]"
    )
    posture: float = Field(
        0.0, ge=0, le=10, description="pull of every joint to the posture of that name [1/s]"
    )
    posture_name: Name = Field("ready", description="posture that the joints are pulled to")
    least_energy: float = Field(
        0.0, ge=0, le=1, description="share of the way to the least kinetic energy [1]"
    )
    field: float = Field(
        0.0, ge=0, le=10, description="how quickly to the least of the potential field [1/s]"
    )
    spheres: float = Field(
        0.0, ge=0, le=10, description="share of the rates that [priority] asks for [1]"
    )
    max_rate: float = Field(
        0.5, ge=0, le=10, description="bound of the self-motion, as a part of V [1]"
    )

    @property
    def gains(self) -> dict[str, float]:
        """The objectives' gains by name."""
        return {name: getattr(self, name) for name in OBJECTIVES}


class RigDrive(Section):
    """The physics behind one simulated drive; one value for all joints or one each."""

    stiffness: tuple[Positive, ...] = Field(description="position loop K_p [N·m/rad]")
    damping: tuple[Positive, ...] = Field(description="position loop K_d [N·m·s/rad]")
    integral: tuple[NonNegative, ...] = Field(description="position loop K_i [N·m/(rad·s)]")
    armature: tuple[NonNegative, ...] = Field(description="rotor inertia at the joint [kg·m²]")
    friction: tuple[NonNegative, ...] = Field(description="Coulomb friction [N·m]")
    torque_filter_s: float = Field(
        0.005, ge=0, le=0.1, description="time constant of the torque that it reports [s]"
    )
    torque_delay_s: float = Field(
        0.02, ge=0, le=0.5, description="brake opens this long before torque stands: the sag [s]"
    )


class RigForceTorque(Section):
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


class RigGripper(Section):
    """What the simulated gripper takes hold of when it closes."""

    mass: float = Field(0.0, ge=0, le=500, description="its mass [kg]")
    com: Vector3 = Field(
        (0.0, 0.0, 0.0), description="its centre of mass in the true Sensor frame [m]"
    )


class Wall(Section):
    """A plate on a sprung, damped slide: its stiffness is a number."""

    xyz: Vector3 = Field(description="centre of the plate's face, in World [m]")
    normal: Vector3 = Field((-1.0, 0.0, 0.0), description="out of the face, in World")
    half_size: float = Field(0.25, gt=0, le=5, description="half the side of the plate [m]")
    stiffness: float = Field(20_000.0, gt=0, le=1e6, description="of the slide [N/m]")
    damping: float = Field(300.0, ge=0, le=1e5, description="of the slide [N·s/m]")
    mass: float = Field(1.0, gt=0, le=1000, description="of the plate [kg]")


class Box(Section):
    """A fixed box, such as a table."""

    name: Name = Field(description="name of the body")
    xyz: Vector3 = Field(description="centre, in World [m]")
    rpy: Vector3 = Field((0.0, 0.0, 0.0), description="attitude, in World [rad]")
    half_size: Vector3 = Field(description="half the sides [m]")


class Rig(Section):
    """The virtual hardware: never read by the daemon."""

    seed: int = Field(1, ge=0, description="seed of the sensor noise [1]")
    physics_step_s: float = Field(0.001, ge=1e-4, le=0.002, description="physics step [s]")
    drive: RigDrive = Field(description="what is behind every simulated drive")
    force_torque: RigForceTorque = Field(
        default_factory=RigForceTorque, description="sensor imperfections"
    )
    tool_radius: float = Field(
        0.012, ge=0, le=0.2, description="ball at the MRF that touches things, 0 for none [m]"
    )
    payload_mass: float = Field(0.0, ge=0, le=500, description="true mass outboard of sensor [kg]")
    payload_com: Vector3 = Field(
        (0.0, 0.0, 0.0), description="its true centre of mass in the true Sensor frame [m]"
    )
    gripper: RigGripper = Field(
        default_factory=RigGripper, description="what the gripper takes hold of"
    )
    wall: Wall | None = Field(None, description="a wall of known stiffness")
    boxes: tuple[Box, ...] = Field((), description="fixed boxes, such as a table")
    peg: RigPeg | None = Field(None, description="a peg as the tool")
    holes: tuple[RigHole, ...] = Field((), max_length=16, description="holes to insert it into")
    tags: tuple[RigTag, ...] = Field((), description="planar tags that cameras can see")
    frames: RigFrames = Field(
        default_factory=RigFrames, description="motion of platform and Carrier, and their news"
    )


class CellConfig(Section):
    """A whole cell file."""

    name: Name = Field(description="name of the cell: the second part of every Zenoh key")
    description: str = Field("", max_length=200, description="one line for people")
    default_script: str = Field(
        description="path, from this file's folder, or the name of a script that is shipped"
    )
    timing: Timing = Field(default_factory=Timing, description="periods and timeouts")
    bus: Bus = Field(default_factory=Bus, description="the CAN bus")
    zenoh: Zenoh = Field(default_factory=Zenoh, description="the operators' network")
    mechanism: Mechanism = Field(description="the arm")
    cameras: tuple[Camera, ...] = Field((), description="cameras, each looking for one tag")
    T_world_crf: Pose = Field(
        default_factory=Pose, description="control reference frame in World, at start"
    )
    frames: Frames = Field(default_factory=Frames, description="frames that may move")
    sources: Sources = Field(default_factory=Sources, description="who may ask for a tool rate")
    schedules: tuple[Schedule, ...] = Field(
        (), max_length=16, description="gains that change with force, distance or time"
    )
    reflection: Reflection | None = Field(
        None, description="force reflection to the operator; absent where there is none"
    )
    limits: Limits = Field(default_factory=Limits, description="bounds of the tool's motion")
    resolve: Resolve = Field(default_factory=Resolve, description="singularities")
    redundancy: Redundancy = Field(default_factory=Redundancy, description="the null space")
    torque: Torque = Field(default_factory=Torque, description="the law of drives in CST")
    obstacles: tuple[Obstacle, ...] = Field(
        (), max_length=64, description="what the arm keeps away from"
    )
    avoidance: Avoidance = Field(default_factory=Avoidance, description="clearances that are kept")
    potential: PotentialField = Field(
        default_factory=PotentialField, description="what repels the links, softly"
    )
    touch: Touch | None = Field(None, description="collision detection; absent: off")
    priority: Priority | None = Field(
        None, description="virtual spheres that obstacles push, before a hand is followed"
    )
    rig: Rig | None = Field(None, description="virtual hardware; absent where it is real")

    @property
    def keeps_clear(self) -> bool:
        """True for a cell that says anything of obstacles or their avoidance."""
        return bool({"avoidance", "obstacles"} & self.model_fields_set)
