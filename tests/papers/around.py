"""Scenes made by hand, and what they do to one link."""

import numpy as np
from numpy.typing import ArrayLike
from telerobot.server.control.compiled import evolve
from telerobot.server.control.mechanism.potentials import push
from telerobot.server.control.scene import Boxes, Rounds, Scene, empty
from telerobot.server.control.spatial import Array


def rounds(start: ArrayLike, end: ArrayLike, radius: ArrayLike, line: bool = False) -> Scene:
    """Return a scene of segments (o, 3) with radii; `line` where they are sight lines."""
    start, end = np.atleast_2d(start), np.atleast_2d(end)
    radius = np.broadcast_to(np.asarray(radius, dtype=float), len(start))
    flags = np.full(len(start), line)
    found = Rounds(start, end, radius, flags, np.full(len(start), -1))
    return evolve(empty(), rounds=found)


def points(at: ArrayLike) -> Scene:
    """Return a scene of points (o, 3)."""
    return rounds(at, at, 0.0)


def lines(start: ArrayLike, end: ArrayLike) -> Scene:
    """Return a scene of sight lines (o, 3)."""
    return rounds(start, end, 0.0, line=True)


def boxes(R: Array, centre: Array, half: Array) -> Scene:
    """Return a scene of boxes, turned by R (o, 3, 3)."""
    return evolve(empty(), boxes=Boxes(R, centre, half))


def acting(
    scene: Scene, p1: Array, p2: Array, least: float, smooth: bool = True
) -> tuple[Array, Array, float]:
    """Return force, moment about World's origin and potential of a link, at strengths of 1.

    The link is borne by six joints: the unit twists at World's origin.
    """
    around = (scene.solids, 1.0, 1.0, least, smooth)
    torque, potential = push(np.eye(6), np.array([[p1, p2]]), np.array([6]), *around)
    return torque[:3], torque[3:], potential
