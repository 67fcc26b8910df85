"""Messages that lead a motion: paths, the master's pose, clutch and scale, the null space.

The envelope, units and conventions are those of `messages.py`.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .messages import Angle, Attitude, Frame, Identifier, Joules, Metres, Place, TaskCommand, Twist

MOST = 64
"""Most waypoints or segments of one path [1]."""

Waypoint = tuple[Metres, Metres, Metres, Angle, Angle, Angle]
PathSpeed = Annotated[float, Field(ge=1e-4, le=10)]
Duration = Annotated[float, Field(gt=0, le=600)]


class RedundancyRequest(TaskCommand):
    """Sets the gain of one redundancy objective, 0 for off; the change is ramped.

    `objective` is its name in the cell file, and the bounds there hold here. For `posture`, a name
    from the cell may say which posture to pull to.
    """

    objective: Identifier
    gain: float = Field(ge=0, le=10)
    posture: str | None = Field(None, max_length=32)

    @model_validator(mode="after")
    def _fits(self) -> "RedundancyRequest":
        if self.posture is not None and self.objective != "posture":
            raise ValueError("a posture is for the objective posture")
        return self


def complaint_of_path(waypoints: int, speeds: int, twists: int, durations: int) -> str:
    """Return what is wrong with so many of each in one path, or nothing."""
    if bool(waypoints) == bool(twists):
        return "give either waypoints or twists"
    if max(waypoints, twists) > MOST:
        return f"at most {MOST} waypoints or twists"
    if speeds and speeds != waypoints:
        return f"{speeds} speeds for {waypoints} waypoints"
    if durations != twists:
        return f"{durations} durations for {twists} twists"
    return ""


class PathMotion(TaskCommand):
    """A planned motion of the MRF, a goal: waypoints, or timed twists; not both.

    `waypoints` are poses `[x, y, z, roll, pitch, yaw]` [m, rad] in `relative_to` and
    `expressed_in`, read as a position target's are; all of them are placed when the command
    arrives. The way between them is straight, at `speeds` [m/s], one for each, or the cell's. With
    `blend` 0 the tool stops at each; else it turns to the next one within `blend` metres of it, and
    stops at the last.

    `twists` [m/s, rad/s] follow each other for `durations_s` each, in the axes of `expressed_in`
    (by default `relative_to`); with "mrf", in the axes of the moving tool. Between them, and at the
    end, acceleration and jerk are the cell's.
    """

    waypoints: Annotated[tuple[Waypoint, ...], Field(max_length=MOST)] = ()
    speeds: Annotated[tuple[PathSpeed, ...], Field(max_length=MOST)] = ()
    blend: float = Field(0.0, ge=0, le=1)
    twists: Annotated[tuple[Twist, ...], Field(max_length=MOST)] = ()
    durations_s: Annotated[tuple[Duration, ...], Field(max_length=MOST)] = ()
    relative_to: Frame = Frame.CRF
    expressed_in: Frame | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> "PathMotion":
        complaint = complaint_of_path(
            len(self.waypoints), len(self.speeds), len(self.twists), len(self.durations_s)
        )
        if complaint:
            raise ValueError(complaint)
        return self


class PathRequest(TaskCommand):
    """Pauses the path under way, resumes it, or aborts it; the tool comes to rest smoothly.

    While it is paused, position control holds the tool where the path stands: a stick shifts it
    aside, and on release it returns. An aborted path is gone, and the tool stays where it came to.
    """

    action: Literal["pause", "resume", "abort"]


class MasterPose(TaskCommand):
    """Pose of the operator's master device, a stream: its *motion* moves the MRF.

    `xyz` [m] and `rpy` [rad] are the handle's pose in the device's own base, whose axes are laid
    along those of `expressed_in`. What moves the tool are the increments from one message to the
    next while the clutch is engaged, scaled; so where the device is when it is engaged does not
    matter, and neither engaging nor a change of scale makes the tool jump. `handle` is as that of
    a stick: by it the arm's side knows what energy it may take out of the network.
    """

    xyz: Place
    rpy: Attitude
    expressed_in: Frame = Frame.CRF
    handle: tuple[Joules, Joules, Joules] | None = None


class ClutchRequest(TaskCommand):
    """Engages or disengages the master, stick and pose alike, and scales its motion.

    What is not given stays. A stick that is disengaged asks for nothing; a master pose that is
    disengaged may be moved freely, and the tool stands. The pose mode begins with a request to
    engage, after each enable and after each other goal.
    """

    engaged: bool | None = None
    translation: float | None = Field(None, ge=0, le=10)
    """Scale of translations [1]."""
    rotation: float | None = Field(None, ge=0, le=10)
    """Scale of rotations [1]."""
