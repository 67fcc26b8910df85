"""Handle of a script's master device: moves at given twists, its pose is streamed."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....protocols.messages.messages import Frame

Array = NDArray[np.float64]


class MasterHandle:
    """A handle at a pose of its own, moving at a twist since some time."""

    def __init__(self) -> None:
        self._p = np.zeros(3)
        self._R = np.eye(3)
        self._twist = np.zeros(6)
        self._since_s = 0.0
        self._axes = Frame.CRF

    def move(self, twist: Sequence[float], axes: Frame, now_s: float) -> None:
        """Move on at a twist (6,) [m/s, rad/s] in the axes of the device's base."""
        self._p, self._R = self._at(now_s)
        self._twist, self._since_s, self._axes = np.array(twist, dtype=float), now_s, axes

    def fields(self, now_s: float) -> dict[str, Any]:
        """Return what a `MasterPose` says now."""
        p, R = self._at(now_s)
        pitch = math.asin(min(1.0, max(-1.0, -float(R[2, 0]))))
        rpy = (math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0]))
        return {"xyz": tuple(p.tolist()), "rpy": rpy, "expressed_in": self._axes}

    def _at(self, now_s: float) -> tuple[Array, Array]:
        passed_s = now_s - self._since_s
        turn = _rotation(passed_s * self._twist[3:])
        return self._p + passed_s * self._twist[:3], turn @ self._R


def _rotation(vector: Array) -> Array:
    """Return the rotation (3, 3) about a vector (3,) by its length [rad] (Rodrigues)."""
    angle = math.sqrt(float(vector @ vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = (vector / angle).tolist()
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K))
