"""The torques that a motion needs: inverse dynamics of the arm with what it carries.

The URDF's inertias, plus the drives' rotors at the joints. Links that the URDF fixes to the tip
link are the tool: their mass makes way for the payload, wherever that says it is.
"""

import numpy as np
import pinocchio as pin

from .frames import Array, Pose
from .mechanism import Mechanism
from .sources.force import GRAVITY


class InverseDynamics:
    """Inverse dynamics of one mechanism, and of what it was last told to carry.

    `rotor_inertia` (n,) [kg·m²] is what each drive's rotor adds at its joint.
    """

    def __init__(
        self, mechanism: Mechanism, tip_link: str, rotor_inertia: Array, T_wrist_sensor: Pose
    ) -> None:
        model = mechanism.model.copy()
        model.armature = rotor_inertia
        model.gravity.linear = mechanism.T_world_base.R.T @ GRAVITY  # as long as Base stands
        tip = model.frames[model.getFrameId(tip_link)]
        self._joint = tip.parentJoint
        T_joint_wrist = Pose(tip.placement.rotation.copy(), tip.placement.translation.copy())
        self._T_joint_sensor = T_joint_wrist @ T_wrist_sensor
        self._bare = model.inertias[self._joint].toDynamicParameters() - _tool(model, tip_link)
        self._model, self._data = model, model.createData()

    def carry(self, mass: float, com: Array) -> None:
        """Say what is outboard of the Sensor frame: a point mass [kg] at com (3,) [m] in it."""
        com = self._T_joint_sensor.R @ com + self._T_joint_sensor.p
        inertia = self._bare + _point(mass, com)
        self._model.inertias[self._joint] = pin.Inertia.FromDynamicParameters(inertia)

    def fall(self, free_fall: Array) -> None:
        """Say how things fall (3,) [m/s²], in Base axes: gravity, less how Base accelerates."""
        self._model.gravity.linear = free_fall

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the joint torques (n,) [N·m] of a motion without contact and friction."""
        return np.array(pin.rnea(self._model, self._data, q, dq, ddq))


def _tool(model: "pin.Model", tip_link: str) -> Array:
    """Return the dynamic parameters (10,) of the links fixed to the tip link, as point masses."""
    tip = model.getFrameId(tip_link)
    outboard, found = {tip}, np.zeros(10)
    for i, frame in enumerate(model.frames):
        if i > tip and frame.parentFrame in outboard:
            outboard.add(i)
            found += _point(frame.inertia.mass, frame.placement.act(frame.inertia.lever))
    return found


def _point(mass: float, com: Array) -> Array:
    """Return the dynamic parameters (10,) of a point mass [kg] at com (3,) [m]."""
    return np.array(pin.Inertia(mass, com, np.zeros((3, 3))).toDynamicParameters())
