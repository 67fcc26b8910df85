"""A camera's view (Williams 1997, section 2.4): the position law with the Lens for the MRF.

The desired view takes the target pose's part and the seen target the CRF's: the pose error by
translation and rotation logarithm, times K_V, is the rate of the Lens; the rigid body between
makes it the MRF's. A camera that is carried moves its Lens to where the target looks as desired;
one that stands beside the arm moves the target, which the arm carries, to where it is desired.

Between two pictures, and for as long as a picture is on its way, the target is taken to stand
where it was last seen in its own frame (World, or the Wrist that carries it), found with the
arm's pose at the picture's own instant. The arm's motion since then is thus no error, and the
loop has no more delay than the position source's, however late pictures come: what is late is
only the news that the target itself has moved.
"""

import math
from dataclasses import dataclass

import numpy as np

from ...compiled import MATRIX, NUMBER, VECTOR, compiled
from ...spatial import Array, Pose, pose_error
from ...stop.trajectory import Motion, VelocityPlanner


@dataclass(frozen=True)
class ViewGoal:
    """Where something that moves with the Wrist is to be, so that the view is the desired one."""

    T_wrist_point: Pose
    """What is to be moved, in the Wrist: a carried Lens, or a carried target."""
    T_world_goal: Pose
    """Where that is to be, in World."""
    R_world_lens: Array | None = None
    """Axes (3, 3) of a Lens that stands in World; None: the moved point is the Lens."""


@dataclass(frozen=True)
class VisionState:
    """The shaped twist of a point of the tool in World axes, as a motion of six freedoms."""

    motion: Motion

    @staticmethod
    def idle() -> "VisionState":
        """Return the state of a source that asks for nothing."""
        return VisionState(Motion(np.zeros(6), np.zeros(6), np.zeros(6)))


class Vision:
    """Keeps a view; `speed` (6,) bounds the Lens, `acceleration`, `jerk` (6,) shape its rate."""

    def __init__(self, speed: Array, acceleration: Array, jerk: Array, period_s: float) -> None:
        self._speed, self._turn = float(speed[0]), float(speed[3])
        self._planner = VelocityPlanner(acceleration, jerk)
        self._period_s = period_s

    def rate(
        self,
        state: VisionState,
        goal: ViewGoal | None,
        T_world_wrist: Pose,
        p_world_tool: Array,
        gain: Array,
        factor: float,
    ) -> tuple[Array, VisionState]:
        """Return the twist (6,) of the tool in World axes that leads to the desired view.

        `gain` (6,) is K_V [1/s] per axis of the Lens, `p_world_tool` (3,) the point of the tool
        whose twist it is, always the same one [m], `factor` scales the speed. Without a goal, or
        with a new one, the rate changes within the acceleration and jerk bounds.
        """
        target = np.zeros(6)
        if goal is not None and np.count_nonzero(gain):
            target = self._asked(goal, T_world_wrist, p_world_tool, gain, factor)
        motion = state.motion
        if motion.stands() and not np.count_nonzero(target):
            return target, state
        shaped = self._planner.step(motion, target, self._period_s, synchronised=True)
        shaped = Motion(np.zeros(6), shaped.dq, shaped.ddq)
        return shaped.dq, VisionState(shaped)

    def _asked(
        self, goal: ViewGoal, T_world_wrist: Pose, p_world_tool: Array, gain: Array, factor: float
    ) -> Array:
        here = T_world_wrist @ goal.T_wrist_point
        axes = here.R if goal.R_world_lens is None else goal.R_world_lens
        speed, turn = factor * self._speed, factor * self._turn
        error = pose_error(goal.T_world_goal, here)
        return _seen(axes, error, gain, speed, turn, p_world_tool, here.p)


@compiled(MATRIX, VECTOR, VECTOR, NUMBER, NUMBER, VECTOR, VECTOR)
def _seen(
    axes: Array, error: Array, gain: Array, speed: float, turn: float, tool: Array, point: Array
) -> Array:
    """Return the rate (6,) of the tool for the pose error (6,) of a point, all in World.

    `gain` (6,) acts per axis of the Lens, whose `axes` (3, 3) are in World. One factor keeps all
    six within `speed` [m/s] and `turn` [rad/s]: the target is to stay in the picture, so the way
    stays straight. `tool` and `point` (3,) are on one rigid body [m].
    """
    asked, out, size2 = np.zeros(6), np.zeros(6), np.zeros(2)
    for i in range(6):
        part = i // 3
        for k in range(3):
            asked[i] += axes[k, i % 3] * error[3 * part + k]
        asked[i] *= gain[i]
        size2[part] += asked[i] ** 2
    most = max(1.0, math.sqrt(size2[0]) / speed, math.sqrt(size2[1]) / turn)
    for i in range(3):
        for k in range(3):
            out[i] += axes[i, k] * asked[k] / most
            out[3 + i] += axes[i, k] * asked[3 + k] / most
    # From the moved point to the tool's (eq. 1).
    x, y, z = tool[0] - point[0], tool[1] - point[1], tool[2] - point[2]
    out[0] += out[4] * z - out[5] * y
    out[1] += out[5] * x - out[3] * z
    out[2] += out[3] * y - out[4] * x
    return out
