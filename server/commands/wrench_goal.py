"""The wrench that the arm is to exert: its value, and the frame in whose axes it is given."""

import numpy as np

from ...protocols.messages.messages import Frame
from ..control.frame_tree import FrameTree
from ..control.rigid_body import rotate_twist
from ..control.spatial import Array, Pose
from .frames.redefinition import wrench_kept


class WrenchGoal:
    """A wrench at the MRF (6,) [N, N·m]; zero at first. It holds until replaced or cleared."""

    def __init__(self) -> None:
        self.value = np.zeros(6)
        self._frame = Frame.MRF

    def set(self, value: Array, expressed_in: Frame) -> None:
        """Put a wrench (6,) in the axes of a frame in force."""
        self.value, self._frame = value, expressed_in

    def cancel(self) -> None:
        """Exert nothing, in the same axes."""
        self.value = np.zeros(6)

    def axes(self, tree: FrameTree) -> Array | None:
        """Return its axes (3, 3) in World, None for the MRF's."""
        return None if self._frame is Frame.MRF else tree.pose(self._frame).R

    def carry_mrf(self, T_old_new: Pose, before: FrameTree) -> None:
        """Keep the same load when the MRF is redefined; `before` has the frames of before."""
        axes = None
        if self._frame is not Frame.MRF:
            axes = before.pose(self._frame, Frame.MRF).R
        self.value = wrench_kept(self.value, T_old_new, axes)

    def carry_crf(self, R_world_crf: Array, before: FrameTree) -> None:
        """Keep the same load when the CRF is redefined; `before` has the frames of before."""
        if self._frame is Frame.CRF:
            turn = R_world_crf.T @ before.pose("crf").R
            self.value = rotate_twist(turn, self.value)
