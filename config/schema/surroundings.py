"""Schema of what is around an arm, and what sees it: obstacles, moving frames, cameras, scanner."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from .section import LinkName, Name, PoseSection, Section, Vector3, Vector6

# --- Schema of obstacles, of the promised clearance, and of the arm's shape -----------------------

Shape = Literal["point", "sphere", "capsule", "box", "sight_line"]
Stale = Literal["keep", "grow", "stop"]
Standing = Literal["stand", "self_motion", "step_aside"]
Length = Annotated[float, Field(ge=0, le=10)]
HalfSide = Annotated[float, Field(gt=0, le=20)]

SHORTEST = 1e-4
"""A capsule or a sight line that is shorter has no direction [m]."""
NEEDED: dict[str, tuple[str, ...]] = {
    "point": ("xyz",),
    "sphere": ("xyz", "radius"),
    "capsule": ("xyz", "to", "radius"),
    "box": ("xyz", "half_size"),
    "sight_line": ("to",),
}
"""Fields that each shape needs, beside those with a default."""


class ObstacleSection(Section):
    """Something that the arm keeps away from: what the daemon knows, not what the physics holds.

    One with `max_speed` 0 stands still for ever. One that may move is known by messages on
    `sensor/obstacle`; between two of them it is somewhere within its bounds.
    """

    name: Name = Field(description="name of the obstacle")
    shape: Shape = Field(description="what it is")
    xyz: Vector3 | None = Field(
        None, description="centre; one end of a capsule; start of a sight line, in World [m]"
    )
    to: Vector3 | None = Field(
        None, description="other end of a capsule; target of a sight line, in World [m]"
    )
    camera: Name | None = Field(
        None, description="camera whose Lens a sight line starts from, in place of xyz"
    )
    radius: Length | None = Field(
        None, description="of a sphere, a capsule or a sight line (0 unless given) [m]"
    )
    rpy: Vector3 = Field((0.0, 0.0, 0.0), description="attitude of a box, in World [rad]")
    half_size: tuple[HalfSide, HalfSide, HalfSide] | None = Field(
        None, description="half the sides of a box [m]"
    )
    clearance: Length | None = Field(
        None, description="promised distance of every link from it; none: avoidance.clearance [m]"
    )
    hard: bool | None = Field(
        None, description="keeps a barrier; none: true, but false for a sight line"
    )
    max_speed: float = Field(
        0.0, ge=0, le=10, description="no point of it is ever faster; 0: it stands still [m/s]"
    )
    max_acceleration: float | None = Field(
        None,
        gt=0,
        le=100,
        description="of any of its points; none: unbounded, and its velocity is not believed "
        "[m/s²]",
    )
    timeout_s: float = Field(
        0.25, gt=0, le=60, description="news of one that may move is stale when older than [s]"
    )
    stale: Stale = Field(
        "stop",
        description="then: keep (it has stopped where it may have got to), grow (it goes on "
        "growing by max_speed), or stop (verified stop of the arm)",
    )

    @model_validator(mode="after")
    def _is_whole(self) -> "ObstacleSection":
        missing = [key for key in NEEDED[self.shape] if getattr(self, key) is None]
        if missing:
            raise ValueError(f"a {self.shape} needs {' and '.join(missing)}")
        if self.xyz is not None and self.to is not None and math.dist(self.xyz, self.to) < SHORTEST:
            raise ValueError(f"a {self.shape} from xyz to the same place has no length")
        if self.shape == "sight_line" and (self.xyz is None) == (self.camera is None):
            raise ValueError("a sight_line starts either at xyz or at a camera")
        if self.shape != "sight_line" and self.camera is not None:
            raise ValueError("only a sight_line starts at a camera")
        return self


class LinkCapsuleSection(Section):
    """A part of the arm: all points within `radius` of a segment in a link's frame."""

    link: LinkName = Field(description="link of the URDF that it is fixed to")
    start: Vector3 = Field(description="one end of the segment, in the link [m]")
    end: Vector3 = Field(description="the other end [m]")
    radius: float = Field(gt=0, le=2, description="around the segment [m]")
    holds: tuple[LinkName, ...] = Field(
        (), max_length=64,
        description="other links of the same body whose shapes lie inside this one and others "
        "around that link",
    )  # fmt: skip


class AllowedContactSection(Section):
    """A link and an obstacle, or two links, that may touch: they are not kept apart."""

    link: LinkName = Field(description="link of the arm")
    other: LinkName = Field(description="obstacle, or another link")


class WorkspaceSection(Section):
    """The box, along the axes of World, that the MRF stays in."""

    low: Vector3 = Field(description="least x, y, z [m]")
    high: Vector3 = Field(description="greatest x, y, z [m]")

    @model_validator(mode="after")
    def _is_a_box(self) -> "WorkspaceSection":
        if any(a >= b for a, b in zip(self.low, self.high, strict=True)):
            raise ValueError("every coordinate of 'low' must be below that of 'high'")
        return self


class ToolPlaneSection(Section):
    """A plane of World that the MRF stays above, as a table's or a tilted floor's."""

    point: Vector3 = Field(description="any point of it [m]")
    normal: Vector3 = Field((0.0, 0.0, 1.0), description="which side is above, of any length [1]")

    @model_validator(mode="after")
    def _has_a_side(self) -> "ToolPlaneSection":
        if not any(self.normal):
            raise ValueError("'normal' must not be zero")
        return self


class AvoidanceSection(Section):
    """Clearances that are kept as barriers, and that the verified stop covers."""

    enabled: bool = Field(False, description="switch at start")
    clearance: Length = Field(0.02, description="promised distance of links from obstacles [m]")
    self_clearance: Length = Field(0.01, description="promised distance of links, one another [m]")
    margin: float = Field(
        0.005, ge=0.001, le=0.2, description="barriers stand so much further out [m]"
    )
    near_distance: float = Field(
        0.10, gt=0, le=5, description="the tool is near things from this distance on [m]"
    )
    near_speed: float | None = Field(
        None, gt=0, le=10, description="MRF speed bound at the clearance; none: limits.speed [m/s]"
    )
    standing: Standing = Field(
        "stand",
        description="what an arm that stands does when something comes: stand, self_motion (its "
        "tool stays), or step_aside; it comes back",
    )
    standing_in_hold: bool = Field(False, description="it does so in HOLD, too")
    standing_reach: float = Field(
        0.25,
        gt=0,
        le=2,
        description="no part of it goes further from where it was told to stand [m]",
    )
    workspace: WorkspaceSection | None = Field(
        None, description="where the MRF stays; none: everywhere"
    )
    tool_planes: tuple[ToolPlaneSection, ...] = Field(
        (), max_length=16, description="planes that the MRF stays above, in its stops, too"
    )
    capsules: tuple[LinkCapsuleSection, ...] = Field(
        (), max_length=64, description="shape of links that have none in the URDF, or more of it"
    )
    allowed_contacts: tuple[AllowedContactSection, ...] = Field(
        (), max_length=64, description="who may touch whom"
    )


# --- Schema of frames that move: Base, the Carrier of the CRF, their news -------------------------

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


class MovingFrameSection(Section):
    """A frame whose pose comes in on `sensor/frame`; how far its news is believed."""

    timeout_s: float = Field(
        0.25, gt=0, le=5, description="news older than this is stale: the frame comes to rest [s]"
    )
    smoothing_s: float = Field(
        0.06, gt=0, le=2, description="time constant of the filter over its news [s]"
    )
    least_quality: float = Field(0.3, ge=0, le=1, description="news below is not believed [1]")
    speed: float = Field(0.5, gt=0, le=10, description="faster it is never believed to move [m/s]")
    angular_speed: float = Field(0.5, gt=0, le=10, description="the same [rad/s]")
    acceleration: float = Field(
        1.0, gt=0, le=100, description="with more it is never believed to accelerate [m/s²]"
    )
    angular_acceleration: float = Field(1.0, gt=0, le=100, description="the same [rad/s²]")
    extent: tuple[Positive, Positive] | None = Field(
        None,
        description="further from where the cell has it, it is never believed to be [m], [rad]; "
        "none: anywhere",
    )
    slack: tuple[Positive, Positive] = Field(
        (0.02, 0.05), description="difference of two poses that is still noise [m], [rad]"
    )


class FramesSection(Section):
    """Frames that may move. A frame without its table here stands where the cell has it."""

    base: MovingFrameSection | None = Field(
        None, description="Base moves: the arm is on a platform"
    )
    carrier: MovingFrameSection | None = Field(
        None, description="what the CRF may ride on moves: a conveyor, a workpiece"
    )
    T_world_carrier: PoseSection = Field(
        default_factory=PoseSection, description="Carrier in World, until its first news"
    )
    crf_on: Literal["world", "base", "carrier"] = Field(
        "world", description="what the CRF is fixed to, at start"
    )
    T_ground_crf: PoseSection = Field(
        default_factory=PoseSection,
        description="CRF at start on the Base or Carrier that it is fixed to; in World it is "
        "T_world_crf",
    )
    drive_lag_s: float = Field(
        0.0,
        ge=0,
        le=0.2,
        description="how far the joints are behind their interpolated setpoint: foreseen [s]",
    )

    @property
    def moving(self) -> dict[str, MovingFrameSection]:
        """The frames that have news, by name."""
        both = {"base": self.base, "carrier": self.carrier}
        return {name: frame for name, frame in both.items() if frame is not None}

    @model_validator(mode="after")
    def _ground_is_there(self) -> "FramesSection":
        if self.crf_on == "carrier" and self.carrier is None:
            raise ValueError("crf_on is 'carrier': there is no [frames.carrier]")
        return self


class RigMotionSection(Section):
    """How a thing of the virtual world moves: a constant twist, and a sway about its place."""

    twist: Vector6 = Field((0.0,) * 6, description="constant twist, in World [m/s, rad/s]")
    sway: Vector6 = Field((0.0,) * 6, description="amplitude of a sine about its place [m, rad]")
    period_s: float = Field(4.0, ge=0.2, le=600, description="period of the sway [s]")


class RigFramesSection(Section):
    """Motion in the virtual world, and the news that its sensors give of it."""

    platform_mass: float = Field(
        2000.0, gt=0, le=1e6, description="of a platform that carries the arm [kg]"
    )
    platform: RigMotionSection = Field(
        default_factory=RigMotionSection, description="its motion at start"
    )
    carrier: RigMotionSection = Field(
        default_factory=RigMotionSection, description="the Carrier's, at start"
    )
    acceleration: float = Field(
        0.5, gt=0, le=100, description="with which their twists change [m/s², rad/s²]"
    )
    rate_hz: float = Field(50.0, gt=0, le=1000, description="news per second [1/s]")
    latency_s: float = Field(
        0.04, ge=0, le=1, description="from the measurement until the daemon hears [s]"
    )
    noise: tuple[NonNegative, NonNegative] = Field(
        (2e-4, 3e-4), description="standard deviation of each axis of a pose [m], [rad]"
    )
    twists: bool = Field(False, description="true: the news has the frame's twist, too")
    gyroscope: bool = Field(
        False, description="true: of a base on wheels only the heading is measured, by a gyroscope"
    )
    gyroscope_bias: float = Field(
        0.0, ge=-0.1, le=0.1, description="that its heading drifts by [rad/s]"
    )


# --- Schema of cameras, and of tags in the virtual world ------------------------------------------

TagFamily = Literal["4x4_50", "5x5_50", "6x6_50", "apriltag_36h11"]
Pixels = Annotated[float, Field(gt=0, le=1e5)]


class BoardTagSection(Section):
    """A further tag, fixed to the one that a camera looks for: they are seen as one board."""

    tag: int = Field(ge=0, le=586, description="its id, of the camera's family [1]")
    size: float = Field(gt=0, le=2, description="side of its black square [m]")
    T_board_tag: PoseSection = Field(
        description="where it is, in the axes of the camera's `tag`: x to the right of its "
        "picture, y up, z out of its face"
    )


class CameraSection(Section):
    """A camera that looks for a planar tag, or several on a board; fixed to Wrist, World or Base.

    The Lens frame has its origin in the pinhole, x to the right of the picture, y down, z ahead.
    """

    name: Name = Field(description="name of the camera")
    T_wrist_lens: PoseSection | None = Field(
        None, description="Lens in the Wrist, of a carried camera"
    )
    T_world_lens: PoseSection | None = Field(
        None, description="Lens in World, of one beside the arm"
    )
    T_base_lens: PoseSection | None = Field(
        None, description="Lens in Base, of one that stands beside the arm on what carries both"
    )
    device: str | None = Field(
        None, description="index, path or URL that OpenCV opens; none: rendered by the rig"
    )
    size: tuple[Annotated[int, Field(ge=16, le=8192)], Annotated[int, Field(ge=16, le=8192)]] = (
        Field((640, 480), description="width and height of a picture [px]")
    )
    focal: tuple[Pixels, Pixels] = Field((560.0, 560.0), description="fx, fy [px]")
    principal: tuple[Pixels, Pixels] | None = Field(
        None, description="cx, cy, pixel centres at whole numbers; none: the middle [px]"
    )
    distortion: tuple[float, float, float, float, float] = Field(
        (0.0,) * 5, description="k1, k2, p1, p2, k3 as OpenCV has them [1]"
    )
    rate_hz: float = Field(20.0, gt=0, le=200, description="pictures per second [Hz]")
    latency_s: float = Field(
        0.05,
        ge=0,
        le=1,
        description="from exposure until the daemon hears: simulated for a rendered camera, "
        "taken off the stamp for a real one [s]",
    )
    tag: int = Field(0, ge=0, le=586, description="id of the tag that it looks for [1]")
    tag_size: float = Field(0.1, gt=0, le=2, description="side of the tag's black square [m]")
    family: TagFamily = Field("5x5_50", description="which family of tags it is one of")
    board: tuple[BoardTagSection, ...] = Field(
        (),
        max_length=32,
        description="further tags on what carries it: any of them tells where `tag` is, all of "
        "them better",
    )
    law: Literal["pose", "image"] = Field(
        "pose",
        description="how its stored view is kept: by the pose of the tag, or by where its corners "
        "are in the picture; a request may change it",
    )
    detector: str | None = Field(
        None,
        pattern=r"^[A-Za-z_][\w.]*:[A-Za-z_]\w*$",
        max_length=200,
        description="MODULE:NAME, on Python's path, of what finds corners instead of OpenCV's "
        "detector of tags: the guide of cameras says how it is called",
    )
    video_hz: float = Field(
        20.0,
        ge=1,
        le=60,
        description="pictures per second of its video, which is made while somebody looks at it "
        "large; sightings keep their rate [Hz]",
    )
    video_width: int = Field(
        1280, ge=64, le=1920, description="its video is scaled down to so wide, if wider [px]"
    )
    video_kbit_s: int = Field(
        2000, ge=100, le=8000, description="most of its video that is sent [kbit/s]"
    )

    @model_validator(mode="after")
    def _once(self) -> "CameraSection":
        ids = [self.tag, *(other.tag for other in self.board)]
        twice = next((tag for tag in ids if ids.count(tag) > 1), None)
        if twice is not None:
            raise ValueError(f"board: tag {twice} is there twice: nobody could say which is seen")
        return self

    @model_validator(mode="after")
    def _one_place(self) -> "CameraSection":
        places = (self.T_wrist_lens, self.T_world_lens, self.T_base_lens)
        if sum(place is not None for place in places) != 1:
            raise ValueError("give one of T_wrist_lens, T_world_lens, T_base_lens")
        return self

    @property
    def on(self) -> Literal["wrist", "world", "base"]:
        """The frame that it is fixed to."""
        if self.T_wrist_lens is not None:
            return "wrist"
        return "base" if self.T_world_lens is None else "world"

    @property
    def place(self) -> PoseSection:
        """The Lens in that frame."""
        return self.T_wrist_lens or self.T_world_lens or self.T_base_lens or PoseSection()

    @property
    def tags(self) -> tuple[BoardTagSection, ...]:
        """All tags of its board, `tag` first."""
        own = BoardTagSection(tag=self.tag, size=self.tag_size, T_board_tag=PoseSection())
        return (own, *self.board)

    @property
    def centre(self) -> tuple[float, float]:
        """The principal point [px]."""
        if self.principal is not None:
            return self.principal
        return (self.size[0] / 2 - 0.5, self.size[1] / 2 - 0.5)


class RigTagSection(Section):
    """A planar tag of the virtual world: x to the right of its picture, y up, z out of its face."""

    name: Name = Field(description="name that faults use")
    T_world_tag: PoseSection | None = Field(
        None, description="its pose in World, if it stands there"
    )
    T_wrist_tag: PoseSection | None = Field(
        None, description="its pose in the Wrist, if it is carried"
    )
    mechanism: Name | None = Field(
        None, description="whose Wrist carries it; none: the first mechanism's"
    )
    tag: int = Field(0, ge=0, le=586, description="its id [1]")
    size: float = Field(0.1, gt=0, le=2, description="side of the black square [m]")
    family: TagFamily = Field("5x5_50", description="family of tags")
    colour: Vector3 = Field((0.85, 0.85, 0.85), description="of the panel behind it, RGB [1]")

    @model_validator(mode="after")
    def _one_place(self) -> "RigTagSection":
        if (self.T_world_tag is None) == (self.T_wrist_tag is None):
            raise ValueError("give either T_world_tag or T_wrist_tag")
        if self.mechanism is not None and self.T_wrist_tag is None:
            raise ValueError("mechanism: nobody carries a tag with T_world_tag")
        return self


# --- Schema of the laser scanner, of the contour ahead of the arm, and of the arm's reflex to it

MOST_CELLS = 1600
"""Cells of a contour [1]."""


class ScannerSection(Section):
    """A SICK LMS1xx that tells distances over TCP (CoLa-A), mostly on an axis that sweeps."""

    address: str = Field(
        "tcp/127.0.0.1:2111",
        pattern=r"^tcp/[A-Za-z0-9.\-]{1,253}:[0-9]{1,5}$",
        description="where it listens; the virtual one listens there, too",
    )
    link: LinkName = Field(description="link of the URDF that it is fixed to")
    T_link_scanner: PoseSection = Field(
        default_factory=PoseSection,
        description="its mirror in that link: x straight ahead, z the axis",
    )
    first: float = Field(
        -0.25 * math.pi, ge=-math.pi, le=math.pi,
        description="angle of the first ray, from its right; π/2 is straight ahead [rad]",
    )  # fmt: skip
    step: float = Field(
        math.radians(0.5), ge=math.radians(0.1), le=math.radians(1.0),
        description="angle from ray to ray [rad]",
    )  # fmt: skip
    rays: int = Field(541, ge=2, le=1082, description="rays of a scan [1]")
    rate_hz: float = Field(50.0, ge=5, le=100, description="scans in a second [Hz]")
    silent_s: float = Field(
        0.2, gt=0, le=2,
        description="a base stops when the newest scan is older; it brakes for that in time [s]",
    )  # fmt: skip
    late_s: float = Field(
        0.0, ge=-0.1, le=0.1, description="its rays are older than its clock tells [s]"
    )
    self_margin: float = Field(
        0.04, ge=0.005, le=0.3, description="what is nearer to a capsule of the arm is the arm [m]"
    )


class PlaneSection(Section):
    """The cells of the contour, parallel to y and z of Base, from the arm's foot upwards."""

    ahead: float = Field(2.0, gt=0.2, le=10, description="what is nearer is acted upon [m]")
    collect: float = Field(3.0, gt=0.2, le=15, description="what is nearer is told [m]")
    width: float = Field(2.0, ge=0.2, le=10, description="half of it on either side [m]")
    height: float = Field(1.0, ge=0.2, le=5, description="from the foot upwards [m]")
    cell: float = Field(0.05, ge=0.02, le=0.5, description="side of a cell [m]")

    @model_validator(mode="after")
    def _collects_first(self) -> "PlaneSection":
        if self.collect < self.ahead:
            raise ValueError(f"collect {self.collect:g} must be at least ahead {self.ahead:g}")
        if (self.width / self.cell) * (self.height / self.cell) > MOST_CELLS:
            raise ValueError(f"at most {MOST_CELLS} cells")
        return self


class ContourReflexSection(Section):
    """The nearest obstacles ahead of the arm, and how the arm folds itself to pass them."""

    plane: PlaneSection = Field(
        default_factory=PlaneSection, description="where it is, and its cells"
    )
    foot: Vector3 = Field((0.0, 0.0, 0.0), description="foot of the arm in Base [m]")
    shoulder: Name = Field(description="joint at whose origin the shoulder is")
    elbow: Name = Field(description="joint at whose origin the elbow is")
    base_width: float = Field(
        0.0, ge=0, le=5, description="of what carries the arm, and has to pass, too [m]"
    )
    base_rear: float = Field(
        0.0, ge=0, le=5, description="how far that reaches behind Base's origin [m]"
    )
    creep: float = Field(
        0.05,
        ge=0,
        le=1,
        description="back over ground that nobody saw, the base goes at most [m/s]",
    )
    link_radius: float = Field(0.06, ge=0.005, le=0.5, description="of the arm's housings [m]")
    rule: Literal["posture", "sequence"] = Field(
        "posture",
        description="a search of a whole posture, or F1 (tool), F2 (elbow), F3 (both) in order",
    )
    wait: bool = Field(True, description="the base slows down and waits until the arm is through")
    steer: float = Field(
        0.0,
        ge=0,
        le=2,
        description="a base that is driven straight ahead steers aside of what it would meet, on "
        "arcs of at most this curvature, and then back to its heading; 0: it stops [1/m]",
    )
    speed: float = Field(0.3, gt=0, le=2, description="the tool folds at most so quickly [m/s]")
