"""Joint rates that keep barriers to rounding, whatever a solver made of them.

Standing keeps every barrier A dq ≥ b with b ≤ 0, so there are always rates that do: the nearest to
given ones solve a least distance programme, min ‖x‖ with G x ≥ h, by non-negative least squares
(Lawson and Hanson, Solving Least Squares Problems, 1974, chapter 23). Where barriers oppose each
other to within rounding, what is still broken is mended by slowing towards standing.
"""

import math

import numpy as np

from ..compiled import MATRIX, VECTOR, compiled, inner_kernel
from ..spatial import Array

KEPT = 1e-9
"""A barrier that is broken by less than this is kept [m/s]."""

_AIM = 1e-10
"""Rates are mended until no barrier is broken by more [m/s]."""

_REFINED = 4
"""Passes that mend rates: barriers that nearly oppose each other multiply rounding [1]."""

_POSITIVE = 1e-13
"""A gradient below this is rounding, with columns of unit size [1]."""


@compiled(MATRIX, VECTOR, VECTOR)
def violation(A: Array, least: Array, dq: Array) -> float:
    """Return by how much rates dq (n,) break the worst of A dq ≥ min(least, 0) (m,) [m/s].

    Infinite where anything is not a number.
    """
    worst = 0.0
    for i in range(len(least)):
        rate = 0.0
        for j in range(len(dq)):
            rate += A[i, j] * dq[j]
        short = min(least[i], 0.0) - rate
        if not short <= worst:
            worst = short if short > worst else np.inf
    for j in range(len(dq)):
        if not math.isfinite(dq[j]):
            worst = np.inf
    return worst


@inner_kernel
def _least_squares(E: Array, target: Array) -> Array:
    """Return the x (k,) with the least ‖E x − target‖, E (r, k) of full rank or nearly so.

    By Householder reflections. Nearly dependent columns get a part of nothing.
    """
    rows, k = E.shape
    R, y, x = np.empty((rows, k)), np.empty(rows), np.zeros(k)
    for i in range(rows):
        y[i] = target[i]
        for c in range(k):
            R[i, c] = E[i, c]
    v = np.empty(rows)
    for c in range(k):
        size = 0.0
        for i in range(c, rows):
            size += R[i, c] * R[i, c]
        size = math.sqrt(size)
        if size == 0.0:
            continue
        alpha = -math.copysign(size, R[c, c])
        for i in range(c, rows):
            v[i] = R[i, c]
        v[c] -= alpha
        length = 0.0
        for i in range(c, rows):
            length += v[i] * v[i]
        for other in range(c, k):
            along = 0.0
            for i in range(c, rows):
                along += v[i] * R[i, other]
            along *= 2.0 / length
            for i in range(c, rows):
                R[i, other] -= along * v[i]
        along = 0.0
        for i in range(c, rows):
            along += v[i] * y[i]
        along *= 2.0 / length
        for i in range(c, rows):
            y[i] -= along * v[i]
    for c in range(k - 1, -1, -1):
        value = y[c]
        for other in range(c + 1, k):
            value -= R[c, other] * x[other]
        x[c] = value / R[c, c] if abs(R[c, c]) > 1e-14 else 0.0
    return x


@inner_kernel
def least_distance(G: Array, h: Array) -> Array:
    """Return the shortest x (n,) with G x ≥ h (m,), rows of G of unit size or zero.

    Not a number where there is none.
    """
    m, n = G.shape
    E, residual = np.empty((n + 1, m)), np.zeros(n + 1)
    for i in range(m):
        for j in range(n):
            E[j, i] = G[i, j]
        E[n, i] = h[i]
    goal = np.zeros(n + 1)
    goal[n] = residual[n] = 1.0
    u, passive, count = np.zeros(m), np.empty(n + 1, dtype=np.int64), 0
    inside = np.zeros(m, dtype=np.bool_)
    barred = np.zeros(m, dtype=np.bool_)
    for _ in range(3 * (m + n)):
        entering, most = -1, _POSITIVE
        for i in range(m):
            if inside[i] or barred[i]:
                continue
            slope = 0.0
            for j in range(n + 1):
                slope += E[j, i] * residual[j]
            if slope > most:
                entering, most = i, slope
        if entering < 0 or count > n:
            break
        passive[count], inside[entering] = entering, True
        count += 1
        first = True
        while count > 0:
            columns = np.empty((n + 1, count))
            for c in range(count):
                for j in range(n + 1):
                    columns[j, c] = E[j, passive[c]]
            found = _least_squares(columns, goal)
            if first and found[count - 1] <= 0.0:  # rounding: this column leads nowhere
                count -= 1
                inside[entering], barred[entering] = False, True
                break
            if first:
                first = False
                for i in range(m):
                    barred[i] = False
            part, worst = 1.0, -1
            for c in range(count):
                if found[c] <= 0.0:
                    before = u[passive[c]]
                    way = before / max(before - found[c], 1e-300)
                    if way < part or worst < 0:
                        part, worst = min(part, way), c
            for c in range(count):
                i = passive[c]
                u[i] += part * (found[c] - u[i])
            if worst < 0:
                break
            left = 0
            for c in range(count):
                i = passive[c]
                if c == worst or u[i] <= 0.0:
                    u[i], inside[i] = 0.0, False
                else:
                    passive[left] = i
                    left += 1
            count = left
        for j in range(n + 1):
            residual[j] = goal[j]
            for c in range(count):
                residual[j] -= E[j, passive[c]] * u[passive[c]]
    x = np.empty(n)
    for j in range(n):
        x[j] = -residual[j] / residual[n] if residual[n] > _POSITIVE else np.nan
    return x


@inner_kernel
def _cholesky(M: Array) -> Array:
    """Return the lower triangular L (n, n) with L Lᵀ = M, positive definite."""
    n = len(M)
    L = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            left = M[i, j]
            for k in range(j):
                left -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(max(left, 1e-300)) if i == j else left / L[j, j]
    return L


@inner_kernel
def _nearest_in(G: Array, h: Array, L: Array) -> Array:
    """Return the x (n,) with the least xᵀ L Lᵀ x and G x ≥ h (m,); L (n, n) lower triangular."""
    m, n = G.shape
    turned, bound = np.zeros((m, n)), np.zeros(m)
    for i in range(m):
        size = 0.0
        for j in range(n):
            left = G[i, j]
            for k in range(j):
                left -= L[j, k] * turned[i, k]
            turned[i, j] = left / L[j, j]
            size += turned[i, j] * turned[i, j]
        size = math.sqrt(size)
        if size > 0.0:
            bound[i] = h[i] / size
            for j in range(n):
                turned[i, j] /= size
    x = least_distance(turned, bound)
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            x[j] -= L[k, j] * x[k]
        x[j] /= L[j, j]
    return x


@compiled(VECTOR, MATRIX, VECTOR, VECTOR, VECTOR, MATRIX)
def settled(
    dq: Array, A: Array, least: Array, low: Array, high: Array, M: Array
) -> tuple[Array, float]:
    """Return the rates nearest to dq (n,) with A dq ≥ min(least, 0) (m,), low ≤ dq ≤ high (n,).

    And the share (0 to 1) to which they were slowed towards standing, which is within low to high.
    How near rates are is measured by M (n, n), positive definite; all rates in rad/s.
    """
    m, n = A.shape
    G, bound, h = np.zeros((m + 2 * n, n)), np.zeros(m + 2 * n), np.zeros(m + 2 * n)
    for i in range(m):
        size = 0.0
        for j in range(n):
            size += A[i, j] * A[i, j]
        size = math.sqrt(size)
        if size > 0.0:
            bound[i] = min(least[i], 0.0) / size
            for j in range(n):
                G[i, j] = A[i, j] / size
    found, L = np.empty(n), _cholesky(M)
    for j in range(n):
        G[m + j, j], bound[m + j] = 1.0, low[j]
        G[m + n + j, j], bound[m + n + j] = -1.0, -high[j]
        found[j] = dq[j]
    for turn in range(_REFINED):
        worst = 0.0
        for i in range(m + 2 * n):
            h[i] = bound[i]
            for j in range(n):
                h[i] -= G[i, j] * found[j]
            worst = max(worst, h[i])
        if worst <= _AIM:
            break
        change = _nearest_in(G, h, L) if turn == 0 else least_distance(G, h)
        for j in range(n):
            if math.isfinite(change[j]):
                found[j] += change[j]
    share = 1.0
    for j in range(n):
        found[j] = min(max(found[j], low[j]), high[j])
    for i in range(m):
        rate, kept = 0.0, min(least[i], 0.0) - _AIM
        for j in range(n):
            rate += A[i, j] * found[j]
        if rate < kept:
            share = min(share, kept / rate)
    for j in range(n):
        found[j] *= share
    return found, share
