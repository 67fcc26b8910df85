"""Where every frame is: the MRF and CRF that are in force, and what Base and Carrier do."""

from collections.abc import Callable

from ...config.load import Cell
from ...protocols.messages.moving import FrameRequest
from ..control.frame_tree import Body, Mount, Moved, Tree, UnknownFrame
from ..control.spatial import Pose
from .redefinition import placed_frame


class FrameSet:
    """The frames of one cell, redefined as operators ask."""

    def __init__(self, cell: Cell, T_wrist_sensor: Pose | None) -> None:
        config, frames = cell.config, cell.config.frames
        place = config.mechanism.T_world_base
        base = Body.standing(Pose.from_xyz_rpy(place.xyz, place.rpy))
        self.moved = Moved(base, Body.standing(Pose.identity()), base.T)
        """Where Base and Carrier are now."""
        mrf, crf = config.mechanism.T_wrist_mrf, config.T_world_crf
        self.T_wrist_mrf = Pose.from_xyz_rpy(mrf.xyz, mrf.rpy)
        on_ground = crf if frames.crf_on == "world" else frames.T_ground_crf
        self.crf = Mount(frames.crf_on, Pose.from_xyz_rpy(on_ground.xyz, on_ground.rpy))
        self.redefined = 0
        """How often MRF or CRF were redefined."""
        self.lens: Callable[[], Mount | None] = lambda: None
        """Where the Lens of the camera is whose view is kept."""
        self._movable = frozenset(frames.moving)
        self._T_wrist_sensor = T_wrist_sensor

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

    def tree(self, T_world_mrf: Pose) -> Tree:
        """Return every frame, with the MRF at a pose in World."""
        return Tree(
            self.moved, T_world_mrf, self.T_wrist_mrf, self.crf, self._T_wrist_sensor, self.lens()
        )

    def redefine(self, request: FrameRequest, tree: Tree) -> Pose | None:
        """Put a new MRF or CRF in force; return T_old_new of the MRF, None for the CRF.

        Raises `UnknownFrame`; then all is as before.
        """
        T_old_new = None
        if request.frame == "crf":
            on = request.moves_with or self.crf.on
            if on == "carrier" and on not in self._movable:
                raise UnknownFrame("'carrier': there is no [frames.carrier] in this cell")
            self.crf = Mount(on, placed_frame(request, tree, on))
        else:
            T_wrist_mrf = placed_frame(request, tree, "wrist")
            T_old_new = self.T_wrist_mrf.inverse() @ T_wrist_mrf
            self.T_wrist_mrf = T_wrist_mrf
        self.redefined += 1
        return T_old_new
