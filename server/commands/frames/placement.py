"""Goals from commanded targets and paths: waypoints placed in World, twists in its axes."""

from collections.abc import Callable

import numpy as np

from ....protocols.messages.messages import Attitude, Frame, Place
from ....protocols.messages.motion import PathMotion
from ...control.rigid_body import rotate_twist
from ...control.spatial import Pose, rotation_rpy
from ...control.task.paths.goals import PathGoal, Route, TwistRoute, TwistSegment

PoseOf = Callable[[Frame], Pose]
"""Where a frame is in World, now."""


def placed(
    xyz: Place, rpy: Attitude, relative_to: Frame, expressed_in: Frame | None, pose_of: PoseOf
) -> Pose:
    """Return a target in World, given as commands give them: see `PositionTarget`."""
    axes, origin = pose_of(expressed_in or relative_to), pose_of(relative_to)
    turn = axes.R @ rotation_rpy(*rpy) @ axes.R.T
    return Pose(turn @ origin.R, origin.p + axes.R @ np.array(xyz))


def path_goal(message: PathMotion, serial: int, pose_of: PoseOf) -> Route | TwistRoute:
    """Return the goal that a path means."""
    if message.waypoints:
        speeds = message.speeds or (None,) * len(message.waypoints)
        legs = (
            PathGoal(
                placed(w[:3], w[3:], message.relative_to, message.expressed_in, pose_of),
                serial,
                speed,
            )
            for w, speed in zip(message.waypoints, speeds, strict=True)
        )
        return Route(tuple(legs), serial, message.blend)
    frame = message.expressed_in or message.relative_to
    moving = frame is Frame.MRF
    R = np.eye(3) if moving else pose_of(frame).R
    segments = (
        TwistSegment(rotate_twist(R, np.array(twist)), duration_s)
        for twist, duration_s in zip(message.twists, message.durations_s, strict=True)
    )
    return TwistRoute(tuple(segments), serial, moving)
