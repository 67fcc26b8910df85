"""Computed torque in the tool's space, with the null space of equal inertia.

    q̈* = q̈_0 + J̄ (ẍ* − J q̈_0),   q̈_0 = q̈_c + K_v (q̇_c − q̇) + K_n (q_c − q)
    ẍ* = ẍ_c + K_d (ẋ_c − ẋ) + K_p (x_c − x) − J̇ q̇,   τ = M q̈* + h + what is given beside

with `J̄ = M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹`: eq. 6 of Hamaguchi and Taniguchi, whose self-motion is not left to
itself. Where the tool cannot move, damping takes J̄ away and the joints' own law is what is left.
"""

import math

import numpy as np

from ..compiled import MATRIX, NUMBER, VECTOR, compiled
from ..spatial import Array

SWEEPS = 30
"""At most so many times Jacobi's rotations go over a matrix; six of them are usual."""

ROUNDING = 1e-30
"""Off-diagonal entries below this are rounding: sum of squares against the diagonal's [1]."""


@compiled(MATRIX, VECTOR)
def drift(J: Array, dq: Array) -> Array:
    """Return J̇ dq (6,): the tool's acceleration at constant joint rates [m/s², rad/s²].

    Of a chain with Jacobian J (6, n) at rates dq (n,): what a joint does to the tool is turned by
    the joints inboard of it and by itself, what those inboard do is stretched as much.
    """
    out = np.zeros(6)
    wx, wy, wz = 0.0, 0.0, 0.0  # how the joints inboard turn
    for j in range(len(dq)):
        vx, vy, vz = dq[j] * J[0, j], dq[j] * J[1, j], dq[j] * J[2, j]
        x, y, z = dq[j] * J[3, j], dq[j] * J[4, j], dq[j] * J[5, j]
        ax, ay, az = 2.0 * wx + x, 2.0 * wy + y, 2.0 * wz + z
        out[0] += ay * vz - az * vy
        out[1] += az * vx - ax * vz
        out[2] += ax * vy - ay * vx
        out[3] += wy * z - wz * y
        out[4] += wz * x - wx * z
        out[5] += wx * y - wy * x
        wx, wy, wz = wx + x, wy + y, wz + z
    return out


@compiled(MATRIX, VECTOR, NUMBER, NUMBER)
def damped(mobility: Array, wanted: Array, region: float, damping: float) -> Array:
    """Return the push (m,) that gives what a symmetric mobility (m, m) lets move as is `wanted`.

    Along an axis of mobility λ it is λ / (λ² + s²) of what is wanted (m,), with
    `s = damping · max(0, 1 − λ / region)`. The axes are found by Jacobi's rotations (Golub and
    Van Loan 2013, 8.5), which turn the matrix and what is wanted alike, and are then undone.
    """
    m = len(wanted)
    A, x, turns = np.empty((m, m)), np.empty(m), np.empty((SWEEPS, m, m, 2))
    for p in range(m):
        x[p] = wanted[p]
        for q in range(m):
            A[p, q] = mobility[p, q]
    sweeps = 0
    for sweep in range(SWEEPS):
        beside, size = 0.0, 0.0
        for p in range(m):
            size += A[p, p] ** 2
            for q in range(p):
                beside += A[p, q] ** 2
        if not beside > ROUNDING * size:
            break
        sweeps += 1
        for p in range(m):
            for q in range(p + 1, m):
                a = A[p, q]
                t = 0.0
                if a != 0.0:
                    t = 0.5 * (A[q, q] - A[p, p]) / a
                    t = math.copysign(1.0, t) / (abs(t) + math.sqrt(t * t + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                A[p, p] -= t * a
                A[q, q] += t * a
                A[p, q], A[q, p] = 0.0, 0.0
                for k in range(m):
                    if k != p and k != q:
                        u, v = A[k, p], A[k, q]
                        A[k, p], A[k, q] = c * u - s * v, s * u + c * v
                        A[p, k], A[q, k] = A[k, p], A[k, q]
                x[p], x[q] = c * x[p] - s * x[q], s * x[p] + c * x[q]
                turns[sweep, p, q, 0], turns[sweep, p, q, 1] = c, s
    for p in range(m):
        short = max(0.0, 1.0 - max(A[p, p], 0.0) / region)
        x[p] *= A[p, p] / (A[p, p] ** 2 + (damping * short) ** 2)
    for sweep in range(sweeps - 1, -1, -1):
        for p in range(m - 1, -1, -1):
            for q in range(m - 1, p, -1):
                c, s = turns[sweep, p, q, 0], turns[sweep, p, q, 1]
                x[p], x[q] = c * x[p] + s * x[q], c * x[q] - s * x[p]
    return x


@compiled(
    MATRIX, MATRIX, MATRIX, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR,
    NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER,
)  # fmt: skip
def acceleration(
    inverse: Array, J_c: Array, J: Array, error: Array,
    q_c: Array, dq_c: Array, dq_ahead: Array, q: Array, dq: Array, weight: Array,
    period_s: float, damping: float, stiffness: float, null_damping: float, null_stiffness: float,
    region: float, singular_damping: float,
) -> Array:  # fmt: skip
    """Return the joint accelerations (n,) [rad/s²] that bring tool and joints to the command.

    The joints are at q, dq (n,), the command (`_c`) is at q_c, dq_c and has rates `dq_ahead` one
    period on. J_c and J (6, n) are the tool's Jacobians there and here, `error` (6,) leads from
    here to there. `inverse` (n, n) is M⁻¹. `weight` (6,) says what a radian counts where the
    tool's mobility is judged against the `region` [1/kg].
    """
    n = len(q)
    ahead, own = np.empty(n), np.empty(n)
    for j in range(n):
        ahead[j] = (dq_ahead[j] - dq_c[j]) / period_s
        own[j] = ahead[j] + null_damping * (dq_c[j] - dq[j]) + null_stiffness * (q_c[j] - q[j])
    drift_c, tool = drift(J_c, dq_c), drift(J, dq)
    moved, mobility, wanted = np.zeros((6, n)), np.zeros((6, 6)), np.empty(6)
    for i in range(6):
        tool[i] = drift_c[i] - tool[i] + stiffness * error[i]
        for j in range(n):
            tool[i] += J_c[i, j] * (ahead[j] + damping * dq_c[j])
            tool[i] -= J[i, j] * (own[j] + damping * dq[j])
            for k in range(n):
                moved[i, j] += weight[i] * J[i, k] * inverse[k, j]
        for k in range(i + 1):
            for j in range(n):
                mobility[i, k] += moved[i, j] * J[k, j] * weight[k]
            mobility[k, i] = mobility[i, k]
        wanted[i] = weight[i] * tool[i]
    push = damped(mobility, wanted, region, singular_damping)
    for i in range(6):
        for j in range(n):
            own[j] += moved[i, j] * push[i]
    return own


@compiled(
    MATRIX, VECTOR, VECTOR,
    MATRIX, MATRIX, MATRIX, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR,
    NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER,
)  # fmt: skip
def computed_torque(
    M: Array, h: Array, beside: Array,
    inverse: Array, J_c: Array, J: Array, error: Array,
    q_c: Array, dq_c: Array, dq_ahead: Array, q: Array, dq: Array, weight: Array,
    period_s: float, damping: float, stiffness: float, null_damping: float, null_stiffness: float,
    region: float, singular_damping: float,
) -> Array:  # fmt: skip
    """Return the torques (n,) [N·m] of that `acceleration`: M (n, n) of it, h, and what is beside.

    h (n,) is what keeps the joints from accelerating, `beside` (n,) what is given on top.
    """
    ddq = acceleration(
        inverse, J_c, J, error, q_c, dq_c, dq_ahead, q, dq, weight,
        period_s, damping, stiffness, null_damping, null_stiffness, region, singular_damping,
    )  # fmt: skip
    tau = np.empty(len(h))
    for i in range(len(tau)):
        tau[i] = h[i] + beside[i]
        for j in range(len(tau)):
            tau[i] += M[i, j] * ddq[j]
    return tau
