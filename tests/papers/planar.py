"""The planar arm of the paper's example: three links of a metre, and one charge (section IV)."""

import numpy as np
from telerobot.server.control.mechanism.potentials import Potential, Strengths, Value, shape
from telerobot.server.control.spatial import Array

from .around import points
from .search import Place

LOWER, UPPER = -np.pi * np.ones(3), np.pi * np.ones(3)
START = np.array([0.0, np.pi / 2, -np.pi / 2])
K = 0.1
OBSTACLE = np.array([1.5, 1.3, 0.0])
PRINTED_MINIMUM = np.array([-0.36, 1.79, -1.07])
"""Of figure 4; it is none."""


def joints(q: Array) -> Array:
    """Return where shoulder, elbow, wrist and tip are (3, 4)."""
    a = np.cumsum(q)
    steps = np.stack([np.cos(a), np.sin(a), 0.0 * a])
    return np.hstack([np.zeros((3, 1)), np.cumsum(steps, axis=1)])


def jacobian(q: Array) -> Array:
    """Return J (6, 3) of the tip, about the tip."""
    at = joints(q)
    lever = at[:, -1:] - at[:, :3]
    return np.vstack([-lever[1], lever[0], np.zeros((3, 3)), np.ones(3)])


def manipulability(q: Array) -> float:
    """Return √det(J Jᵀ) of the two rows that a planar arm has."""
    J = jacobian(q)[:2]
    return float(np.sqrt(np.linalg.det(J @ J.T)))


def value(q: Array, k_limits: float = K) -> Value:
    """Return the potential of obstacle and joint limits, and its torque."""
    strengths = Strengths(K, 0.0, k_limits, 0.0)
    potential = Potential(LOWER, UPPER, np.array([1, 2, 3]), strengths, 0.0)
    at = joints(q)
    ends = np.stack([at[:, :3].T, at[:, 1:].T], axis=1)
    return potential.at(shape(q, jacobian(q), at[:, -1], ends), points(OBSTACLE))


def slope_of_manipulability(q: Array, h: float = 1e-6) -> Array:
    """∂w/∂q by central differences: of the two rows that a planar arm has."""
    return np.array(
        [(manipulability(q + h * e) - manipulability(q - h * e)) / (2 * h) for e in np.eye(3)]
    )


def look(q: Array) -> Place:
    """The place of a search that keeps the tip where it is in START."""
    found = value(q)
    return Place(
        error=(joints(START)[:, -1] - joints(q)[:, -1])[:2],
        J=jacobian(q)[:2],
        torque=found.torque + K * slope_of_manipulability(q),
        potential=found.total - K * manipulability(q),
    )


def projected(q: Array) -> Array:
    """Return Pτ (3,): the torque that moves the arm and not the tip."""
    here = look(q)
    return here.torque - np.linalg.pinv(here.J) @ here.J @ here.torque
