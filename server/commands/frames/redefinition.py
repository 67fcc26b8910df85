"""Redefinition of MRF and CRF: their new pose, and a wrench that stays the same load."""

from ....protocols.messages.perception.moving import FrameRequest
from ...control.frame_tree import FrameTree
from ...control.rigid_body import rotate_twist, wrench_to
from ...control.spatial import Array, Pose, rotation_rpy


def placed_frame(request: FrameRequest, tree: FrameTree, parent: str) -> Pose:
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
