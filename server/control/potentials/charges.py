"""What of a scene repels the links, as charges with strengths."""

from typing import NamedTuple

import numpy as np

from ..frames import Array
from ..scene import Scene


class Charges(NamedTuple):
    """What repels the links, in World; any array may have no columns."""

    points: Array
    """(3, c) [m]."""
    k_points: Array
    """(c,) [N·m]."""
    line_start: Array
    """Lines, uniformly charged (3, l) [m]."""
    line_end: Array
    k_lines: Array
    """Per metre of line (l,) [N]."""
    round_start: Array
    """Rounded segments: spheres, capsules, thick sight lines (3, s) [m]."""
    round_end: Array
    radius: Array
    k_round: Array
    """(s,) [N·m]."""
    box_centre: Array
    """(3, b) [m]."""
    box_axes: Array
    """In World, as columns (b, 3, 3)."""
    box_half: Array
    """(3, b) [m]."""
    k_boxes: Array
    """(b,) [N·m]."""

    @staticmethod
    def none() -> "Charges":
        """Return an empty world."""
        v, s = np.zeros((3, 0)), np.zeros(0)
        return Charges(v, s, v, v, s, v, v, s, s, v, np.zeros((0, 3, 3)), v, s)


def charges_of(scene: Scene, k: float, k_line: float) -> Charges:
    """Return the charges of a scene: points and solids of strength k [N·m], sight lines [N].

    A point has no size. A sight line without radius is a line; one with a radius is solid.
    """
    rounds, boxes = scene.rounds, scene.boxes
    thin = rounds.radius <= 0.0
    line = rounds.line & thin
    point = thin & ~rounds.line & (rounds.start == rounds.end).all(axis=1)
    solid = ~(line | point)
    start, end = rounds.start.T, rounds.end.T
    return Charges(
        start[:, point],
        np.full(int(point.sum()), k),
        start[:, line],
        end[:, line],
        np.full(int(line.sum()), k_line),
        start[:, solid],
        end[:, solid],
        rounds.radius[solid],
        np.full(int(solid.sum()), k),
        boxes.centre.T,
        boxes.R,
        boxes.half.T,
        np.full(len(boxes.half), k),
    )
