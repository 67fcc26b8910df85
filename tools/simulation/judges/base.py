"""Figures of a base on wheels, by the physics' truth."""

import math
from collections.abc import Sequence
from itertools import pairwise

from ....config.load import Cell
from ....protocols.messages.rig import RigTruth
from ....protocols.messages.telemetry import State


def base_figures(
    cell: Cell, states: Sequence[State], truths: Sequence[RigTruth]
) -> dict[str, object]:
    """Return the figures for a simulation's JSON; none of a cell where nothing rolls.

    How far the base has gone, along its way [m], and how far odometry is off at the end [m], [rad].
    """
    if cell.config.mechanism.base is None or not truths or not states:
        return {}
    places = [truth.frames["base"] for truth in truths]
    travel = sum(math.dist(a[:2], b[:2]) for a, b in pairwise(places))
    true, told = places[-1], states[-1].frames["base"]
    return {
        "base_travel_m": travel,
        "odometry_error_m": math.dist(true[:2], told[:2]),
        "odometry_error_rad": abs(math.remainder(true[5] - told[5], 2.0 * math.pi)),
    }
