"""Requests of operators and devices to one task in one tick."""

from dataclasses import dataclass
from typing import NamedTuple

from ..spatial import Array, Pose
from .paths.goals import Goal


@dataclass(frozen=True)
class StickCommand:
    """A stick twist u (6,) in the axes that `R_world_axes` (3, 3) maps to World."""

    twist: Array
    R_world_axes: Array


@dataclass(frozen=True)
class ViewGoal:
    """Where something that moves with the Wrist is to be, so that the view is the desired one."""

    T_wrist_point: Pose
    """Pose in the Wrist of the thing that is to be moved: a carried Lens, or a carried target."""
    T_world_goal: Pose
    """Where that is to be, in World."""
    R_world_lens: Array | None = None
    """Axes (3, 3) of a Lens that stands in World; None: the moved point is the Lens."""


class Asked(NamedTuple):
    """The streams, goals and frames of one task."""

    T_wrist_mrf: Pose
    T_world_crf: Pose
    redefined: int
    """How often MRF or CRF were redefined."""
    ground: str
    """The frame that motion is relative to."""
    speed_factor: float
    stick: StickCommand | None
    goal: Goal | None
    """Where the position source leads to; None while a posture is gone to."""
    T_wrist_goal: Pose
    """The point of the tool that is led to the goal."""
    paused: bool
    """The path to the goal stands still; position control goes on."""
    view: ViewGoal | None
    wrench_desired: Array
    """Wrench to exert, at the MRF (6,) [N, N·m]."""
    R_world_wrench: Array | None
    """Axes (3, 3) of that wrench; None: the MRF's."""
