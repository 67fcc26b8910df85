"""Attitudes for an identification: the wrist turns about a posture, the tool stays close by."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...config.drives import joint_bounds
from ...config.errors import ConfigError
from ...config.load import Cell
from ...server.control.mechanism.model import Mechanism
from ...server.control.spatial import Array, Pose

WRIST_JOINTS = 3
"""Number of joints that turn, counted from the last [1]."""
CANDIDATES = 600
PATH_SAMPLES = 12
FROM_LIMIT = 0.05
"""Kept from the joint limits [rad]."""


@dataclass(frozen=True)
class AttitudeStop:
    """A posture (n,) [rad] on the way; only those that `measure` are averaged."""

    q: Array
    measure: bool


def attitudes(cell: Cell, posture: str, count: int, room: float) -> list[AttitudeStop]:
    """Return the way through `count` attitudes about a posture, the MRF never further than `room`.

    The directions of gravity are spread as far as that allows (D-optimal, greedily). Joints move
    straight between two stops. Raises `ConfigError` for a posture that the cell lacks or where the
    wrist has no room to turn.
    """
    mechanism = cell.config.mechanism
    if posture not in mechanism.postures:
        known = ", ".join(mechanism.postures)
        raise ConfigError(f"{cell.path}: mechanism.postures.{posture}: none of {known}")
    space = _Space(cell, np.array(mechanism.postures[posture]), room)
    candidates = list(space.candidates())
    if len(candidates) < count:
        raise ConfigError(
            f"{cell.path}: the wrist cannot turn within {room:g} m about posture {posture!r}: "
            "name another one, or more room"
        )
    up = np.array([space.up(q) for q in candidates])
    chosen = _spread(np.column_stack([up, np.ones(len(up))]), count)
    return list(space.way([candidates[i] for i in chosen]))


class _Space:
    """Room in which the tool may move."""

    def __init__(self, cell: Cell, home: Array, room: float) -> None:
        config = cell.config.mechanism
        self._mechanism = Mechanism.from_cell(cell)
        self._tool = Pose.from_xyz_rpy(config.T_wrist_mrf.xyz, config.T_wrist_mrf.rpy)
        self._home, self._room = home, room
        bounds = joint_bounds(cell.robot.joints, config.drives, FROM_LIMIT)
        self._lower, self._upper = np.array(bounds.lower), np.array(bounds.upper)
        self._centre = self._tip(home)

    def up(self, q: Array) -> Array:
        """Return the upward direction (3,) in the Wrist."""
        return np.asarray(self._mechanism.pose_wrist(q).R[2])

    def candidates(self) -> Iterator[Array]:
        """Yield postures (n,) that can be reached from home within the room."""
        draw = np.random.default_rng(1)
        turning = slice(max(0, len(self._home) - WRIST_JOINTS), None)
        low = np.maximum(self._lower, self._home - np.pi)[turning]
        high = np.minimum(self._upper, self._home + np.pi)[turning]
        for _ in range(CANDIDATES):
            q = self._home.copy()
            q[turning] = draw.uniform(low, high)
            if self.inside(self._home, q):
                yield q

    def inside(self, a: Array, b: Array) -> bool:
        """Return whether the tool stays within the room on the straight way from a to b (n,)."""
        shares = np.linspace(1.0, 0.0, PATH_SAMPLES)
        return all(
            float(np.linalg.norm(self._tip(a + s * (b - a)) - self._centre)) <= self._room
            for s in shares
        )

    def way(self, postures: list[Array]) -> Iterator[AttitudeStop]:
        """Yield the stops, always on to the nearest, by way of home where straight is too far."""
        at, left = self._home, list(postures)
        while left:
            nearest = min(range(len(left)), key=lambda i: float(np.abs(left[i] - at).max()))
            q = left.pop(nearest)
            if not self.inside(at, q):
                yield AttitudeStop(self._home, False)
            yield AttitudeStop(q, True)
            at = q
        yield AttitudeStop(self._home, False)

    def _tip(self, q: Array) -> Array:
        return (self._mechanism.pose_wrist(q) @ self._tool).p


def _spread(rows: Array, count: int) -> list[int]:
    """Return the indices of `count` rows (k, 4) whose information has the greatest determinant."""
    chosen: list[int] = []
    information = 1e-3 * np.eye(rows.shape[1])
    for _ in range(count):
        gain = np.einsum("ki,ij,kj->k", rows, np.linalg.inv(information), rows)
        gain[chosen] = -np.inf
        chosen.append(int(np.argmax(gain)))
        information = information + np.outer(rows[chosen[-1]], rows[chosen[-1]])
    return chosen
