"""A kinematic chain: forward kinematics, Jacobian, inertia and gravity."""

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ....config.errors import ConfigError
from ....config.load import Cell
from ..forest import Branch, Masses, Tip, kinematics, needed
from ..spatial import GRAVITY, Array, Kinematics, Pose, jacobian_at, nonzero
from ..wheels import DifferentialDrive
from .arm_angle import ArmAngle

# --- A kinematic chain: forward kinematics and Jacobian of the MRF --------------------------------

_POSTURES = 12
"""So many are tried to find the axes that a chain reaches [1]."""
_HERE = Pose.identity()
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
        branch = Branch(full, joints, rolling)
        body, T_body_wrist = branch.body_of(tip_link)
        moves, joint = np.zeros(self.n, dtype=np.bool_), body - 1
        while joint >= 0:
            moves[joint], joint = True, int(branch.tree.parent[joint])
        self.tree, self.arm_tip = branch.tree, Tip(body, *T_body_wrist, moves)
        """The Wrist as the arm's joints move it, on a base that stands."""
        moves = moves.copy()
        moves[: 0 if rolling is None else 2] = True
        self._tip = self.arm_tip._replace(moves=moves)
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
        return kinematics(self.tree, self._tip, q, T_world_base or self.T_world_base, T_wrist_mrf)

    def wrist(self, q: Array, T_world_base: Pose | None = None) -> tuple[Pose, Array]:
        """Return T_world_wrist at joint angles q (n,) [rad], and the Wrist's Jacobian (6, n).

        The twist is the Wrist's, World axes; `T_world_base` as for `kinematics`.
        """
        k = self.kinematics(q, _HERE, T_world_base)
        return k.T_world_wrist, k.J

    def pose_wrist(self, q: Array, T_world_base: Pose | None = None) -> Pose:
        """Return T_world_wrist at joint angles q (n,) [rad]."""
        return self.kinematics(q, _HERE, T_world_base).T_world_wrist

    def mass_matrix(self, q: Array) -> Array:
        """Return the mass matrix (n, n) [kg·m²] at q (n,) [rad], of the URDF's inertias."""
        return np.array(pin.crba(self.model, self._data, q))

    def mass(self, q: Array) -> tuple[float, Array]:
        """Return its mass [kg], and the centre of that (3,) in Base at q (n,) [m].

        Of the URDF's inertias.
        """
        centre = np.array(pin.centerOfMass(self.model, self._data, q))
        return float(pin.computeTotalMass(self.model)), centre

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
        tip = self.arm_tip if alone else self._tip
        draw, found = np.random.default_rng(0), []
        for _ in range(_POSTURES):
            q = draw.uniform(-math.pi, math.pi, self.n)
            k = kinematics(self.tree, tip, q, _HERE, _HERE)
            found.append(_turned(k.T_world_wrist.R.T, k.J))
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


def _rank(J: Array, size: float = 0.0) -> int:
    """Return the rank of a Jacobian (m, n), or of its rows where the whole is of a `size`."""
    s = np.linalg.svd(J, compute_uv=False)
    return int((s > _REACHED * max(size, *s)).sum()) if len(s) else 0


def _turned(R: Array, J: Array) -> Array:
    """Return a Jacobian (6, n) in axes to which R (3, 3) turns its own."""
    return np.asarray(np.matmul(R, J.reshape(2, 3, -1)).reshape(J.shape))


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


# --- The arm's dynamics: inertia, gravity and what a motion needs ---------------------------------
#
# Of the URDF's inertias, plus the drives' rotors at the joints.


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

    Wheels that the first two joints are carry all that they move: the base's motion and the arm's
    need a force ahead and a moment about its axis, of which each wheel has its part.

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
        self._masses, self._falls = _masses(mechanism, rotor_inertia), R.T @ GRAVITY
        at = mechanism.arm_tip
        T_body_sensor = Pose(at.R, at.p) @ T_wrist_sensor
        self._sensor = at._replace(R=T_body_sensor.R, p=T_body_sensor.p)
        tool = _tool(self._model, self._tip)
        self._bare = self._model.inertias[self._joint].toDynamicParameters() - tool

    def carry(self, mass: float, com: Array) -> None:
        """Say what is outboard of the Sensor frame: a point mass [kg] at com (3,) [m] in it.

        The tool's own mass makes way for it.
        """
        if self._told is not None and mass == self._told[0] and not nonzero(com - self._told[1]):
            return
        self._told = mass, com
        self.carried = (mass, self._T_wrist_sensor.R @ com + self._T_wrist_sensor.p)
        com = self._T_joint_sensor.R @ com + self._T_joint_sensor.p
        inertia = self._bare + _point(mass, com)
        self._model.inertias[self._joint] = pin.Inertia.FromDynamicParameters(inertia)
        self._masses.hang(self._joint, self._model.inertias[self._joint])

    def fall(self, free_fall: Array) -> None:
        """Say how things fall (3,) [m/s²], in Base axes: gravity, less how Base accelerates."""
        self._model.gravity.linear = self._falls = free_fall

    def needed(self, q: Array, dq: Array, ddq: Array) -> tuple[Array, Array]:
        """Return the torques (2, n) [N·m] of a motion, and the Sensor's Jacobian (6, n).

        The first row is that of q, q̇ and q̈ (n,), the second without q̈; no contact and friction.
        The Jacobian is at the Sensor's origin and in its own axes, of a Base that stands.
        """
        motion = q, dq, ddq
        return needed(self.mechanism.tree, self._sensor, self._masses, self._falls, motion)

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the joint torques (n,) [N·m] of a motion without contact and friction."""
        return np.asarray(self.needed(q, dq, ddq)[0][0])

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


def _masses(mechanism: Mechanism, rotor_inertia: Array) -> Masses:
    """Return what a mechanism's joints move; wheels are on Base, and turn in their own places."""
    n, model, wheels = mechanism.n, mechanism.model, 0 if mechanism.rolling is None else 2
    found = Masses(
        np.zeros(1 + n), np.zeros((1 + n, 3)), np.zeros((1 + n, 3, 3)), rotor_inertia.copy(), wheels
    )
    root, data = pin.Inertia(model.inertias[0]), model.createData()  # its own: wheels are added
    for j in range(1, 1 + wheels):
        axis = pin.computeJointJacobian(model, data, pin.neutral(model), j)[3:, j - 1]
        root += model.jointPlacements[j].act(model.inertias[j])
        found.rotor[j - 1] += float(axis @ model.inertias[j].matrix()[3:, 3:] @ axis)
    found.hang(0, root)
    for j in range(1 + wheels, 1 + n):
        found.hang(j, model.inertias[j])
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
