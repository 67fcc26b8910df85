"""The oracle's model of all arms of a cell: how far they are from each other, and their bounds."""

import math
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple, Self

import numpy as np
from telerobot.config.load import Cell

from .arm import OracleArm
from .poses import Array


class Between(NamedTuple):
    """Where two arms of a cell are nearest to each other."""

    distance: float
    """Of their balls [m], within 2 cm of that of their housings; infinite for one arm."""
    arms: tuple[str, ...]
    """Names of both mechanisms; none for one arm."""


@dataclass(frozen=True)
class Arms:
    """The arms of one cell; joint arrays are (n,), arm after arm, as `Cell.joints` names them."""

    names: tuple[str, ...]
    """Of the mechanisms."""
    each: tuple[OracleArm, ...]
    slices: tuple[slice, ...]
    """Which joints are those of each arm."""
    lower: Array
    """Limits of the URDFs [rad]."""
    upper: Array
    velocity: Array
    """Bounds of the drives: rad/s, rad/s², rad/s³."""
    acceleration: Array
    jerk: Array

    @classmethod
    def of(cls, cell: Cell) -> Self:
        """Read the arms of a cell from their URDFs, and the bounds of their drives."""
        parts = cell.parts
        ends = np.cumsum([len(part.robot.joints) for part in parts]).tolist()
        joints = [joint for part in parts for joint in part.robot.joints]
        drives = [drive for part in parts for drive in part.config.mechanism.drives]
        return cls(
            tuple(part.config.mechanism.name for part in parts),
            tuple(OracleArm.of(part) for part in parts),
            tuple(slice(*ends_of) for ends_of in zip([0, *ends[:-1]], ends, strict=True)),
            np.array([joint.lower for joint in joints]),
            np.array([joint.upper for joint in joints]),
            np.array([drive.max_velocity for drive in drives]),
            np.array([drive.max_acceleration for drive in drives]),
            np.array([drive.max_jerk for drive in drives]),
        )

    def between(self, q: Array) -> Between:
        """Return where two arms are nearest to each other at joint angles q (n,) [rad]."""
        balls = [arm.balls(q[part]) for arm, part in zip(self.each, self.slices, strict=True)]
        nearest = Between(math.inf, ())
        for (a, (p, r)), (b, (s, t)) in combinations(zip(self.names, balls, strict=True), 2):
            apart = np.linalg.norm(p[:, None] - s[None], axis=2) - r[:, None] - t[None]
            if apart.size and float(apart.min()) < nearest.distance:
                nearest = Between(float(apart.min()), (a, b))
        return nearest

    def clearance(self, q: Array) -> tuple[float, float]:
        """Return the least distance of arms to fixed things, and of links of any arm [m]."""
        each = [arm.clearance(q[part]) for arm, part in zip(self.each, self.slices, strict=True)]
        own = min(own for _, own in each)
        return min(things for things, _ in each), min(own, self.between(q).distance)
