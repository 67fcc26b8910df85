"""Search, by other means, of a posture in which an arm on a base passes below a bridge.

Random postures and steps downhill from the best, with forward kinematics of its own, on the true
geometry: what projects on a plane across the way must not overlap. No grid, no cells, no scanner.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DRAWN: Final = 20_000
"""Random postures [1]."""
BEST: Final = 30
"""The best of them are improved [1]."""
STEPS: Final = 60
"""Steps of each [1]."""


class FoldingArm(NamedTuple):
    """Axes z y z y … from the foot upwards; lengths between shoulder, elbow, wrist and tool."""

    shoulder: float
    upper: float
    fore: float
    hand: float
    most: tuple[float, float, float, float]
    """Ranges of the first four joints either way [rad]."""
    radius: float
    """Of the housings [m]."""
    half_width: float
    """Half of what carries the arm [m]."""


class Opening(NamedTuple):
    """The opening as it projects: between pillars, below the beam; from the arm's foot [m]."""

    left: float
    right: float
    top: float
    """Underside of the beam."""
    over: float
    """Upper side of the beam: what is higher passes above."""


def gate_of(
    height: float, width: float, thickness: float, side: float, skew: float, offset: float
) -> Opening:
    """Return the opening of a bridge that is turned by `skew` [rad]; heights from the foot [m].

    `offset` is of its near face's middle: the far edge of one pillar reaches into the opening.
    """
    far = thickness * math.sin(skew)
    half = 0.5 * width * math.cos(skew)
    left, right = offset + half + min(far, 0.0), offset - half + max(far, 0.0)
    return Opening(left, right, height, height + side)


def room(q: Array, arm: FoldingArm, gate: Opening) -> Array:
    """Return how far housings stay from the gate at postures q (s, 4) [m]; negative inside."""
    c1, s1, c2, s2 = np.cos(q[:, 0]), np.sin(q[:, 0]), np.cos(q[:, 1]), np.sin(q[:, 1])
    c3, s3, c4, s4 = np.cos(q[:, 2]), np.sin(q[:, 2]), np.cos(q[:, 3]), np.sin(q[:, 3])
    up_y, up_z = s1 * s2, c2
    # The forearm in the upper arm's axes: (c3 s4, s3 s4, c4), turned by y(q2) and z(q1).
    ahead, across, along = c3 * s4, s3 * s4, c4
    fore_y = s1 * (c2 * ahead + s2 * along) + c1 * across
    fore_z = -s2 * ahead + c2 * along
    shoulder_z = np.full(len(q), arm.shoulder)
    elbow_y, elbow_z = arm.upper * up_y, shoulder_z + arm.upper * up_z
    reach = arm.fore + arm.hand
    tool_y, tool_z = elbow_y + reach * fore_y, elbow_z + reach * fore_z
    y = np.stack([np.zeros(len(q)), elbow_y, tool_y])
    z = np.stack([shoulder_z, elbow_z, tool_z])
    found = np.minimum(gate.left - y, y - gate.right).min(axis=0)
    below = (gate.top - z).min(axis=0)
    above_deck = z.min(axis=0) - arm.radius
    found = np.minimum(found, np.minimum(below, above_deck + arm.radius))
    return np.asarray(found - arm.radius)


def passable(arm: FoldingArm, gate: Opening, clearance: float, seed: int = 0) -> bool:
    """Return whether base, column and some posture pass with a clearance to spare [m]."""
    if min(gate.left, -gate.right) < arm.half_width + clearance:
        return False
    if gate.top < arm.shoulder + arm.radius + clearance:
        return False
    draw, most = np.random.default_rng(seed), np.array(arm.most)
    q = draw.uniform(-most, most, (DRAWN, 4))
    value = room(q, arm, gate)
    best = np.argsort(value)[-BEST:]
    q, value, width = q[best], value[best], 0.3
    for _ in range(STEPS):
        near = np.clip(q + width * draw.normal(size=q.shape), -most, most)
        tried = room(near, arm, gate)
        better = tried > value
        q[better], value[better] = near[better], tried[better]
        width *= 0.95
    return bool(value.max() >= clearance)
