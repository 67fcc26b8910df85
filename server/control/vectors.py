"""Vectors (3,) as plain tuples, from kernel to kernel: unlike arrays, nothing counts holders."""

import math

from .compiled import inner_kernel
from .spatial import Array

Vector = tuple[float, float, float]
Rows = tuple[Vector, Vector, Vector]
"""The rows of a matrix (3, 3)."""


@inner_kernel
def row_of(A: Array, i: int) -> Vector:
    """Return row i of the first three columns of A (n, 3 or more)."""
    return A[i, 0], A[i, 1], A[i, 2]


@inner_kernel
def rows_of(R: Array) -> Rows:
    """Return the rows of R (3, 3), or of the attitude of a frame (3, 4)."""
    return row_of(R, 0), row_of(R, 1), row_of(R, 2)


@inner_kernel
def dot(a: Vector, b: Vector) -> float:
    """Return a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner_kernel
def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inner_kernel
def minus(a: Vector, b: Vector) -> Vector:
    """Return a − b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner_kernel
def further(a: Vector, t: float, u: Vector) -> Vector:
    """Return a + t u."""
    return a[0] + t * u[0], a[1] + t * u[1], a[2] + t * u[2]


@inner_kernel
def times(s: float, a: Vector) -> Vector:
    """Return s a."""
    return s * a[0], s * a[1], s * a[2]


@inner_kernel
def norm(a: Vector) -> float:
    """Return |a|."""
    return math.sqrt(dot(a, a))


@inner_kernel
def turned(R: Rows, a: Vector) -> Vector:
    """Return R a."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


@inner_kernel
def turned_back(R: Rows, a: Vector) -> Vector:
    """Return Rᵀ a."""
    return further(further(times(a[0], R[0]), a[1], R[1]), a[2], R[2])
