"""Rest: towards postures in which the joints carry least of the arm's weight.

Downhill in ½ |g(q)|² / G², where g are the joints' gravity torques and G the greatest that random
postures need: static torque heats motors, and is missing where a task needs it (Hollerbach and Suh
1987, with gravity alone). The weight is that of the URDF, with Base as the cell has it.
"""

from typing import Final

import numpy as np

from ....joints import Joints
from ....spatial import Array
from ...kinematics import Mechanism
from ..objective import Objective, View

_POSTURES: Final = 200
"""So many are tried to find the greatest torque [1]."""


class GravityTorque(Objective):
    """Relieves the joints of weight."""

    def __init__(self, joints: Joints, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        draw = np.random.default_rng(0)
        postures = draw.uniform(joints.lower, joints.upper, (_POSTURES, joints.n))
        most2 = max(float(g @ g) for g, _ in map(mechanism.gravity, postures))
        self._weight = 1.0 / most2 if most2 > 0.0 else 0.0

    def rate(self, view: View) -> Array:
        """Return the joint rates (n,) downhill, for a gain of 1 /s [rad/s]."""
        g, slope = self._mechanism.gravity(view.q)
        return np.asarray(-self._weight * (g @ slope))
