"""What arms on one payload remember, and where each of them sees it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from .spatial import Array, Pose, moved, pose_error, sizes
from .task.sources import ForceState
from .task.task import TaskMemory


class Weighed(NamedTuple):
    """Memory of what the grasps carry beyond the payload that was told."""

    load: Array = np.zeros(4)
    """Mass [kg] and its first moment in the payload's frame [kg·m] that count as the payload's."""
    waits: Array = np.zeros(4)
    """The same of what is not given way to before it was judged once."""
    judged: bool = False
    """It was, since the drives are on, or other sources asked for motion."""
    sum: Array | None = None
    """What is carried beyond that, smoothed (4,) [N, N·m]; None while it is not judged."""
    mark: Array | None = None
    """The same when the comparison began."""
    began: Pose | None = None
    """Where the MRF was then, in World."""
    way: Array = np.zeros(4)
    """What force control has asked for since: up, and about x, y, z [m, rad]."""
    time_s: float = 0.0
    """So long it has lasted [s]."""
    asked: bool = False
    """Other sources asked for motion."""
    aside: Array = np.zeros(3)
    """Horizontal force and moment about the vertical of no contact, exerted at the payload's frame
    in World axes (3,) [N, N·m]."""
    felt: Array | None = None
    """The same beyond that, its mean since it leads the payload; None while it does not."""
    led_from: Pose | None = None
    """Where the payload was then, in World."""
    led_s: float = 0.0
    """So long it does [s]."""


@dataclass(frozen=True)
class GraspState:
    """Memory of one arm of the payload that it holds with others.

    The payload's frame is where the shared MRF was at start.
    """

    task: str
    """Name of the joint task."""
    T_wrist_payload: Pose
    """Where this arm sees the payload; follows the mean of all views slowly."""
    told: Pose
    """The same when an event last told of it."""
    force: ForceState = field(default_factory=ForceState)
    """Internal force being bled off in HOLD."""
    shared: TaskMemory | None = None
    """Memory of the joint task's sources; of its first arm only."""
    redefined: int = 0
    """How often views had drifted so far apart that it was told."""
    weighed: Weighed = field(default_factory=Weighed)
    """What the grasps carry that nobody told of; the same in all arms of the task."""
    weights: Array = field(default_factory=lambda: np.zeros(6))
    """Its diagonal of W in effect (6,), on its way to what was told [1]; 0 before any was."""
    light_s: float = 0.0
    """So long has this arm carried next to nothing, while the others carry its part [s]."""


class GraspStatus(NamedTuple):
    """Telemetry of one arm about the payload that it holds with others."""

    task: str
    """Name of the joint task."""
    internal_force: float | None
    """Greatest force at any grasp that moves nothing [N]; None without all wrenches."""
    internal_moment: float | None
    """The same of a moment [N·m]."""
    strained: str | None
    """`internal_force` or `internal_moment`, where that is beyond its bound: the arms stop."""
    slipped: bool
    """The payload slipped out of this arm's grasp: the arms stop."""
    load: Array
    """Mass [kg] and first moment in the payload's frame [kg·m] beyond what was told (4,)."""
    aside: Array
    """Horizontal force [N] and moment about the vertical [N·m] of no contact (3,)."""
    weights: Array
    """Diagonal of W in effect (6,) [1]."""
    share: float
    """Force that the arm is to carry along the vertical [N]."""
    carried: float | None
    """Force that it carries along the vertical [N]; None while its sensor tells nothing."""
    apart: float
    """How far this arm's view of the payload is from the mean of all [m]."""
    redefined: int
    """How often views had drifted so far apart that it was told."""


# --- Where several arms see one payload: the mean of their views, and how each follows it ---------
#
# Calibration errors let the views drift apart as force control melts what they would press. Each
# arm redefines where it has the payload, slowly, towards the mean (Williams 1997, section 3). The
# mean stays where it is by that, and relative error is never a position to correct: that would
# fight force control.

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
