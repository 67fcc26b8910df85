"""Where scanner and arm are at the instants that telemetry tells of, in the odometry's frame."""

from collections import deque
from typing import Final, NamedTuple

import numpy as np

from ....config.load import Cell, ConfigError
from ....protocols.messages.telemetry import State
from ...control.proximity.capsules import Capsules
from ...control.spatial import Array, Pose
from .placing import Knots

KEPT: Final = 200
"""Newest instants that are kept [1]: 2 s."""


class MeasuredInstant(NamedTuple):
    """Where everything was measured at one telemetry tick."""

    tick: int
    time_s: float
    """The daemon's time [s]."""
    q: Array
    """Joints of the mechanism (n,) [rad]."""
    T_world_base: Pose
    """Base by the odometry."""


def instant_of(state: State) -> MeasuredInstant:
    """Return what a tick's telemetry tells; Base stands in World where it does not move."""
    x, y, z, *rpy = state.frames.get("base", (0.0,) * 6)
    return MeasuredInstant(
        state.tick, state.time_s, np.array(state.q), Pose.from_xyz_rpy((x, y, z), tuple(rpy))
    )


class Ring:
    """The newest instants, in turn."""

    def __init__(self) -> None:
        self._each: deque[MeasuredInstant] = deque(maxlen=KEPT)

    def add(self, instant: MeasuredInstant) -> None:
        """Take in an instant; one that is not newer is ignored, unless time starts again."""
        newest = self.newest
        if newest is not None and instant.tick < newest.tick - KEPT:
            self._each.clear()
        elif newest is not None and instant.time_s <= newest.time_s:
            return
        self._each.append(instant)

    @property
    def newest(self) -> MeasuredInstant | None:
        """The newest instant; None before the first."""
        return self._each[-1] if self._each else None

    def around(self, first_s: float, last_s: float) -> list[MeasuredInstant]:
        """Return the instants from the last before a span of time to the first behind it.

        Fewer than two where the span is not covered.
        """
        if not self._each or self._each[0].time_s > first_s or self._each[-1].time_s < last_s:
            return []
        found: list[MeasuredInstant] = []
        for instant in reversed(self._each):
            if instant.time_s >= last_s:
                found = []
            found.append(instant)
            if instant.time_s <= first_s:
                break
        return found[::-1]


class ScannerGeometry:
    """Scanner and capsules of a cell's mechanism."""

    def __init__(self, cell: Cell) -> None:
        """Read them. Raises `ConfigError` for a cell without a scanner, or an unknown link."""
        scanner = cell.config.scanner
        if scanner is None:
            raise ConfigError(f"{cell.path}: scanner: the cell has none")
        self._capsules = Capsules(cell)
        self._forest = self._capsules.forest
        try:
            self._body, T = self._forest.body_of(scanner.link)
        except KeyError:
            raise ConfigError(
                f"{cell.path}: scanner.link: value '{scanner.link}': no such link in "
                f"{cell.robot.urdf}"
            ) from None
        place = scanner.T_link_scanner
        self._T_body_scanner = T @ Pose.from_xyz_rpy(place.xyz, place.rpy)
        # What the scanner sits on is in nobody's way, and its rays begin inside of it.
        self._others = self._capsules.body != self._body
        self.reach = self._capsules.radius[self._others] + scanner.self_margin
        """Radii of the capsules, grown by the margin (c,) [m]."""

    def knots(self, instants: list[MeasuredInstant]) -> Knots:
        """Return poses and capsules at some instants."""
        q = np.array([instant.q for instant in instants])
        placed = self._capsules.place(q, Pose.identity())
        ends = placed.ends[:, self._others].reshape(len(q), -1, 3)
        R = np.broadcast_to(self._T_body_scanner.R, (len(q), 3, 3))
        p = np.broadcast_to(self._T_body_scanner.p, (len(q), 3))
        if self._body > 0:
            frames = placed.frames[:, self._body - 1]
            R, p = (
                frames[:, :, :3] @ R,
                np.einsum("kij,kj->ki", frames[:, :, :3], p) + frames[:, :, 3],
            )
        R_base = np.array([instant.T_world_base.R for instant in instants])
        p_base = np.array([instant.T_world_base.p for instant in instants])
        return Knots(
            np.array([instant.time_s for instant in instants]),
            R_base @ R,
            np.einsum("kij,kj->ki", R_base, p) + p_base,
            np.einsum("kij,kcj->kci", R_base, ends) + p_base[:, None],
        )
