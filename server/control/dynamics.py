"""The arm's dynamics: inertia, gravity, and what speed does to the tool, by Pinocchio."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from .frames import Array, Pose, cross, rotate_twist
from .mechanism import Kinematics, Mechanism

GRAVITY = np.array([0.0, 0.0, -9.81])
"""In World [m/s²]."""


class Terms(NamedTuple):
    """Terms of `M ddq + h = τ` at one state, h = C dq + g."""

    M: Array
    """Inertia (n, n), motors included [kg·m²]."""
    drift: Array
    """`Cᵀ dq − g` (n,): what changes the momentum `M dq` beside torques [N·m]."""


class Dynamics:
    """The dynamics of one mechanism with rotors of `rotor_inertia` (n,) [kg·m²].

    A calculator as the mechanism is: its answers depend on the arguments of the call alone.
    """

    def __init__(self, mechanism: Mechanism, rotor_inertia: Array) -> None:
        self._mechanism = mechanism
        R = mechanism.T_world_base.R
        self._R_world_base = R
        self._model = pin.Model(mechanism.model)
        self._model.armature = rotor_inertia
        self._model.gravity.linear = R.T @ GRAVITY
        self._data = self._model.createData()
        self._tip = mechanism.tip
        self._zero = np.zeros(mechanism.n)
        self._align = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def terms(self, q: Array, dq: Array) -> Terms:
        """Return inertia and momentum drift at q (n,) [rad], dq (n,) [rad/s]."""
        M = pin.crba(self._model, self._data, q).copy()
        C = pin.computeCoriolisMatrix(self._model, self._data, q, dq)
        g = pin.computeGeneralizedGravity(self._model, self._data, q)
        return Terms(M, C.T @ dq - g)

    def bias(self, q: Array, dq: Array) -> Array:
        """Return h (n,) [N·m]: the torque that keeps the joints from accelerating."""
        return np.array(pin.nonLinearEffects(self._model, self._data, q, dq))

    def kinematics(self, q: Array, T_wrist_mrf: Pose) -> Kinematics:
        """Return the frames and the Jacobian of the MRF at q (n,) [rad]."""
        return self._mechanism.kinematics(q, T_wrist_mrf)

    def tool(self, q: Array, dq: Array, T_wrist_mrf: Pose) -> tuple[Kinematics, Array]:
        """Return the MRF's kinematics, and J̇ dq (6,): its acceleration at constant rates.

        In World axes [m/s², rad/s²].
        """
        k = self._mechanism.kinematics(q, T_wrist_mrf)
        pin.forwardKinematics(self._model, self._data, q, dq, self._zero)
        found = pin.getFrameClassicalAcceleration(self._model, self._data, self._tip, self._align)
        a = rotate_twist(self._R_world_base, found.vector)
        w = k.J[3:] @ dq
        lever = k.T_world_mrf.p - k.T_world_wrist.p
        a[:3] += cross(a[3:], lever) + cross(w, cross(w, lever))
        return k, a
