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
from typing import Final, NamedTuple

import numpy as np

from .....config.schema.sources.vision import VisionSection
from ...compiled import MATRIX, NUMBER, ROW, VECTOR, compiled
from ...rigid_body import twist_at
from ...spatial import Array, Pose, pose_error
from ...stop.motion import Motion
from ...stop.trajectory import VelocityPlanner
from ..asked import ViewGoal
from ..source import NO_TWIST, Context, Shaping, Source


class VisionState(NamedTuple):
    """The shaped twist of a point of the tool in World axes, as a motion of six freedoms."""

    motion: Motion

    @staticmethod
    def idle() -> "VisionState":
        """Return the state of a source that asks for nothing."""
        return _IDLE


_IDLE: Final = VisionState(Motion(NO_TWIST, NO_TWIST, NO_TWIST))


class Vision(Source[VisionState]):
    """Keeps a view; the Lens is no faster than the section's speeds, and its rate is shaped."""

    def __init__(self, section: VisionSection, shaping: Shaping) -> None:
        self._speed, self._turn = section.speed, section.angular_speed
        self._planner = VelocityPlanner(shaping.acceleration, shaping.jerk)
        self._period_s = shaping.period_s

    def idle(self) -> VisionState:
        """Return the state of a source that asks for nothing."""
        return _IDLE

    def rate(self, context: Context, state: VisionState, gain: Array) -> tuple[Array, VisionState]:
        """Return the twist that leads to the desired view.

        `gain` (6,) is K_V [1/s] per axis of the Lens. It is shaped where the MRF was at start,
        always the same point of the tool. Without a goal, or with a new one, the rate changes
        within the acceleration and jerk bounds.
        """
        goal = context.asked.view if context.guided else None
        target = NO_TWIST
        if goal is not None and np.count_nonzero(gain):
            p_world_tool = context.T_world_mrf.p + context.lever
            factor = context.asked.speed_factor
            target = self._asked(goal, context.T_world_wrist, p_world_tool, gain, factor)
        if not context.moving:
            state = _IDLE
        shaped = self._planner.shape(state.motion, target, self._period_s)
        if shaped is state.motion:
            return NO_TWIST, state
        twist = shaped.dq
        if np.count_nonzero(context.lever):
            twist = twist_at(twist, -context.lever)
        return twist, VisionState(shaped)

    def _asked(
        self, goal: ViewGoal, T_world_wrist: Pose, p_world_tool: Array, gain: Array, factor: float
    ) -> Array:
        here = T_world_wrist @ goal.T_wrist_point
        axes = here.R if goal.R_world_lens is None else goal.R_world_lens
        speed, turn = factor * self._speed, factor * self._turn
        error = pose_error(goal.T_world_goal, here)
        out = np.zeros(6)
        _ask(axes, error, gain, speed, turn, p_world_tool, here.p, out)
        return out


@compiled(MATRIX, VECTOR, VECTOR, NUMBER, NUMBER, VECTOR, VECTOR, ROW)
def _ask(
    axes: Array,
    error: Array,
    gain: Array,
    speed: float,
    turn: float,
    tool: Array,
    point: Array,
    out: Array,
) -> None:
    """Write the rate (6,) of the tool for the pose error (6,) of a point, all in World.

    `gain` (6,) acts per axis of the Lens, whose `axes` (3, 3) are in World. One factor keeps all
    six within `speed` [m/s] and `turn` [rad/s]: the target is to stay in the picture, so the way
    stays straight. `tool` and `point` (3,) are on one rigid body [m].
    """
    asked, size2 = np.zeros(6), np.zeros(2)
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
