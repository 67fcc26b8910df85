"""Linear algebra of small matrices and vectors inside kernels."""

import math

import numpy as np

from .compiled import MATRIX, NUMBER, ROW, TABLE, compiled, inner_kernel
from .spatial import Array

# --- Vectors (3,) as plain tuples: unlike arrays, nothing counts their holders --------------------

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


# --- Singular values of a small matrix, by one-sided Jacobi rotations (Hestenes 1958) -------------
#
# Rotations make the rows of a matrix orthogonal, pair by pair: Uᵀ A = S Vᵀ. For a Jacobian of six
# rows and up to twelve columns that takes 0.6 to 0.8 of LAPACK's time inside a kernel, half of it
# when caches are cold, and needs no SciPy, which Numba's LAPACK does; at thirty columns LAPACK is
# quicker. A small singular value comes out with all the digits that the matrix gives it (Demmel and
# Veselić 1992).

_ORTHOGONAL = 1e-15
"""Rows whose cosine is below this are orthogonal [1]."""

_NOTHING = 1e-15
"""Rows below this part of the whole matrix are rounding: singular values of zero [1]."""

_PASSES = 40
"""Far more passes over all pairs of rows than any matrix takes; six are usual [1]."""


@inner_kernel
def _size(rows: Array, i: int) -> float:
    total = 0.0
    for k in range(rows.shape[1]):
        total += rows[i, k] * rows[i, k]
    return math.sqrt(total)


@inner_kernel
def _orthogonal_rows(A: Array, length: float) -> tuple[Array, Array, Array]:
    """Return an orthogonal U (m, m), Uᵀ A (m, n), whose rows are orthogonal, and their sizes.

    Of A weighted as in `svd`.
    """
    m, n = A.shape
    rows, U, size = np.empty((m, n)), np.zeros((m, m)), np.empty(m)
    for i in range(m):
        U[i, i] = 1.0
        for k in range(n):
            rows[i, k] = A[i, k] if i < 3 else length * A[i, k]
    for _ in range(_PASSES):
        whole = 0.0
        for i in range(m):
            size[i] = _size(rows, i)
            whole += size[i] * size[i]
        nothing, still = _NOTHING * math.sqrt(whole), True
        for i in range(m):
            for j in range(i + 1, m):
                along = 0.0
                for k in range(n):
                    along += rows[i, k] * rows[j, k]
                if abs(along) <= _ORTHOGONAL * max(size[i], nothing) * max(size[j], nothing):
                    continue
                still = False
                skew = (size[j] * size[j] - size[i] * size[i]) / (2.0 * along)
                tangent = math.copysign(1.0, skew) / (abs(skew) + math.sqrt(1.0 + skew * skew))
                c = 1.0 / math.sqrt(1.0 + tangent * tangent)
                s = c * tangent
                for k in range(n):
                    a, b = rows[i, k], rows[j, k]
                    rows[i, k], rows[j, k] = c * a - s * b, s * a + c * b
                for k in range(m):
                    a, b = U[k, i], U[k, j]
                    U[k, i], U[k, j] = c * a - s * b, s * a + c * b
                size[i], size[j] = _size(rows, i), _size(rows, j)
        if still:
            break
    return U, rows, size


@inner_kernel
def _complete(basis: Array, count: int) -> None:
    """Make the next row of a basis (n, n) a unit vector that is orthogonal to the first ones."""
    n = len(basis)
    best, most = 0, -1.0
    for k in range(n):
        left = 1.0
        for row in range(count):
            left -= basis[row, k] * basis[row, k]
        if left > most:
            best, most = k, left
    for k in range(n):
        basis[count, k] = 1.0 if k == best else 0.0
    for _ in range(2):  # the second time takes off what rounding left
        for row in range(count):
            along = 0.0
            for k in range(n):
                along += basis[row, k] * basis[count, k]
            for k in range(n):
                basis[count, k] -= along * basis[row, k]
    size = _size(basis, count)
    for k in range(n):
        basis[count, k] /= size


def svd(A: Array, length: float = 1.0) -> tuple[Array, Array, Array]:
    """Return U (m, m), the singular values (r,), largest first, and Vt (n, n) of a matrix (m, n).

    A = U[:, :r] diag(s) Vt[:r], r = min(m, n); U and Vt are orthogonal. As `numpy.linalg.svd`. Rows
    from the fourth on, the rotations of a Jacobian, weigh `length` [m/rad].
    """
    m, n = A.shape
    U, s, Vt = np.empty((m, m)), np.zeros(min(m, n)), np.zeros((n, n))
    _decompose(A, length, U, s, Vt)
    return U, s, Vt


@compiled(MATRIX, NUMBER, TABLE, ROW, TABLE)
def _decompose(A: Array, length: float, U: Array, s: Array, Vt: Array) -> None:
    """Write what `svd` returns; s and Vt are zeros before."""
    m, n = A.shape
    r = min(m, n)
    made, rows, size = _orthogonal_rows(A, length)
    for i in range(m):
        largest = 0
        for k in range(m):
            if size[k] > size[largest]:
                largest = k
        for k in range(m):
            U[k, i] = made[k, largest]
        if i < r:
            s[i] = size[largest]
            if s[i] > _NOTHING * s[0]:
                for k in range(n):
                    Vt[i, k] = rows[largest, k] / s[i]
            else:
                _complete(Vt, i)
        size[largest] = -1.0
    for i in range(r, n):
        _complete(Vt, i)
