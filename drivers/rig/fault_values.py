"""Values and vectors of faults: within their bounds, or refused in one line."""

import numpy as np
from numpy.typing import NDArray

from ...protocols.messages.rig import RigFault

FARTHEST = 100.0
"""Nothing is put farther from World's origin along an axis [m]."""
MOST_FORCE = 5000.0
"""The physics is not pushed harder along an axis: it would break before the arm does [N]."""
MOST_FRICTION = 1e4
"""Nor is a joint braked harder [N·m]."""


def vector_of(fault: RigFault, most: float, unit: str) -> NDArray[np.float64]:
    """Return a fault's vector (3,), in World.

    Raises `ValueError`, in one line, for none, and for one beyond `most` along an axis.
    """
    if fault.vector is None:
        raise ValueError(f"fault {fault.kind}: give its vector [{unit}], in World")
    for x in fault.vector:
        if not abs(x) <= most:
            raise ValueError(
                f"fault {fault.kind}: value {x:g} {unit}: must be at most {most:g} along an axis"
            )
    return np.array(fault.vector)


def value_of(
    fault: RigFault, low: float, high: float, unit: str, default: float | None = None
) -> float:
    """Return a fault's value, or the default. Raises `ValueError` for one out of bounds."""
    value = default if fault.value is None else fault.value
    if value is None or not low <= value <= high:
        raise ValueError(f"fault {fault.kind}: value {value:g} {unit}: must be {low:g} to {high:g}")
    return value
