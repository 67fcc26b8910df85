"""A kinematic chain: forward kinematics and Jacobian of the MRF, by Pinocchio."""

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ....config.errors import ConfigError
from ....config.load import Cell
from ..compiled import MATRIX, ROW, TABLE, VECTOR, compiled
from ..spatial import GRAVITY, Array, Pose
from ..wheels.rolling import Rolling

_POSTURES = 12
"""So many are tried to find the axes that a chain reaches [1]."""
_REACHED = 1e-6
"""An axis is reached where its singular value is above this part of the greatest [1]."""


class Kinematics(NamedTuple):
    """Where the chain is at one posture; all in World."""

    T_world_wrist: Pose
    T_world_mrf: Pose
    J: Array
    """Jacobian (6, n) of the MRF: joint rates to `[v; ω]` at its origin, World axes, as seen from
    Base; of a Base that rolls, as seen from World."""


class Mechanism:
    """One chain from Base to Wrist with its Pinocchio model.

    The object is a calculator: its answers depend on the arguments of the call alone.
    """

    def __init__(
        self,
        description: str,
        joints: tuple[str, ...],
        tip_link: str,
        T_world_base: Pose,
        rolling: Rolling | None = None,
    ) -> None:
        """Build from a URDF's text; raises `ValueError` where the joints are not its own.

        With `rolling` the first two joints are the wheels of a base, which moves as they turn.
        """
        full = pin.buildModelFromXML(description)
        others = [i for i in range(1, full.njoints) if full.names[i] not in joints]
        model = pin.buildReducedModel(full, others, pin.neutral(full)) if others else full
        if rolling is not None:
            model = _reordered(model, joints)
        order = tuple(model.names[i] for i in range(1, model.njoints))
        if order != joints:
            raise ValueError(f"in order {order}, the cell says {joints}")
        model.gravity.linear = T_world_base.R.T @ GRAVITY
        self.model = model
        self.n = int(model.nv)
        self.joints = joints
        self.T_world_base = T_world_base
        self._data = model.createData()
        self.tip = model.getFrameId(tip_link, pin.FrameType.BODY)
        self.rolling = rolling
        self._base_is_world = bool(
            np.array_equal(T_world_base.R, np.eye(3)) and not T_world_base.p.any()
        )
        self._align = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        self.arm_rank = self._reached(alone=True) if rolling is not None else 0
        """The same of the arm alone, on a base that rolls [1]."""
        self.rank = self._reached()
        """How many of a task's axes the chain reaches anywhere: 3 for a planar one [1]."""

    @classmethod
    def from_cell(cls, cell: Cell) -> "Mechanism":
        """Build the mechanism that a cell describes.

        Raises `ConfigError` where the kinematics library refuses the URDF.
        """
        m = cell.config.mechanism
        joints = tuple(j.name for j in cell.robot.joints)
        base = Pose.from_xyz_rpy(m.T_world_base.xyz, m.T_world_base.rpy)
        try:
            return cls(cell.robot.description(), joints, m.tip_link, base, Rolling.from_cell(cell))
        except (ValueError, RuntimeError) as error:
            raise ConfigError(f"{cell.robot.urdf}: {error}") from None

    def kinematics(
        self, q: Array, T_wrist_mrf: Pose, T_world_base: Pose | None = None
    ) -> Kinematics:
        """Return frames and Jacobian at joint angles q (n,) [rad].

        `T_world_base` is where a Base that moves is now; None: where the cell has it.
        """
        return at_mrf(*self.wrist(q, T_world_base), T_wrist_mrf)

    def wrist(self, q: Array, T_world_base: Pose | None = None) -> tuple[Pose, Array]:
        """Return T_world_wrist at joint angles q (n,) [rad], and the Wrist's Jacobian (6, n).

        The twist is the Wrist's, World axes; `T_world_base` as for `kinematics`.
        """
        J = pin.computeFrameJacobian(self.model, self._data, q, self.tip, self._align)
        T_world_wrist = self._placed(self._data.oMf[self.tip], T_world_base)
        if T_world_base is not None or not self._base_is_world:
            turn = self.T_world_base.R if T_world_base is None else T_world_base.R
            J = np.matmul(turn, J.reshape(2, 3, self.n)).reshape(6, self.n)
        if self.rolling is not None:
            J = J.copy()
            J[:, :2] = self.rolling.columns(T_world_base or self.T_world_base, T_world_wrist.p)
        return T_world_wrist, J

    def pose_wrist(self, q: Array, T_world_base: Pose | None = None) -> Pose:
        """Return T_world_wrist at joint angles q (n,) [rad], without a Jacobian."""
        pin.forwardKinematics(self.model, self._data, q)
        placement = pin.updateFramePlacement(self.model, self._data, self.tip)
        return self._placed(placement, T_world_base)

    def mass_matrix(self, q: Array) -> Array:
        """Return the mass matrix (n, n) [kg·m²] at q (n,) [rad], of the URDF's inertias."""
        return np.array(pin.crba(self.model, self._data, q))

    def gravity(self, q: Array) -> tuple[Array, Array]:
        """Return the joints' gravity torques (n,) [N·m] at q (n,) [rad], and ∂g/∂q (n, n).

        Of the URDF's inertias, with Base where the cell has it.
        """
        slope = pin.computeGeneralizedGravityDerivatives(self.model, self._data, q)
        return self._data.g.copy(), np.array(slope)

    def _reached(self, alone: bool = False) -> int:
        """Return the greatest rank that the Jacobian has at some postures, whatever its point."""
        draw, most = np.random.default_rng(0), 0
        for _ in range(_POSTURES):
            q = draw.uniform(-math.pi, math.pi, self.n)
            J = pin.computeFrameJacobian(self.model, self._data, q, self.tip)
            if self.rolling is not None and not alone:
                J = self.kinematics(q, Pose.identity(), Pose.identity()).J
            s = np.linalg.svd(J, compute_uv=False)
            most = max(most, int((s > _REACHED * s[0]).sum()))
        return most

    def _placed(self, placement: "pin.SE3", T_world_base: Pose | None) -> Pose:
        """Return a placement in Base as a pose in World."""
        # Pinocchio hands out views of its own memory, which the next call writes over.
        pose = Pose(placement.rotation.copy(), placement.translation.copy())
        if T_world_base is not None:
            return T_world_base @ pose
        return pose if self._base_is_world else self.T_world_base @ pose


def at_mrf(T_world_wrist: Pose, J_wrist: Array, T_wrist_mrf: Pose) -> Kinematics:
    """Return the kinematics of a Wrist at a pose, whose Jacobian is (6, n), with its MRF."""
    T_world_mrf, J = Pose(np.zeros((3, 3)), np.empty(3)), np.empty(J_wrist.shape)
    _move_to_mrf(J_wrist, *T_world_wrist, *T_wrist_mrf, *T_world_mrf, J)
    return Kinematics(T_world_wrist, T_world_mrf, J)


def _reordered(model: "pin.Model", joints: tuple[str, ...]) -> "pin.Model":
    """Return a model with its joints in an order in which parents still come before children.

    Pinocchio has the branches of a tree in the order of their names.
    """
    found, place = pin.Model(), [0] * model.njoints
    for name in joints:
        j = model.getJointId(name)
        if j >= model.njoints:
            raise ValueError(f"no joint {name}")
        parent = place[model.parents[j]]
        place[j] = found.addJoint(parent, model.joints[j], model.jointPlacements[j], name)
        found.appendBodyToJoint(place[j], model.inertias[j], pin.SE3.Identity())
    found.inertias[0] = model.inertias[0]
    for frame in model.frames[1:]:
        own = pin.Frame(
            frame.name, place[frame.parentJoint], 0, frame.placement, frame.type, frame.inertia
        )
        found.addFrame(own, False)
    return found


@compiled(MATRIX, MATRIX, VECTOR, MATRIX, VECTOR, TABLE, ROW, TABLE)
def _move_to_mrf(
    J: Array,
    R: Array,
    p: Array,
    R_wrist_mrf: Array,
    p_wrist_mrf: Array,
    R_mrf: Array,
    p_mrf: Array,
    out: Array,
) -> None:
    """Write the MRF's placement, and its Jacobian from the Wrist's, whose placement is R, p.

    v_mrf = v_wrist + ω × lever: Williams 1997, the first half of eq. 1 read backwards. `R_mrf` is
    zeros before.
    """
    lever = np.zeros(3)
    for i in range(3):
        for k in range(3):
            lever[i] += R[i, k] * p_wrist_mrf[k]
            for j in range(3):
                R_mrf[i, j] += R[i, k] * R_wrist_mrf[k, j]
        p_mrf[i] = p[i] + lever[i]
    x, y, z = lever[0], lever[1], lever[2]
    for j in range(J.shape[1]):
        wx, wy, wz = J[3, j], J[4, j], J[5, j]
        out[0, j] = J[0, j] + wy * z - wz * y
        out[1, j] = J[1, j] + wz * x - wx * z
        out[2, j] = J[2, j] + wx * y - wy * x
        out[3, j], out[4, j], out[5, j] = wx, wy, wz
