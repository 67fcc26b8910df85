"""Distances of points from what is solid in a scene: all pairs in one pass.

Sight lines are not solid. What may move counts as far out as it may be now.
"""

from typing import NamedTuple

import numpy as np

from ..frames import Array
from ..scene import Boxes, Rounds, Scene
from .distance import TOUCHING, dot


class Apart(NamedTuple):
    """How far s points are from k obstacles."""

    distance: Array
    """To the surfaces (s, k) [m]; below zero inside."""
    normal: Array
    """Away from them (s, k, 3): the slope of the distance; zero on the axis of a round one."""


def apart(points: Array, scene: Scene) -> Apart:
    """Return how far points (s, 3) [m] in World are from each solid obstacle."""
    solid = ~scene.rounds.line
    rounds = _from_rounds(points, scene.rounds)
    boxes = _from_boxes(points, scene.boxes)
    distance = np.concatenate([rounds.distance, boxes.distance], axis=1)
    normal = np.concatenate([rounds.normal, boxes.normal], axis=1)
    if scene.moves:
        distance = distance - scene.reach(0.0)
    if not solid.all():
        keep = np.concatenate([solid, np.ones(len(scene.boxes.half), dtype=bool)])
        distance, normal = distance[:, keep], normal[:, keep]
    return Apart(distance, normal)


def _from_rounds(points: Array, rounds: Rounds) -> Apart:
    way = rounds.end - rounds.start
    from_start = points[:, None, :] - rounds.start
    length2 = np.maximum(dot(way, way), TOUCHING**2)
    part = np.clip(dot(from_start, way) / length2, 0.0, 1.0)
    between = from_start - part[..., None] * way
    size = np.sqrt(dot(between, between))
    return Apart(size - rounds.radius, between / np.maximum(size, TOUCHING)[..., None])


def _from_boxes(points: Array, boxes: Boxes) -> Apart:
    x = np.einsum("bji,sbj->sbi", boxes.R, points[:, None, :] - boxes.centre)
    out = x - np.clip(x, -boxes.half, boxes.half)
    distance = np.sqrt(dot(out, out))
    normal = out / np.maximum(distance, TOUCHING)[..., None]
    inside = distance < TOUCHING
    if inside.any():
        # The shortest way out is through the nearest side.
        depth = boxes.half - np.abs(x)
        side = np.eye(3)[depth.argmin(axis=2)] * np.where(x < 0.0, -1.0, 1.0)
        distance = np.where(inside, -depth.min(axis=2), distance)
        normal = np.where(inside[..., None], side, normal)
    return Apart(distance, np.einsum("bij,sbj->sbi", boxes.R, normal))
