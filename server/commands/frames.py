"""The frames of a cell, goals placed in them, and what becomes of both when one is redefined."""

from collections.abc import Callable

import numpy as np

from ...config.schema.mechanism import LONGEST_TOOL, MechanismSection
from ...config.schema.section import PoseSection
from ...config.schema.surroundings import FramesSection
from ...protocols.messages.messages import Attitude, Frame, PathMotion, Place
from ...protocols.messages.perception import FrameRequest
from ..control.inputs import PathGoal, Route, TwistRoute, TwistSegment
from ..control.scene import GROUNDS, Body, FrameTree, Mount, Moved, UnknownFrame
from ..control.spatial import Array, Pose, rotate_twist, rotation_rpy, wrench_to
from ..refusals import Refused, Why

# --- Goals from commanded targets and paths: waypoints placed in World, twists in its axes --------

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


# --- Redefinition of MRF and CRF: their new pose, and a wrench that stays the same load -----------


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


# --- The frames of a cell: the MRF and CRF in force, and where Base and Carrier are ---------------


class FrameSet:
    """The frames of one cell, redefined as operators ask."""

    def __init__(
        self, mechanism: MechanismSection, frames: FramesSection, T_world_crf: PoseSection
    ) -> None:
        place, sensor = mechanism.T_world_base, mechanism.force_torque
        base = Body.standing(Pose.from_xyz_rpy(place.xyz, place.rpy))
        self.moved = Moved(base, Body.standing(Pose.identity()), base.T)
        """Where Base and Carrier are now."""
        mrf = mechanism.T_wrist_mrf
        self.T_wrist_mrf = Pose.from_xyz_rpy(mrf.xyz, mrf.rpy)
        self._tip = self.T_wrist_mrf.p
        on_ground = T_world_crf if frames.crf_on == "world" else frames.T_ground_crf
        self.crf = Mount(frames.crf_on, Pose.from_xyz_rpy(on_ground.xyz, on_ground.rpy))
        self.redefined = 0
        """How often MRF or CRF were redefined."""
        self.lens: Callable[[], Mount | None] = lambda: None
        """Returns the mount of the Lens whose view is kept."""
        carried = ("base",) if mechanism.base_moves else ()
        self.movable = frozenset((*carried, *frames.moving))
        """The frames that may move; none in a cell where all stand."""
        self._T_wrist_sensor = None
        if sensor is not None:
            place = sensor.T_wrist_sensor
            self._T_wrist_sensor = Pose.from_xyz_rpy(place.xyz, place.rpy)

    @property
    def T_world_crf(self) -> Pose:
        """Where the CRF is now."""
        on, T = self.crf
        return T if on == "world" else self.in_world(on, T)

    def in_world(self, ground: str, T: Pose) -> Pose:
        """Return where a pose on a ground is in World now."""
        body = None if ground == "world" else self.moved.body(ground)
        return T if body is None else body.T @ T

    def ground(self, name: str) -> str:
        """Return the ground by that name; World for one that stands."""
        return name if name in self.movable else "world"

    def tree(self, T_world_mrf: Pose) -> FrameTree:
        """Return the tree of all frames, with the MRF at a pose in World."""
        return FrameTree(
            self.moved, T_world_mrf, self.T_wrist_mrf, self.crf, self._T_wrist_sensor, self.lens()
        )

    def axes(self, frame: Frame, T_world_mrf: Callable[[], Pose]) -> Array:
        """Return R_world_frame (3, 3); where the MRF is, is asked for frames of the arm only.

        Raises `UnknownFrame`.
        """
        stands = frame in (*GROUNDS, Frame.CRF)
        return self.tree(Pose.identity() if stands else T_world_mrf()).pose(frame).R

    def redefine(
        self, request: FrameRequest, tree: FrameTree, judge: Callable[[Pose], None]
    ) -> Pose | None:
        """Put a new MRF or CRF in force; return T_old_new of the MRF, None for the CRF.

        `judge` raises for an MRF in the Wrist that may not be. Raises `UnknownFrame` or `Refused`;
        then all is as before.
        """
        T_old_new = None
        if request.frame == "crf":
            on = request.moves_with or self.crf.on
            if on == "carrier" and on not in self.movable:
                raise UnknownFrame("'carrier': there is no [frames.carrier] in this cell")
            self.crf = Mount(on, placed_frame(request, tree, on))
        else:
            T_wrist_mrf = placed_frame(request, tree, "wrist")
            far = float(np.linalg.norm(T_wrist_mrf.p - self._tip))
            if far > LONGEST_TOOL:
                told = f"the MRF {far:.3g} m from that of the cell: no tool reaches farther than "
                raise Refused(Why.OUT_OF_RANGE, f"{told}{LONGEST_TOOL:g} m")
            judge(T_wrist_mrf)
            T_old_new = self.T_wrist_mrf.inverse() @ T_wrist_mrf
            self.T_wrist_mrf = T_wrist_mrf
        self.redefined += 1
        return T_old_new
