"""The commands that one tick acts on."""

from typing import NamedTuple

from ..control.mechanism.backbone.insertion import DriveRequest
from ..control.spatial import Array, Pose
from ..control.state import Settings
from ..control.task.asked import StickCommand
from ..control.task.paths.goals import Goal


class InForce(NamedTuple):
    """The commands in force at one instant; see `Inputs` of the tick."""

    settings: Settings
    stick: StickCommand | None
    """None once its news is too old, and while the clutch is disengaged."""
    jog: Array | None
    """Joint rates (n,) [rad/s]; None once their news is too old."""
    goal: Goal | None
    paused: bool
    posture: Array | None
    """Joint angles (n,) to go to [rad]."""
    at_posture: bool
    wrench_desired: Array
    """At the MRF (6,) [N, N·m]."""
    R_world_wrench: Array | None
    """Axes (3, 3) of the desired wrench in World, None for the MRF's."""
    ground: str
    """The frame that motion is relative to."""
    T_wrist_goal: Pose
    """The point of the tool that is led to the goal."""
    drive: DriveRequest
    """How an arm in tunnels is driven."""
