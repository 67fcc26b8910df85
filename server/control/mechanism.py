"""A kinematic chain: forward kinematics and Jacobian of the MRF, by Pinocchio."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ...config.errors import ConfigError
from ...config.load import Cell
from .frames import Array, Pose


class Kinematics(NamedTuple):
    """Where the chain is at one posture; all in World."""

    T_world_wrist: Pose
    T_world_mrf: Pose
    J: Array
    """Jacobian (6, n) of the MRF: joint rates to `[v; ω]` at its origin, World axes."""


class Mechanism:
    """One chain from Base to Wrist with its Pinocchio model.

    The object is a calculator: its answers depend on the arguments of the call alone.
    """

    def __init__(
        self, description: str, joints: tuple[str, ...], tip_link: str, T_world_base: Pose
    ) -> None:
        """Build from a URDF's text; raises `ValueError` where the joints are not its own."""
        full = pin.buildModelFromXML(description)
        others = [i for i in range(1, full.njoints) if full.names[i] not in joints]
        model = pin.buildReducedModel(full, others, pin.neutral(full)) if others else full
        order = tuple(model.names[i] for i in range(1, model.njoints))
        if order != joints:
            raise ValueError(f"in order {order}, the cell says {joints}")
        self.model = model
        self.n = int(model.nv)
        self.joints = joints
        self.T_world_base = T_world_base
        self._data = model.createData()
        self._tip = model.getFrameId(tip_link)
        self._align = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

    @classmethod
    def from_cell(cls, cell: Cell) -> "Mechanism":
        """Build the mechanism that a cell describes.

        Raises `ConfigError` where the kinematics library refuses the URDF.
        """
        m = cell.config.mechanism
        joints = tuple(j.name for j in cell.robot.joints)
        base = Pose.from_xyz_rpy(m.T_world_base.xyz, m.T_world_base.rpy)
        try:
            return cls(cell.robot.description(), joints, m.tip_link, base)
        except (ValueError, RuntimeError) as error:
            raise ConfigError(f"{cell.robot.urdf}: {error}") from None

    def kinematics(self, q: Array, T_wrist_mrf: Pose) -> Kinematics:
        """Return frames and Jacobian at joint angles q (n,) [rad]."""
        J = pin.computeFrameJacobian(self.model, self._data, q, self._tip, self._align)
        placement = self._data.oMf[self._tip]
        base = self.T_world_base
        T_world_wrist = base @ Pose(placement.rotation, placement.translation)
        lever = T_world_wrist.R @ T_wrist_mrf.p
        T_world_mrf = Pose(T_world_wrist.R @ T_wrist_mrf.R, T_world_wrist.p + lever)
        out = np.empty((6, self.n))
        out[3:] = base.R @ J[3:]
        x, y, z = lever.tolist()
        # v_mrf = v_wrist + ω × lever, the first half of Williams 1997, eq. 1, read backwards.
        out[:3] = base.R @ J[:3]
        out[0] += out[4] * z - out[5] * y
        out[1] += out[5] * x - out[3] * z
        out[2] += out[3] * y - out[4] * x
        return Kinematics(T_world_wrist, T_world_mrf, out)

    def pose_wrist(self, q: Array) -> Pose:
        """Return T_world_wrist at joint angles q (n,) [rad], without a Jacobian."""
        pin.framesForwardKinematics(self.model, self._data, q)
        placement = self._data.oMf[self._tip]
        return self.T_world_base @ Pose(placement.rotation, placement.translation)
