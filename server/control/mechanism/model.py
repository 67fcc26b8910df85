"""A kinematic chain: forward kinematics, Jacobian, inertia and gravity, by Pinocchio."""

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ....config.errors import ConfigError
from ....config.load import Cell
from ..compiled import MATRIX, ROW, TABLE, VECTOR, compiled
from ..spatial import GRAVITY, Array, Kinematics, Pose, jacobian_at
from ..wheels import DifferentialDrive
from .arm_angle import ArmAngle

# --- A kinematic chain: forward kinematics and Jacobian of the MRF, by Pinocchio ------------------

_POSTURES = 12
"""So many are tried to find the axes that a chain reaches [1]."""
_REACHED = 1e-6
"""An axis is reached where its singular value is above this part of the greatest [1]."""


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
        rolling: DifferentialDrive | None = None,
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
        draw, here = np.random.default_rng(1), Pose.identity()
        postures = draw.uniform(-math.pi, math.pi, (_POSTURES, self.n))
        self.arm_angle = ArmAngle.of([self.wrist(q, here) for q in postures])
        """Reads the arm angle; None for an arm that is no S-R-S."""
        # Scratch: ranks of tasks that leave axes free, by those and the MRF.
        self._held_ranks: dict[bytes, tuple[int, int]] = {}

    @classmethod
    def from_cell(cls, cell: Cell) -> "Mechanism":
        """Build the mechanism that a cell describes.

        Raises `ConfigError` where the kinematics library refuses the URDF.
        """
        m = cell.config.mechanism
        joints = tuple(j.name for j in cell.robot.joints)
        base = Pose.from_xyz_rpy(m.T_world_base.xyz, m.T_world_base.rpy)
        try:
            return cls(
                cell.robot.description(),
                joints,
                m.tip_link,
                base,
                DifferentialDrive.from_cell(cell),
            )
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
        return max(_rank(J) for J in self._samples(alone))

    def _samples(self, alone: bool) -> list[Array]:
        """Return Jacobians of the Wrist at some postures, (6, n), in its own axes."""
        draw, found = np.random.default_rng(0), []
        for _ in range(_POSTURES):
            q = draw.uniform(-math.pi, math.pi, self.n)
            J = pin.computeFrameJacobian(self.model, self._data, q, self.tip)
            if self.rolling is not None and not alone:
                k = self.kinematics(q, Pose.identity(), Pose.identity())
                J = _turned(k.T_world_wrist.R.T, k.J)
            found.append(np.array(J))
        return found

    def held_ranks(self, held: Array, T_wrist_mrf: Pose) -> tuple[int, int]:
        """Return how many of the rows that a task holds are reached anywhere [1].

        `held` (6,) is true for those, in the axes of the MRF. Without the base of a mechanism that
        rolls, and with it.
        """
        count = int(np.count_nonzero(held))
        if self.rank == 6 and self.arm_rank in (0, 6):
            return count, count
        at = held.tobytes() + T_wrist_mrf.R.tobytes() + T_wrist_mrf.p.tobytes()
        found = self._held_ranks.get(at)
        if found is None:
            ranks = [self._of_rows(held, T_wrist_mrf, alone) for alone in (True, False)]
            found = self._held_ranks[at] = ranks[0] if self.rolling else ranks[1], ranks[1]
        return found

    def _of_rows(self, held: Array, T_wrist_mrf: Pose, alone: bool) -> int:
        """Return the greatest rank that the rows which are held have at some postures."""
        most = 0
        for J_wrist in self._samples(alone):
            J = _turned(T_wrist_mrf.R.T, jacobian_at(J_wrist, T_wrist_mrf.p))
            most = max(most, _rank(J[held], float(np.linalg.norm(J))))
        return most

    def _placed(self, placement: "pin.SE3", T_world_base: Pose | None) -> Pose:
        """Return a placement in Base as a pose in World."""
        # Pinocchio hands out views of its own memory, which the next call writes over.
        pose = Pose(placement.rotation.copy(), placement.translation.copy())
        if T_world_base is not None:
            return T_world_base @ pose
        return pose if self._base_is_world else self.T_world_base @ pose


def _rank(J: Array, size: float = 0.0) -> int:
    """Return the rank of a Jacobian (m, n), or of its rows where the whole is of a `size`."""
    s = np.linalg.svd(J, compute_uv=False)
    return int((s > _REACHED * max(size, *s)).sum()) if len(s) else 0


def _turned(R: Array, J: Array) -> Array:
    """Return a Jacobian (6, n) in axes to which R (3, 3) turns its own."""
    return np.asarray(np.matmul(R, J.reshape(2, 3, -1)).reshape(J.shape))


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


# --- The arm's dynamics: inertia, gravity and what a motion needs ---------------------------------
#
# By Pinocchio: the URDF's inertias, plus the drives' rotors at the joints.


class Terms(NamedTuple):
    """Terms of `M ddq + C dq + g = τ + J_wristᵀ wrench` at one state."""

    M: Array
    """Inertia (n, n), motors included [kg·m²]."""
    C: Array
    """Coriolis matrix (n, n), dM/dt = C + Cᵀ: torques and `Cᵀ dq − g` change the momentum `M dq`
    [N·m·s/rad]."""
    g: Array
    """Gravity (n,) [N·m]."""
    J_wrist: Array
    """Jacobian (6, n) of the Wrist, at its origin and in its own axes."""


class Dynamics:
    """The dynamics of one mechanism with rotors of `rotor_inertia` (n,) [kg·m²].

    A calculator as the mechanism is: its answers depend on the arguments of the call, and on what
    it was last told to `carry`, and how things `fall`. Until then links that the URDF fixes to the
    tip link are the tool, and Base stands where the cell has it.
    """

    def __init__(
        self, mechanism: Mechanism, rotor_inertia: Array, T_wrist_sensor: Pose | None = None
    ) -> None:
        self.mechanism = mechanism
        R = mechanism.T_world_base.R
        self._model = pin.Model(mechanism.model)
        self._model.armature = rotor_inertia
        self._model.gravity.linear = R.T @ GRAVITY
        self._data = self._model.createData()
        self._tip, self._own_axes = mechanism.tip, pin.ReferenceFrame.LOCAL
        tip = self._model.frames[self._tip]
        self._joint = tip.parentJoint
        T_joint_wrist = Pose(tip.placement.rotation.copy(), tip.placement.translation.copy())
        T_wrist_sensor = T_wrist_sensor or Pose.identity()
        self._T_wrist_sensor = T_wrist_sensor
        self.carried = (0.0, np.zeros(3))
        """Mass of the payload [kg], and its centre (3,) in the Wrist [m]."""
        self._told: tuple[float, Array] | None = None
        """What `carry` was told last."""
        self._T_joint_sensor = T_joint_wrist @ T_wrist_sensor
        self._to_sensor = pin.SE3(T_wrist_sensor.R, T_wrist_sensor.p).inverse().action
        tool = _tool(self._model, self._tip)
        self._bare = self._model.inertias[self._joint].toDynamicParameters() - tool

    def carry(self, mass: float, com: Array) -> None:
        """Say what is outboard of the Sensor frame: a point mass [kg] at com (3,) [m] in it.

        The tool's own mass makes way for it.
        """
        if self._told is not None and mass == self._told[0] and (com == self._told[1]).all():
            return
        self._told = mass, com
        self.carried = (mass, self._T_wrist_sensor.R @ com + self._T_wrist_sensor.p)
        com = self._T_joint_sensor.R @ com + self._T_joint_sensor.p
        inertia = self._bare + _point(mass, com)
        self._hang(pin.Inertia.FromDynamicParameters(inertia))

    def _hang(self, inertia: "pin.Inertia") -> None:
        """Give the last link's inertia with what it carries to the model."""
        self._model.inertias[self._joint] = inertia

    def fall(self, free_fall: Array) -> None:
        """Say how things fall (3,) [m/s²], in Base axes: gravity, less how Base accelerates."""
        self._model.gravity.linear = free_fall

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the joint torques (n,) [N·m] of a motion without contact and friction."""
        return np.array(pin.rnea(self._model, self._data, q, dq, ddq))

    def terms(self, q: Array, dq: Array) -> Terms:
        """Return the terms at q (n,) [rad], dq (n,) [rad/s]."""
        model, data = self._model, self._data
        # Pinocchio hands out views of its own memory, which the next call writes over.
        M = pin.crba(model, data, q).copy()
        g = pin.computeGeneralizedGravity(model, data, q).copy()
        C = pin.computeCoriolisMatrix(model, data, q, dq).copy()  # it leaves the joints' Jacobians
        return Terms(M, C, g, pin.getFrameJacobian(model, data, self._tip, self._own_axes))

    def standing(self, q: Array) -> tuple[Array, Array]:
        """Return the torques that hold the joints at q (n,) [N·m], and what inertia each moves.

        That is with the others held, motors included (n,) [kg·m²].
        """
        M = pin.crba(self._model, self._data, q)
        inertia = M.diagonal().copy()
        return pin.computeGeneralizedGravity(self._model, self._data, q).copy(), inertia

    def gravity(self, q: Array) -> tuple[Array, Array]:
        """Return the torques (n,) [N·m] that hold the joints at q (n,) [rad], and ∂g/∂q (n, n)."""
        slope = pin.computeGeneralizedGravityDerivatives(self._model, self._data, q)
        return self._data.g.copy(), np.array(slope)

    def sensor_jacobian(self, q: Array) -> Array:
        """Return the Jacobian (6, n) of the Sensor frame, at its origin and in its own axes."""
        axes = pin.ReferenceFrame.LOCAL
        return np.asarray(
            self._to_sensor @ pin.computeFrameJacobian(self._model, self._data, q, self._tip, axes)
        )

    def bias(self, q: Array, dq: Array) -> Array:
        """Return h (n,) [N·m]: the torque that keeps the joints from accelerating."""
        return np.array(pin.nonLinearEffects(self._model, self._data, q, dq))

    @property
    def sensor_at(self) -> Array:
        """Where the Sensor is in the Wrist (3,) [m]."""
        return self._T_wrist_sensor.p

    def down(self, q: Array) -> Array:
        """Return which way things fall (3,), in the Wrist's axes, of a Base that stands."""
        return np.asarray(-self.mechanism.pose_wrist(q).R[2])

    def kinematics(self, q: Array, T_wrist_mrf: Pose) -> Kinematics:
        """Return the frames and the Jacobian of the MRF at q (n,) [rad]."""
        return self.mechanism.kinematics(q, T_wrist_mrf)


class RollingDynamics(Dynamics):
    """The dynamics of an arm on a base with two driven wheels, which carry all that they move.

    As wheels turn, the base moves: what its motion and the arm's need is a force ahead and a moment
    about its axis, of which each wheel has its part. Wheels hold across; they are taken to roll.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        rolling: DifferentialDrive,
        rotor_inertia: Array,
        T_sensor: Pose | None,
    ) -> None:
        super().__init__(mechanism, rotor_inertia, T_sensor)
        self._rolling = rolling
        self._moving = _on_a_plane(self._model)
        self._moving_data = self._moving.createData()

    def _hang(self, inertia: "pin.Inertia") -> None:
        super()._hang(inertia)
        self._moving.inertias[self._joint + 1] = inertia

    def fall(self, free_fall: Array) -> None:
        """Say how things fall (3,) [m/s²], in Base axes, but for how its wheels move Base."""
        super().fall(free_fall)
        self._moving.gravity.linear = free_fall

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the torques (n,) [N·m] of a motion without contact and friction, wheels first."""
        v, w = self._rolling.driven(dq[:2])
        a, alpha = self._rolling.driven(ddq[:2])
        # Ahead, across, about: at Base's origin, midway between the wheels, in its own axes.
        base = np.array([[0.0, 0.0, 1.0, 0.0], [v, 0.0, w, 0.0], [a, 0.0, alpha, 0.0]])
        needed = pin.rnea(
            self._moving,
            self._moving_data,
            np.concatenate((base[0], q)),
            np.concatenate((base[1, :3], dq)),
            np.concatenate((base[2, :3], ddq)),
        )
        ahead, about = 0.5 * self._rolling.radius * needed[0], self._rolling.turn * needed[2]
        found = np.array(needed[3:])
        found[0] += ahead - about
        found[1] += ahead + about
        return found


def dynamics_of(
    mechanism: Mechanism, rotor_inertia: Array, T_wrist_sensor: Pose | None = None
) -> Dynamics:
    """Return the dynamics of a mechanism, with its base where that rolls."""
    if mechanism.rolling is None:
        return Dynamics(mechanism, rotor_inertia, T_wrist_sensor)
    return RollingDynamics(mechanism, mechanism.rolling, rotor_inertia, T_wrist_sensor)


def _on_a_plane(model: "pin.Model") -> "pin.Model":
    """Return a model whose root link slides and turns on a plane: that joint comes first."""
    found, armature = pin.Model(), np.concatenate((np.zeros(3), model.armature))
    root = found.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "plane")
    found.appendBodyToJoint(root, model.inertias[0], pin.SE3.Identity())
    for j in range(1, model.njoints):
        place = found.addJoint(
            model.parents[j] + 1, model.joints[j], model.jointPlacements[j], model.names[j]
        )
        found.appendBodyToJoint(place, model.inertias[j], pin.SE3.Identity())
    found.armature = armature
    found.gravity.linear = model.gravity.linear
    return found


def _tool(model: "pin.Model", tip: int) -> Array:
    """Return the dynamic parameters (10,) of the links fixed to frame `tip`, as point masses."""
    outboard, found = {tip}, np.zeros(10)
    for i, frame in enumerate(model.frames):
        if i > tip and frame.parentFrame in outboard:
            outboard.add(i)
            found += _point(frame.inertia.mass, frame.placement.act(frame.inertia.lever))
    return found


def _point(mass: float, com: Array) -> Array:
    """Return the dynamic parameters (10,) of a point mass [kg] at com (3,) [m]."""
    return np.array(pin.Inertia(mass, com, np.zeros((3, 3))).toDynamicParameters())
