"""Where several arms see one payload: the mean of their views, and how each follows it.

Calibration errors let the views drift apart as force control melts what they would press. Each arm
redefines where it has the payload, slowly, towards the mean (Williams 1997, section 3). The mean
stays where it is by that, and relative error is never a position to correct: that would fight
force control.
"""

from collections.abc import Sequence

import numpy as np

from ..spatial import Pose, moved, pose_error, sizes

FOLLOW_TIME_S = 2.0
"""Time constant with which a view follows the mean of all [s]."""

TOLD = (2e-3, 5e-3)
"""An event tells of a view that was redefined by so much [m], [rad]."""


def mean_of(views: Sequence[Pose]) -> Pose:
    """Return the mean of poses that are near each other."""
    first = views[0]
    ways = sum((pose_error(view, first) for view in views[1:]), np.zeros(6))
    return moved(first, ways / len(views))


def follow(T_wrist_payload: Pose, T_world_wrist: Pose, mean: Pose, part: float) -> Pose:
    """Return an arm's view, moved by a part (0 to 1) of the way to the mean of all, in World."""
    target = T_world_wrist.inverse() @ mean
    if part >= 1.0:
        return target
    return moved(T_wrist_payload, part * pose_error(target, T_wrist_payload))


def apart(a: Pose, b: Pose) -> tuple[float, float]:
    """Return how far two poses are from each other [m], [rad]."""
    return sizes(pose_error(a, b))
