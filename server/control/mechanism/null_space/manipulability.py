"""Manipulability and its slope (Scott & Carignan 2008, eqs. 20–21).

w = √det(J Jᵀ), and its slope ∂w/∂q_k = w · tr((J Jᵀ)⁻¹ ∂_kJ Jᵀ). Rotations may weigh any length per
radian: that scales w and its slope by one constant, which is the gain's business.

For an arm that never reaches some axes, as a planar one, det(J Jᵀ) is always 0. Its w is the
product of the other singular values, √det on the axes that it reaches, and G the transposed
pseudo-inverse: the slope's law is the same while the rank is (Golub and Pereyra 1973). Where it
reaches fewer than six axes, w depends on the point that J is about.

The derivative of a serial chain's Jacobian is known in closed form: of two joints, the one nearer
to the base turns what the other does, ∂_k v_j = ω_min(j,k) × v_max(j,k), and ∂_k ω_j = ω_k × ω_j
for k < j, else 0. With G = (J Jᵀ)⁻¹ J, rows [g; h], the trace is G : ∂_kJ, and by the rules of the
triple product

    ω_k · Σ_{j≥k} (v_j × g_j + ω_j × h_j)  +  v_k · Σ_{j<k} (g_j × ω_j).
"""

import math
from typing import Final

import numpy as np

from ...compiled import MATRIX, NUMBER, ROW, TABLE, compiled
from ...spatial import Array
from ..svd import svd

REGULAR: Final = 1e-14
"""Added to J Jᵀ, so that the slope stays finite at a singularity [m²]."""


@compiled(MATRIX, TABLE)
def _solve(J: Array, G: Array) -> float:
    """Return w, and write G (6, n), of a Jacobian J (6, n), by elimination."""
    A = np.empty((6, 6))
    for i in range(6):
        for j in range(J.shape[1]):
            G[i, j] = J[i, j]
        for k in range(6):
            A[i, k] = REGULAR * (i == k)
            for j in range(J.shape[1]):
                A[i, k] += J[i, j] * J[k, j]
    w = 1.0
    for i in range(6):
        # No pivot can be less, but for rounding.
        A[i, i] = max(A[i, i], REGULAR)
        w *= math.sqrt(A[i, i])
        for k in range(i + 1, 6):
            part = A[k, i] / A[i, i]
            for j in range(i, 6):
                A[k, j] -= part * A[i, j]
            for j in range(J.shape[1]):
                G[k, j] -= part * G[i, j]
    for i in range(5, -1, -1):
        for j in range(J.shape[1]):
            for k in range(i + 1, 6):
                G[i, j] -= A[i, k] * G[k, j]
            G[i, j] /= A[i, i]
    return w


def slope(J: Array, rank: int = 6) -> tuple[float, Array]:
    """Return w of a chain's Jacobian J (6, n), and ∂w/∂q (n,): joint rates at gain 1.

    `rank` is how many axes the arm reaches anywhere [1].
    """
    found = np.zeros(J.shape[1])
    if rank == 6:
        return _climb(J, found), found
    w, G = _solved_where_reached(J, rank)
    _slope(J, w, G, found)
    return w, found


def _solved_where_reached(J: Array, rank: int) -> tuple[float, Array]:
    """Return w and G (6, n) of a Jacobian J (6, n) on as many axes as are reached."""
    U, s, Vt = svd(J)
    size2 = s[:rank] ** 2 + REGULAR
    w = math.sqrt(float(size2.prod()))
    return w, (U[:, :rank] * (s[:rank] / size2)) @ Vt[:rank]


@compiled(MATRIX, NUMBER, MATRIX, ROW)
def _slope(J: Array, w: float, G: Array, found: Array) -> None:
    """Write ∂w/∂q (n,) of a Jacobian J (6, n) with manipulability w and G (6, n)."""
    n = J.shape[1]
    x = y = z = 0.0
    for j in range(n):  # Σ_{j<k} g_j × ω_j
        found[j] = w * (J[0, j] * x + J[1, j] * y + J[2, j] * z)
        x += G[1, j] * J[5, j] - G[2, j] * J[4, j]
        y += G[2, j] * J[3, j] - G[0, j] * J[5, j]
        z += G[0, j] * J[4, j] - G[1, j] * J[3, j]
    x = y = z = 0.0
    for j in range(n - 1, -1, -1):  # Σ_{j≥k} v_j × g_j + ω_j × h_j
        for v in (0, 3):
            x += J[v + 1, j] * G[v + 2, j] - J[v + 2, j] * G[v + 1, j]
            y += J[v + 2, j] * G[v, j] - J[v, j] * G[v + 2, j]
            z += J[v, j] * G[v + 1, j] - J[v + 1, j] * G[v, j]
        found[j] += w * (J[3, j] * x + J[4, j] * y + J[5, j] * z)


@compiled(MATRIX, ROW)
def _climb(J: Array, found: Array) -> float:
    """Return w of a Jacobian J (6, n) that reaches all axes, and write ∂w/∂q (n,)."""
    G = np.empty(J.shape)
    w = _solve(J, G)
    _slope(J, w, G, found)
    return w
