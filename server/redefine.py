"""What a new MRF or CRF makes of what was ordered before: the same motion of the rigid body."""

from dataclasses import replace
from typing import overload

from ..protocols.moving import FrameRequest
from .control.frames import Array, Pose, rotate_twist, rotation_rpy, wrench_to
from .control.paths.goals import Goal, PathGoal, Route
from .control.tree import Tree


def placed_frame(request: FrameRequest, tree: Tree, parent: str) -> Pose:
    """Return the frame's new pose in `parent`. Raises `UnknownFrame`."""
    there = request.relative_to or ("wrist" if request.frame == "mrf" else "world")
    asked = Pose.from_xyz_rpy(request.xyz, request.rpy)
    if there == parent and not request.origin_only:
        return asked
    T_world_frame = tree.pose(there) @ asked
    if request.origin_only:
        now = tree.pose(request.frame)
        T_world_frame = Pose(now.R @ rotation_rpy(*request.rpy), T_world_frame.p)
    return tree.pose(parent).inverse() @ T_world_frame


@overload
def kept(goal: PathGoal, T_old_new: Pose) -> PathGoal: ...
@overload
def kept(goal: Goal | None, T_old_new: Pose) -> Goal | None: ...


def kept(goal: Goal | None, T_old_new: Pose) -> Goal | None:
    """Return the goal that brings the Wrist where the old one does, for a new MRF.

    The path to it begins anew from where the arm is. None where there is no such goal: twists and
    a master were about the old MRF.
    """
    match goal:
        case PathGoal(T):
            return replace(goal, T_world_target=T @ T_old_new, attempt=goal.attempt + 1)
        case Route(legs):
            new = tuple(kept(leg, T_old_new) for leg in legs)
            return replace(goal, legs=new, attempt=goal.attempt + 1)
    return None


def wrench_kept(wrench: Array, T_old_new: Pose, R_mrf_axes: Array | None) -> Array:
    """Return the wrench (6,) at the new MRF that is the same load as one at the old MRF.

    It is given in the MRF's own axes, old and new, or in axes that `R_mrf_axes` (3, 3) maps to the
    old MRF's.
    """
    T_new_old = T_old_new.inverse()
    if R_mrf_axes is None:
        return wrench_to(T_new_old, wrench)
    at_new = wrench_to(T_new_old, rotate_twist(R_mrf_axes, wrench))
    return rotate_twist(R_mrf_axes.T @ T_old_new.R, at_new)
