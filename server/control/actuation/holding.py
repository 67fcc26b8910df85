"""Torques that hold an arm where it stands: the drives' preload before their brakes open."""

import numpy as np

from ..mechanism.dynamics import Dynamics
from ..mechanism.payload import Payload
from ..spatial import GRAVITY, Array


class HoldingTorque:
    """Gravity torques of one arm with its payload."""

    def __init__(self, dynamics: Dynamics, own: Payload | None) -> None:
        """Build it; `own` is the cell's payload, None without a force/torque sensor."""
        self._dynamics, self._own = dynamics, own

    def __call__(self, q: Array, payload: Payload | None, R_world_base: Array) -> Array:
        """Return the torques (n,) [N·m] at q (n,) [rad] with a `payload`, or else the cell's own.

        R_world_base (3, 3) tells how Base is tilted. Without a force/torque sensor the arm carries
        the URDF's tool.
        """
        payload = payload or self._own
        if self._own is not None and payload is not None:
            self._dynamics.carry(payload.mass, payload.com)
        self._dynamics.fall(R_world_base.T @ GRAVITY)
        still = np.zeros(len(q))
        return self._dynamics.torque(q, still, still)
