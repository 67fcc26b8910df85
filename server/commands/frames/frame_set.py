"""The frames of a cell: the MRF and CRF in force, and where Base and Carrier are."""

from collections.abc import Callable

import numpy as np

from ....config.schema.mechanism.mechanism import LONGEST_TOOL, MechanismSection
from ....config.schema.moving import FramesSection
from ....config.schema.section import PoseSection
from ....protocols.messages.perception.moving import FrameRequest
from ...control.frame_tree import Body, FrameTree, Mount, Moved, UnknownFrame
from ...control.spatial import Pose
from ...refusals import Refused, Why
from .redefinition import placed_frame


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
        rolls = ("base",) if mechanism.base is not None else ()
        self._movable = frozenset((*rolls, *frames.moving))
        self._T_wrist_sensor = None
        if sensor is not None:
            place = sensor.T_wrist_sensor
            self._T_wrist_sensor = Pose.from_xyz_rpy(place.xyz, place.rpy)

    @property
    def may_move(self) -> bool:
        """True in a cell with frames that may move."""
        return bool(self._movable)

    @property
    def T_world_crf(self) -> Pose:
        """Where the CRF is now."""
        return self.in_world(self.crf.on, self.crf.T)

    def in_world(self, ground: str, T: Pose) -> Pose:
        """Return where a pose on a ground is in World now."""
        body = self.moved.body(ground)
        return T if body is None else body.T @ T

    def ground(self, name: str) -> str:
        """Return the ground by that name; World for one that stands."""
        return name if name in self._movable else "world"

    def tree(self, T_world_mrf: Pose) -> FrameTree:
        """Return the tree of all frames, with the MRF at a pose in World."""
        return FrameTree(
            self.moved, T_world_mrf, self.T_wrist_mrf, self.crf, self._T_wrist_sensor, self.lens()
        )

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
            if on == "carrier" and on not in self._movable:
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
