"""Messages of cameras, scanners and trackers: pictures, sightings, frames, obstacles, contours."""

from typing import Annotated, Final, Literal, Self

from pydantic import Field, field_validator, model_validator

from .messages import (
    Angle,
    Attitude,
    Command,
    Count,
    Frame,
    Identifier,
    Message,
    Metres,
    Place,
    Speed,
    TaskCommand,
    Twist,
)

# --- Contour message: obstacles ahead of the arm, from the scanner's process to the daemon --------

NOTHING: Final = 0xFFFF
"""Nothing is in a cell: no distance, and not 0 either."""


Slid = Annotated[float, Field(ge=-10, le=10)]


class ContourNews(Message):
    """The contour ahead of the arm, and the reflex to it; news of a sensor, not an order.

    `tick` is the telemetry tick in which the newest scan ended. `rows` times `columns` cells of
    `cell` [m] side by side, right to left, from the foot upwards, each two bytes, the lower one
    first: how far ahead of the foot the nearest obstacle is [mm], 65535 for nothing (Zhang et al.
    2013, eq. 11).

    `posture` is the arm's joints [rad] that it should take to pass, without wheels and scanner,
    none where it may stay as it is; `most_speed` [m/s] bounds how fast the base may drive ahead,
    none: as it likes; `most_speed_back` the same back over ground that was seen. `phase` is that of
    the passage, `reason` why there is no way. A base that is driven straight ahead should take an
    arc of a `curvature` [1/m], to the left if positive.

    `slipping`: the wheels roll, and the base does not come as far, by what the scans see. `slide`
    is the motion of Base, in its own frame, that its odometry missed since it was last told: x and
    y [m], yaw [rad].
    """

    tick: Count
    rows: int = Field(ge=1, le=250)
    columns: int = Field(ge=1, le=500)
    cell: float = Field(gt=0, le=1)
    nearest_mm: bytes = Field(max_length=3200)
    phase: Literal["clear", "undecided", "folding", "folded", "returning", "refused"]
    reason: Annotated[str, Field(max_length=64, pattern=r"^[a-z0-9_]*$")] = ""
    posture: tuple[Angle, ...] | None = Field(None, max_length=64)
    most_speed: float | None = Field(None, ge=0, le=100)
    most_speed_back: float = Field(0.0, ge=0, le=100)
    curvature: float = Field(0.0, ge=-100, le=100)
    slipping: bool = False
    slide: tuple[Slid, Slid, Angle] | None = None

    @model_validator(mode="after")
    def _is_whole(self) -> "ContourNews":
        if len(self.nearest_mm) != 2 * self.rows * self.columns:
            raise ValueError(
                f"nearest_mm has {len(self.nearest_mm)} bytes: must be 2 for each of "
                f"{self.rows} times {self.columns} cells"
            )
        return self


MOST_RAYS: Final = 1082
"""Rays of a scan at most [1]."""


class ScanPoints(Message):
    """Points of one laser scan, for people's eyes and for records: the daemon does not read it.

    `points_mm` has x, y, z of each ray with an echo, the arm's own bridged, by the odometry in
    World [mm], each four bytes, signed, the lowest first. `tick` is the telemetry tick in which
    the scan ended, or the newest before.
    """

    tick: Count
    points_mm: bytes = Field(max_length=12 * MOST_RAYS)

    @field_validator("points_mm")
    @classmethod
    def _are_points(cls, value: bytes) -> bytes:
        if len(value) % 12:
            raise ValueError(f"points_mm has {len(value)} bytes: must be 12 for each point")
        return value


# --- Messages about frames that move, and about frames that are redefined -------------------------
#
# The envelope, units and conventions are those of `messages.py`.


class FrameNews(Message):
    """Where a frame was; a sensor's reading, not an order.

    `tick` is the telemetry tick in which it was measured. `xyz` [m] and `rpy` [rad] are its pose in
    `seen_from`, `twist` [m/s, rad/s] its twist seen from there, at its origin, in that frame's
    axes, where it is measured; else it is found from the poses. `quality` is from 0 to 1. What is
    faster, accelerates more or is further away than the cell says is not believed. Of several
    mechanisms the Base is that of `mechanism`, as `name` and in `seen_from`.
    """

    name: Literal["base", "carrier"]
    mechanism: Identifier | None = None
    """Whose Base is meant; none: the first's of those whose Base may move."""
    tick: Count
    xyz: Place
    rpy: Attitude
    twist: Twist | None = None
    seen_from: Literal["world", "base"] = "world"
    quality: float = Field(1.0, ge=0, le=1)
    heading: bool = False
    """Only the yaw of `rpy` was measured, as by a gyroscope on a base with wheels."""

    @model_validator(mode="after")
    def _not_from_itself(self) -> "FrameNews":
        if self.name == self.seen_from:
            raise ValueError("base is not seen from base")
        return self


class FrameRequest(TaskCommand):
    """Redefines the MRF or the CRF; nothing moves because of it.

    `xyz` [m] and `rpy` [rad] are its pose in `relative_to`, as that frame is now: by default the
    Wrist for the MRF, World for the CRF. So *here* is a pose of zero: the CRF relative to "mrf" is
    put where the tool is, the MRF relative to "crf" where the CRF is. With `origin_only` the frame
    keeps its axes, and what changes is the point that rotations turn about.

    The CRF then moves with `moves_with`; what is not given stays. A goal stays on what it was
    measured against, and goes on leading the point of the tool that was the MRF then; a master
    leads the new one. A desired wrench stays the same load.
    """

    frame: Literal["mrf", "crf"]
    xyz: Place = (0.0, 0.0, 0.0)
    rpy: Attitude = (0.0, 0.0, 0.0)
    relative_to: Frame | None = None
    origin_only: bool = False
    moves_with: Literal["world", "base", "carrier"] | None = None

    @model_validator(mode="after")
    def _fits(self) -> "FrameRequest":
        if self.frame == "mrf" and self.moves_with is not None:
            raise ValueError("the MRF moves with the Wrist")
        return self


class RigMotion(Message):
    """Tells the rig how the platform under the arm, or the Carrier, moves from now on.

    `twist` [m/s, rad/s] is constant, `sway` [m, rad] the amplitude of a sine about its place, both
    in World. They are taken up and laid down smoothly.
    """

    target: Literal["platform", "carrier"]
    twist: Twist = (0.0,) * 6
    sway: Twist = (0.0,) * 6
    period_s: float = Field(4.0, ge=0.2, le=600)


# --- Messages that tell the daemon of obstacles, and switch their avoidance -----------------------

ObstacleName = Annotated[str, Field(max_length=32, pattern=r"^[a-z][a-z0-9_]{0,31}$")]
Length = Annotated[float, Field(ge=0, le=10)]
HalfSide = Annotated[float, Field(gt=0, le=20)]

NEEDED: dict[str, tuple[str, ...]] = {
    "point": ("xyz",),
    "sphere": ("xyz", "radius"),
    "capsule": ("xyz", "to", "radius"),
    "box": ("xyz", "half_size"),
    "sight_line": ("xyz", "to"),
}
"""Fields that a new obstacle of each shape needs, beside those with a default."""


class ObstacleNews(Message):
    """Sets, moves or removes one obstacle; news of a sensor, not an order.

    `tick` is the telemetry tick in which it was seen: the daemon counts its age from there. With
    `shape` the obstacle is new, or replaced as a whole; without, it is known by its `name`, and
    what is not given stays as it was. `xyz` [m] is its centre, one end of a capsule or the start of
    a sight line, `to` the other end or the target, `rpy` [rad] and `half_size` [m] are a box's; all
    in World. Removing needs nothing else.

    `velocity` [m/s] is believed only together with a `max_acceleration` [m/s²]. No point of the
    obstacle is ever faster than `max_speed` [m/s]; with 0 it stands still for ever, and its news
    never age. When the newest is older than `timeout_s`, `stale` says what holds: keep (it has
    stopped where it may have got to), grow (it goes on growing), stop (verified stop of the arm).
    """

    name: ObstacleName
    tick: Count
    remove: bool = False
    shape: Literal["point", "sphere", "capsule", "box", "sight_line"] | None = None
    xyz: Place | None = None
    to: Place | None = None
    rpy: Attitude | None = None
    half_size: tuple[HalfSide, HalfSide, HalfSide] | None = None
    radius: Length | None = None
    velocity: tuple[Speed, Speed, Speed] | None = None
    max_speed: float | None = Field(None, ge=0, le=10)
    max_acceleration: float | None = Field(None, gt=0, le=100)
    timeout_s: float | None = Field(None, gt=0, le=60)
    stale: Literal["keep", "grow", "stop"] | None = None
    clearance: Length | None = None
    hard: bool | None = None

    @model_validator(mode="after")
    def _is_whole(self) -> "ObstacleNews":
        missing = [key for key in NEEDED.get(self.shape or "", ()) if getattr(self, key) is None]
        if missing:
            raise ValueError(f"a new {self.shape} needs {' and '.join(missing)}")
        if self.remove and (self.shape is not None or self.xyz is not None):
            raise ValueError("give either remove or a place")
        return self


class AvoidanceRequest(Command):
    """Switches the barriers of clearances on or off; bumpless."""

    on: bool


# --- Messages of a camera's process, and an operator's requests about views -----------------------

CameraName = Annotated[str, Field(min_length=1, max_length=32)]
PoseVector = tuple[Metres, Metres, Metres, Angle, Angle, Angle]
Pixels = Annotated[float, Field(ge=0, le=1e4)]
Coordinate = Annotated[float, Field(ge=-10, le=10)]
Corners = tuple[
    Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate, Coordinate
]
"""x, y of four corners in turn: normalised image coordinates, x / z and y / z in the Lens [1]."""

MOST_TAGS: Final = 33
"""Tags of a board at most [1]."""


class Sighting(Message):
    """A camera's view of a tag in one picture; a sensor's reading, not an order.

    `tick` is the telemetry tick in which the picture was exposed. `poses` are the one or two poses
    `[x, y, z, roll, pitch, yaw]` [m, rad] of the tag in the Lens that explain its corners, the
    better one first, `errors_px` their reprojection errors; none where the tag is not to be seen.
    `seen` has each tag of the board that is seen: its id, and its corners without distortion,
    clockwise from the upper left; a view is kept by its picture only where they are told.
    `quality` is from 0 to 1.
    """

    camera: CameraName
    tick: Count
    poses: tuple[PoseVector, ...] = Field((), max_length=2)
    errors_px: tuple[Pixels, ...] = Field((), max_length=2)
    seen: tuple[tuple[Count, Corners], ...] = Field((), max_length=MOST_TAGS)
    quality: float = Field(0.0, ge=0, le=1)

    @model_validator(mode="after")
    def _an_error_each(self) -> "Sighting":
        if len(self.poses) != len(self.errors_px):
            raise ValueError("give one error for each pose")
        return self


class StoreView(TaskCommand):
    """Makes what a camera sees now the view that the vision source keeps.

    Without a camera's name: of the camera whose view is kept now. `again`: the view that was stored
    for that camera before, or told by the cell, is kept in place of what it sees now. `law` says
    how that camera's view is kept from now on, by pose or by image; none: as before.
    """

    camera: CameraName | None = None
    again: bool = False
    law: Literal["pose", "image"] | None = None


# --- Messages of a camera's process for people: one small picture, and a piece of its video -------

LARGEST_JPEG = 7600
"""With it a message still arrives whole in one batch of a session [B]."""

MOST_PIECES = 16
"""Pieces of one frame; all batches that a router keeps for a link that is slow [1]."""

LARGEST_FRAME = MOST_PIECES * LARGEST_JPEG
"""Longest frame of a video [B]."""


class CameraPicture(Message):
    """A camera's picture as JPEG, small enough to look at beside everything else.

    `tick` is the telemetry tick in which it was exposed.
    """

    camera: CameraName
    tick: Count
    jpeg: bytes = Field(min_length=1, max_length=LARGEST_JPEG)


class VideoPiece(Message):
    """A piece of one frame of a camera's video: an access unit of H.264 with start codes (Annex B).

    `tick` is the telemetry tick in which it was exposed, `frame` counts the frames. The frame is
    piece 0 to `pieces` - 1, one after the other. Each frame but a key frame needs the one before
    it; a key frame begins with its parameter sets, and comes at least once a second.
    """

    camera: CameraName
    tick: Count
    frame: Count
    key: bool
    piece: int = Field(ge=0, lt=MOST_PIECES)
    pieces: int = Field(ge=1, le=MOST_PIECES)
    data: bytes = Field(min_length=1, max_length=LARGEST_JPEG)

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if self.piece >= self.pieces:
            raise ValueError(f"piece {self.piece} of {self.pieces}")
        return self
