"""Telemetry of the daemon: the state of every tick, events, and the description of a cell.

The envelope, units and conventions are those of `messages.py`.
"""

from typing import Literal

from pydantic import Field

from .messages import Count, JointVector, Message, TunnelPiece, Value, Vector3, Vector6


class TaskState(Message):
    """State of one task and its arm, every tick.

    Poses are `[x, y, z, roll, pitch, yaw]` of the MRF in World; `target_mrf` is the pose that the
    position source leads to. `sources` holds each source's twist as it entered the sum, at the MRF
    origin in World axes; `twist` is the sum before limiting. `view` is the tag in the Lens as last
    accepted, and `view_age_ticks` how old that picture is.
    `limits` names what is limiting now. `wrench_sensor` is the sensor's reading, sign turned but
    with weight and bias in it; `payload` the mass [kg] and centre of mass in the Sensor frame [m]
    that are taken off it; `gripper_closed` what the gripper was told, if it was.
    `gains` are those in effect, ramped and as their schedules
    say, `on` the sources' switches. `self_motion` is what the null space was asked to do [rad/s],
    `objectives` each redundancy objective's gain and the size of its part [rad/s]. `potential`
    tells of the field, if anything follows it: its parts [J], and the `slope` that is left of it in
    the self-motions [N·m]; `off_path` is where virtual links have the tool off its path, in World
    [m]. `links` tells how they are set (`axes`, `always`, `stiffness`), None in a cell without any,
    `link_directions` where they point in those axes, and `link_offs` how much of it is on each [m].
    `axes_held` tells how far the task holds each axis of its MRF: 1, and 0 for one that is free.
    `arm_angle` is where the commanded elbow is on its circle about the line from shoulder to wrist
    [rad]: 0 furthest along the first shoulder axis, positive right-handed about the way from
    shoulder to wrist. None for an arm without such an elbow, with the elbow on that line, and with
    the wrist on the first axis; none of a payload in several hands. `arm_angle_target` is where an
    operator leads it to.

    `frames` holds the poses of Base and Carrier, where these may move, as the control has them, and
    `frame_age_ticks` how old the newest news of each is, None when stale; `ground` is what motion
    is relative to. The source `frames` is the twist that moves the MRF along with it.

    `path` tells how far a path is: `leg` of `legs`, counted from 0, the `part` of the leg's time
    that is over, and the `pace`, which a pause takes to 0; `path_mrf` is the pose it has got to.
    `spheres` are the distances of virtual spheres' centres from the nearest obstacle [m], if there
    is any, and `priority` is α, the part of a hand's force that avoiding takes away.
    `master` tells of the clutch: whether it is `engaged`, whether a master's pose is `leading` the
    tool, and the scales of `translation` and `rotation`.
    """

    external_torque: JointVector | None = None
    """Torques of contact that no sensor sees [N·m]; None where it is not watched."""
    pose_mrf: Vector6
    pose_mrf_measured: Vector6
    pose_crf: Vector6
    ground: str = "world"
    frames: dict[str, Vector6] = Field(default_factory=dict)
    frame_age_ticks: dict[str, Count | None] = Field(default_factory=dict)
    target_mrf: Vector6 | None
    wrench_mrf: Vector6 | None
    """What the arm exerts at its MRF; of a task that several hold, what the payload does."""
    wrench_sensor: Vector6 | None = None
    payload: tuple[float, float, float, float] | None = None
    gripper_closed: bool | None = None
    view: Vector6 | None = None
    view_age_ticks: Count | None = None
    view_error: tuple[float, float] | None = None
    """How far the Lens is from the stored view [m], [rad]; of a camera beside the arm, the tag."""
    view_error_px: float | None = None
    """How far corners are from where the stored picture has them [px], rms; None: not in both."""
    view_law: Literal["pose", "image"] | None = None
    """What keeps the view: the tag's pose, or the stored picture; None without a camera."""
    sources: dict[str, Vector6]
    gains: dict[str, Vector6]
    on: dict[str, bool]
    twist: Vector6
    self_motion: JointVector
    objectives: dict[str, tuple[float, float]]
    axes_held: Vector6 = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    arm_angle: float | None = None
    arm_angle_target: float | None = None
    path: dict[str, float] | None
    path_mrf: Vector6 | None
    master: dict[str, float]
    scale: float
    limits: tuple[str, ...]
    held_by: str | None = None
    """The joint task for which the arm holds a payload with others; None for none."""
    internal_force: float | None = None
    """Greatest force at a grasp of that payload that moves nothing [N]; None while not known."""
    internal_moment: float | None = None
    """Greatest such moment [N·m]."""
    shares: dict[str, Vector6] = Field(default_factory=dict)
    """Diagonals of W in effect, of a payload in several hands, by their mechanisms."""
    carried: dict[str, tuple[float, float | None]] = Field(default_factory=dict)
    """Force along the vertical that each of them is to carry and carries [N]."""
    sigma_min: float
    potential: dict[str, float] | None = None
    off_path: Vector3 | None = None
    links: dict[str, Value] | None = None
    link_directions: tuple[Vector3, ...] = ()
    link_offs: tuple[float, ...] = ()
    spheres: dict[str, float] = Field(default_factory=dict)
    priority: float | None = None
    insertion: dict[str, float] | None = None
    """Where an arm in tunnels is: `depth`, the tip's way from the entrance [m], the `speed` that it
    is driven at [m/s], and how many joints are `free` beyond the exit. None off its curve."""
    tunnel: tuple[TunnelPiece, ...] | None = None
    """Pieces of the tunnel that an operator told; None: the cell's is in force."""
    tunnel_open: Count = 0
    """So many of them, the last ones, have no walls."""
    at_goal: bool


class State(TaskState):
    """State of a cell, every tick: its joints, mode and lease, and its tasks.

    What stands here of a task is of the cell's first, or only one; `tasks` has the others by name.
    Joint vectors are of all joints, in the order of the description. `command_age_ticks` is how old
    the snapshot was that the last accepted command was based on. `avoiding` says whether clearances
    are kept, `gaps` the nearest pairs of the commanded arms: link, obstacle or other link, distance
    of their surfaces [m], and whether its barrier acts.
    """

    tick: Count
    time_s: float
    mode: str
    q: JointVector
    q_command: JointVector
    dq_command: JointVector
    tau: JointVector
    following_error: JointVector
    devices: dict[str, dict[str, Value]] = Field(default_factory=dict)
    """Readings of other devices on the bus, by their names."""
    avoiding: bool = False
    gaps: tuple[tuple[str, str, float, bool], ...] = ()
    speed_factor: float
    drives: tuple[str, ...]
    protective_stop: bool
    lease_epoch: Count
    lease_holder: str | None
    last_seq: dict[str, Count]
    command_age_ticks: Count | None
    overruns: Count
    tasks: dict[str, TaskState] = Field(default_factory=dict)

    def of(self, task: str | None) -> TaskState:
        """Return the state of a task by its name; of the first where it is not among `tasks`.

        Without a name it is the one that commands without a name are for: the joint task that the
        first arm holds a payload for, if it does.
        """
        name = self.held_by if task is None else task
        return self if name is None else self.tasks.get(name, self)


class Event(Message):
    """Something that happened, with cause and values. `id` counts every event of a run."""

    id: Count
    tick: Count
    time_s: float
    name: str = Field(max_length=64)
    severity: Literal["info", "warning", "error"]
    detail: str = Field("", max_length=1000)
    values: dict[str, Value] = Field(default_factory=dict)


class TaskDescription(Message):
    """Description of a task and its arm, for an operator who is to drive it."""

    task: str
    mechanism: str
    """The arm that the task has."""
    joints: tuple[str, ...]
    postures: dict[str, JointVector]
    sources: tuple[str, ...]
    gains: dict[str, Vector6]
    lower: JointVector
    upper: JointVector
    max_velocity: JointVector
    slides: tuple[bool, ...] = ()
    """Which joints slide, in metres; of an arm without one that does, none."""
    insertion: dict[str, float] | None = None
    """Of an arm in tunnels: its greatest `speed` [m/s] and greatest `depth` [m]."""
    base: dict[str, float] | None = None
    """Of a base on wheels: its greatest `speed` [m/s] and `angular_speed` [rad/s]; of a gantry, of
    its second axis [m/s]."""
    self_motion: dict[str, float] | None = None
    """Greatest rate of its spare joints by hand: of its `arm_angle` [rad/s], or a `share` of their
    quickest [1]. None for an arm that has no spare joint while its task holds all axes."""


class Description(TaskDescription):
    """Description of a cell, for an operator who is to drive it.

    What stands here of a task is of the cell's first, or only one; `tasks` has the others.
    """

    cell: str
    description: str
    network: Literal["local", "certified", "insecure"]
    """Who may speak to the daemon: its machine, who shows a certificate, or anybody."""
    period_s: float
    lease_timeout_s: float
    stream_timeout_s: float
    max_command_age_s: float
    versions: dict[str, str]
    buses: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Devices on each bus, in the order of booting."""
    tasks: tuple[TaskDescription, ...] = ()

    @property
    def each(self) -> tuple[TaskDescription, ...]:
        """All tasks, in the order of the cell's joints."""
        return (self, *self.tasks)

    def of(self, task: str | None) -> TaskDescription:
        """Return the description of a task; of the first for None. Raises `ValueError`."""
        for found in self.each:
            if task in (None, found.task):
                return found
        names = ", ".join(found.task for found in self.each)
        raise ValueError(f"task {task!r}: is none of {names}")


class RecordedTick(Message):
    """One tick as bytes, for a recording that replays: told only while somebody listens.

    `data` is a row of the daemon's flight log; `memory` is there with one tick of a hundred.
    """

    tick: Count
    stamp_ns: Count
    """Time of day [ns since 1970]."""
    data: bytes = Field(max_length=1 << 17)
    memory: bytes = Field(b"", max_length=1 << 20)
