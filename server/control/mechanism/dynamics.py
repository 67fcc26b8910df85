"""The arm's dynamics: inertia, gravity and what a motion needs.

By Pinocchio: the URDF's inertias, plus the drives' rotors at the joints.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..spatial import GRAVITY, Array, Pose
from ..wheels.rolling import Rolling
from .kinematics import Kinematics, Mechanism


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
        self._mechanism = mechanism
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
        return np.asarray(-self._mechanism.pose_wrist(q).R[2])

    def kinematics(self, q: Array, T_wrist_mrf: Pose) -> Kinematics:
        """Return the frames and the Jacobian of the MRF at q (n,) [rad]."""
        return self._mechanism.kinematics(q, T_wrist_mrf)


class RollingDynamics(Dynamics):
    """The dynamics of an arm on a base with two driven wheels, which carry all that they move.

    As wheels turn, the base moves: what its motion and the arm's need is a force ahead and a moment
    about its axis, of which each wheel has its part. Wheels hold across; they are taken to roll.
    """

    def __init__(
        self, mechanism: Mechanism, rolling: Rolling, rotor_inertia: Array, T_sensor: Pose | None
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
