"""Forward kinematics of a serial chain for several postures in one pass."""

import numpy as np
import pinocchio as pin

from ....config.load import Cell
from ..scene import Flags, Index
from ..spatial import Array, Pose
from .forward_kinematics import axes_at, frames_at, placed_at


class Chain:
    """The frames of a cell's n joints, by closed form; bodies are numbered 0 (Base) to n."""

    def __init__(self, cell: Cell) -> None:
        """Read the chain from the cell's URDF; joints outside of it stand at zero."""
        model = pin.buildModelFromXML(cell.robot.description())
        data = model.createData()
        pin.forwardKinematics(model, data, pin.neutral(model))
        base = cell.config.mechanism.T_world_base
        self.T_world_base = Pose.from_xyz_rpy(base.xyz, base.rpy)
        ids = [model.getJointId(joint.name) for joint in cell.robot.joints]
        self.n = len(ids)
        self._ids = ids
        self._model, self._data = model, data
        self._parts = np.zeros((self.n, 3, 3, 4))
        """Of each joint: its frame in the one before at zero, and what is added by functions of
        its angle: times sin and 1 − cos, or times the way of a prismatic one and 0."""
        self._axis = np.zeros((self.n, 3))
        self._prismatic = np.zeros(self.n, dtype=bool)
        before = pin.SE3.Identity()
        for i, j in enumerate(ids):
            placement = (before.inverse() * data.oMi[j]).homogeneous
            before = data.oMi[j]
            joint_data = model.joints[j].createData()
            model.joints[j].calc(joint_data, np.zeros(1))
            linear, angular = np.asarray(joint_data.S).reshape(2, 3)
            self._prismatic[i] = bool(linear.any())
            axis = linear if self._prismatic[i] else angular
            self._axis[i] = axis
            self._parts[i, 0] = placement[:3]
            if self._prismatic[i]:
                self._parts[i, 1, :, 3] = placement[:3, :3] @ axis
            else:
                K = pin.skew(axis)
                self._parts[i, 1, :, :3] = placement[:3, :3] @ K
                self._parts[i, 2, :, :3] = placement[:3, :3] @ K @ K
        far = [max(abs(joint.lower), abs(joint.upper)) for joint in cell.robot.joints]
        self.stroke = np.where(self._prismatic, far, 0.0)
        """How far each prismatic joint may be out (n,) [m]; zero for the others."""

    def frames(self, q: Array, T_world_base: Pose | None = None) -> Array:
        """Return the joints' frames (s, n, 3, 4) in World at postures q (s, n) [rad or m]."""
        base = self.T_world_base if T_world_base is None else T_world_base
        return frames_at(self._parts, self._prismatic, q, base.R, base.p)

    def axes(self, frames: Array) -> Array:
        """Return the joints' axes (s, n, 3) in World, given their frames (s, n, 3, 4)."""
        return axes_at(frames, self._axis)

    def placed(
        self, q: Array, body: Index, segments: Array, T_world_base: Pose | None = None
    ) -> tuple[Array, Array, Array]:
        """Return where segments (c, 2, 3) on bodies (c,) are at q (s, n), in World (s, c, 2, 3).

        With the joints' frames (s, n, 3, 4) and axes (s, n, 3).
        """
        base = self.T_world_base if T_world_base is None else T_world_base
        return placed_at(
            self._parts, self._prismatic, self._axis, body, segments, q, base.R, base.p
        )

    @property
    def prismatic(self) -> Flags:
        """Which joints are prismatic (n,)."""
        return self._prismatic

    def body_of(self, frame: str) -> tuple[int, Pose]:
        """Return the body that a link of the URDF is part of, and the link's pose in it.

        Raises `KeyError` for a link that the URDF does not have.
        """
        if not self._model.existFrame(frame):
            raise KeyError(frame)
        placed = self._model.frames[self._model.getFrameId(frame)]
        return self.carried(placed.parentJoint, placed.placement)

    def carried(self, joint: int, placement: "pin.SE3") -> tuple[int, Pose]:
        """Return the body that carries what is placed at a joint of the model, and its pose there.

        Joints that are not in the chain are held at zero.
        """
        data = self._data
        supports = self._model.supports[joint].tolist()
        body = max((self._ids.index(j) + 1 for j in supports if j in self._ids), default=0)
        T_base = data.oMi[joint] * placement
        if body:
            T_base = data.oMi[self._ids[body - 1]].inverse() * T_base
        return body, Pose(T_base.rotation.copy(), T_base.translation.copy())

    @property
    def model(self) -> "pin.Model":
        """Pinocchio's model of the whole URDF."""
        return self._model
