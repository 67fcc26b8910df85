"""The potential of an arm and its slope: obstacles, joint limits, manipulability; its flow."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..axes import HeldAxes
from ..compiled import (
    ARRAY3,
    FLAG,
    FLAGS,
    INDEX,
    MATRIX,
    NUMBER,
    ROW,
    STACK,
    TABLE,
    VECTOR,
    XYZ,
    compiled,
    inner_kernel,
    record,
)
from ..linalg import (
    Vector,
    cross,
    dot,
    further,
    minus,
    norm,
    row_of,
    rows_of,
    svd,
    times,
    turned,
    turned_back,
)
from ..scene import Flags, Scene
from ..spatial import Array, rotation_exp

# --- Manipulability and its slope (Scott & Carignan 2008, eqs. 20–21) -----------------------------
#
# w = √det(J Jᵀ), and its slope ∂w/∂q_k = w · tr((J Jᵀ)⁻¹ ∂_kJ Jᵀ). Rotations may weigh any
# length per radian: that scales w and its slope by one constant, which is the gain's business.
#
# For an arm that never reaches some axes, as a planar one, det(J Jᵀ) is always 0. Its w is the
# product of the other singular values, √det on the axes that it reaches, and G the transposed
# pseudo-inverse: the slope's law is the same while the rank is (Golub and Pereyra 1973). Where
# it reaches fewer than six axes, w depends on the point that J is about.
#
# Of a task that leaves axes free, it is the same of the rows that are held, at the MRF. They turn
# with the tool: of A = keep J, ∂_k(keep) J = ω_k × A − keep (ω_k × J), for v and ω alike.
#
# The derivative of a serial chain's Jacobian is known in closed form: of two joints, the one
# nearer to the base turns what the other does, ∂_k v_j = ω_min(j,k) × v_max(j,k), and ∂_k ω_j =
# ω_k × ω_j for k < j, else 0. With G = (J Jᵀ)⁻¹ J, rows [g; h], the trace is G : ∂_kJ, and by
# the rules of the triple product
#
#     ω_k · Σ_{j≥k} (v_j × g_j + ω_j × h_j)  +  v_k · Σ_{j<k} (g_j × ω_j).

REGULAR: Final = 1e-14
"""Added to J Jᵀ, so that the slope stays finite at a singularity [m²]."""


@inner_kernel
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


def manipulability_slope(
    J: Array, rank: int = 6, held: HeldAxes | None = None
) -> tuple[float, Array]:
    """Return w of a chain's Jacobian J (6, n), and ∂w/∂q (n,): joint rates at gain 1.

    `rank` is how many axes the arm reaches anywhere [1]; `held` which the task holds; None: all.
    """
    if held is not None:
        w, G = _solved_where_reached(held.rows(J), held.rank)
        return w, slope_of(J, w * G, held)
    found = np.zeros(J.shape[1])
    if rank == 6:
        return _climb(J, found), found
    w, G = _solved_where_reached(J, rank)
    _slope(J, w, G, found)
    return w, found


def slope_of(J: Array, F: Array, held: HeldAxes | None = None) -> Array:
    """Return ∂f/∂q (n,) of a function f of a chain's Jacobian J (6, n), from F = ∂f/∂J (6, n).

    Of a function of the rows that are `held`, F (6, n + f) is ∂f/∂rows.
    """
    found = np.zeros(J.shape[1])
    if held is None:
        _slope(J, 1.0, F, found)
        return found
    G = held.keep @ F[:, : J.shape[1]]
    _slope(J, 1.0, G, found)
    return found + J[3:].T @ (_turned_by(held.rows(J), F) - _turned_by(J, G))


@compiled(MATRIX, MATRIX)
def _turned_by(J: Array, F: Array) -> Array:
    """Return ∂f/∂φ (3,) of a function of columns J (6, m) that turn, from F = ∂f/∂J (6, m)."""
    found = np.zeros(3)
    for j in range(J.shape[1]):  # Σ v × f + ω × m
        found[0] += J[1, j] * F[2, j] - J[2, j] * F[1, j] + (J[4, j] * F[5, j] - J[5, j] * F[4, j])
        found[1] += J[2, j] * F[0, j] - J[0, j] * F[2, j] + (J[5, j] * F[3, j] - J[3, j] * F[5, j])
        found[2] += J[0, j] * F[1, j] - J[1, j] * F[0, j] + (J[3, j] * F[4, j] - J[4, j] * F[3, j])
    return found


def _solved_where_reached(J: Array, rank: int) -> tuple[float, Array]:
    """Return w and G (6, n) of a Jacobian J (6, n) on as many axes as are reached."""
    U, s, Vt = svd(J)
    size2 = s[:rank] ** 2 + REGULAR
    w = math.sqrt(float(size2.prod()))
    return w, (U[:, :rank] * (s[:rank] / size2)) @ Vt[:rank]


@compiled(MATRIX, NUMBER, MATRIX, ROW)
def _slope(J: Array, w: float, G: Array, found: Array) -> None:
    """Write w tr(Gᵀ ∂_kJ) (n,) of a Jacobian J (6, n) with manipulability w and G (6, n)."""
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


# --- How much the potential bends along a self-motion ---------------------------------------------

_REGULAR: Final = 1e-9
"""Added to J Jᵀ, so that its inverse stays finite at a singularity [m²]."""


@compiled(MATRIX, VECTOR)
def weighed(J: Array, b: Array) -> Array:
    """Return (J Jᵀ)⁻¹ b (m,) of a Jacobian J (m, n), finite at a singularity too."""
    m, x = len(b), b.copy()
    A = np.empty((m, m))
    for i in range(m):
        for k in range(m):
            A[i, k] = _REGULAR * (i == k)
            for j in range(J.shape[1]):
                A[i, k] += J[i, j] * J[k, j]
    for i in range(m):
        # No pivot can be less, but for rounding.
        A[i, i] = max(A[i, i], _REGULAR)
        for k in range(i + 1, m):
            part = A[k, i] / A[i, i]
            x[k] -= part * x[i]
            for j in range(i, m):
                A[k, j] -= part * A[i, j]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            x[i] -= A[i, k] * x[k]
        x[i] /= A[i, i]
    return x


@compiled(VECTOR, MATRIX, VECTOR, MATRIX, VECTOR, NUMBER)
def curvature(
    way: Array, J: Array, torque: Array, J_ahead: Array, torque_ahead: Array, step: float
) -> float:
    """Return the curvature of V along the self-motion that starts in direction `way` (n,).

    Jacobians (m, n) and torques −∂V/∂q (n,) are those here and a small `step` [rad] straight ahead.
    What the straight way leaves the tool's pose by counts too: with λ = (JJᵀ)⁻¹Jτ, the force that
    holds the tool, the curvature is −[(τ' − τ)·d − λ·J'd] / step [N·m/rad].
    """
    m, n = J.shape
    pull = np.zeros(m)
    for i in range(m):
        for j in range(n):
            pull[i] += J[i, j] * torque[j]
    hold, change = weighed(J, pull), 0.0
    for j in range(n):
        bend = torque_ahead[j] - torque[j]
        for i in range(m):
            bend -= hold[i] * (J_ahead[i, j] - J[i, j])
        change += bend * way[j]
    return -change / step


# --- A chain at one posture: its joints as screws and its links as segments, all about World's
# origin
#
# A small way ahead along a joint motion needs no kinematics: link ends move by the joints'
# twists, and a screw is turned by the twist of the body that carries it, dS_i = [Σ_{j<i} S_j
# dq_j, S_i].

Index = NDArray[np.int64]


class Shape(NamedTuple):
    """n joints and m links at one posture."""

    q: Array
    """(n,) [rad]."""
    screws: Array
    """Twist of a joint's rate (6, n), taken at World's origin: `[v; ω]`."""
    ends: Array
    """Both ends of the links, in World (m, 2, 3) [m]."""
    tool: Array
    """Where the tool's point is, in World (3,) [m]."""


def shape(q: Array, J: Array, p: Array, ends: Array) -> Shape:
    """Return the shape at q (n,), with the Jacobian J (6, n) of the tool's point p (3,) in World.

    `ends` (m, 2, 3) are the links' ends in World.
    """
    return Shape(q, screws(J, p), ends, p)


def ahead(at: Shape, body: Index, way: Array, step: float) -> Shape:
    """Return the shape a small `step` ahead along joint rates `way` (n,), to first order.

    `body` (m,) counts the joints inboard of each link.
    """
    there = Shape(
        np.empty(at.q.shape), np.empty(at.screws.shape), np.empty(at.ends.shape), np.empty(3)
    )
    _move(at.q, at.screws, at.ends, at.tool, body, way, step, *there)
    return there


def screws(J: Array, p: Array) -> Array:
    """Return twists (6, n) at World's origin of joints whose Jacobian at p (3,) is J (6, n)."""
    found = np.empty(J.shape)
    _twist(J, p, found)
    return found


@compiled(MATRIX, VECTOR, TABLE)
def _twist(J: Array, p: Array, found: Array) -> None:
    for j in range(J.shape[1]):
        w = (J[3, j], J[4, j], J[5, j])
        # How the point of each body moves that is at World's origin.
        lever = cross((p[0], p[1], p[2]), w)
        for i in range(3):
            found[i, j] = J[i, j] + lever[i]
            found[3 + i, j] = w[i]


@compiled(VECTOR, MATRIX, ARRAY3, VECTOR, INDEX, VECTOR, NUMBER, ROW, TABLE, STACK, ROW)
def _move(
    q: Array,
    S: Array,
    ends: Array,
    tool: Array,
    body: Index,
    way: Array,
    step: float,
    angles: Array,
    turned: Array,
    shifted: Array,
    moved: Array,
) -> None:
    """Write angles, screws, ends and tool of a shape after a small step."""
    n = len(q)
    twist = np.zeros((n + 1, 6))  # of each body, over the step
    for j in range(n):
        angles[j] = q[j] + step * way[j]
        v, w = (S[0, j], S[1, j], S[2, j]), (S[3, j], S[4, j], S[5, j])
        V = (twist[j, 0], twist[j, 1], twist[j, 2])
        W = (twist[j, 3], twist[j, 4], twist[j, 5])
        dv, vw, dw = cross(W, v), cross(V, w), cross(W, w)
        for i in range(3):
            turned[i, j] = v[i] + dv[i] + vw[i]
            turned[3 + i, j] = w[i] + dw[i]
            twist[j + 1, i] = V[i] + step * way[j] * v[i]
            twist[j + 1, 3 + i] = W[i] + step * way[j] * w[i]
    for link in range(len(ends)):
        b = body[link]
        W = (twist[b, 3], twist[b, 4], twist[b, 5])
        for e in range(2):
            x = (ends[link, e, 0], ends[link, e, 1], ends[link, e, 2])
            dx = cross(W, x)
            for i in range(3):
                shifted[link, e, i] = x[i] + twist[b, i] + dx[i]
    W = (twist[n, 3], twist[n, 4], twist[n, 5])
    dx = cross(W, (tool[0], tool[1], tool[2]))
    for i in range(3):
        moved[i] = tool[i] + twist[n, i] + dx[i]


# --- Forces and moments of obstacles on the links, their joint torques, and their potential -------
#
# A link is a segment that is charged along its length: Scott & Carignan, "A Line-Based Obstacle
# Avoidance Technique for Dexterous Manipulator Operations", eqs. 11–16. It meets
#
# - a point, which acts on the whole link in closed form, V = k ∫ ds/r;
# - a sight line without radius, charged as well. The paper has it stand for its point closest to
#   each link, and reports that this jumps where the two are parallel. Here the link is taken apart
#   instead, into the points of a Gauss–Legendre rule, and each meets the whole line in closed form;
# - a solid, which acts on the same points from its surface, by the distance to it: V = k / d. The
#   nearest point of a convex body moves steadily and the slope of a distance is its normal, so that
#   the field is smooth and the torques are the exact slope of the potential.
#
# The closed form loses no precision anywhere. The printed ones are differences of large numbers
# as c, the distance from the charge to the link's line, falls to zero. With r1, r2 from the
# charge to the link's ends, u along the link, r⊥ the way from the charge to the link's line, L
# the length and S = |r1||r2| + r1·r2:
#
#     F  = k [ r⊥ L (|r1| + |r2|) / (|r1||r2| S)  +  u (|r2| − |r1|) / (|r1||r2|) ]
#     M1 = k (u × r⊥) L² / (|r2| S)                                    about the link's first end
#     V  = k ln[(|r1| + |r2| + L)² / 2S]
#
# Where r1·r2 < 0, S is |r1 × r2|² / (|r1||r2| − r1·r2). On the link itself F grows as 2k/c. A
# least distance bounds it: the charge is taken that far aside, in a direction of its own which
# is square to all others. So the field stays smooth, and the torques the exact slope of the
# potential.

Effect = tuple[Vector, Vector, float]
"""Effect of one obstacle of strength 1 on a link along u: the force, the t of which u × t is the
moment about the link's first end, and the potential."""

_AT, _WEIGHT = np.polynomial.legendre.leggauss(5)
_RULE: Final = tuple(zip((0.5 * (_AT + 1.0)).tolist(), (0.5 * _WEIGHT).tolist(), strict=True))
"""Where along a link its points are, 0 to 1, and the part of it that each stands for."""
_NONE: Final = 1e-300
"""Avoids division by zero."""
_THIN: Final = 1e-12
"""The same of a segment's squared length [m²], and of a distance with a direction [m]."""
_PARALLEL: Final = 1e-12
"""Squared sine of the angle below which line and link count as parallel."""
_ZERO: Final = (0.0, 0.0, 0.0)


@compiled(XYZ, XYZ)
def direction(p1: Vector, p2: Vector) -> tuple[Vector, float]:
    """Return the unit vector from p1 to p2, and their distance [m]; zero where they coincide."""
    along = minus(p2, p1)
    length = norm(along)
    return times(1.0 / max(length, _NONE), along), length


@inner_kernel
def by_charge(p: Vector, u: Vector, length: float, charge: Vector, least: float) -> Effect:
    """Return what a charge does to a link, that goes from p along u for its `length` [m].

    `least` bounds the distance from below [m]; with 0 there is no bound on the link itself.
    """
    r1 = minus(p, charge)
    # Along the link and square to it, each by itself: nothing cancels later.
    t1 = dot(r1, u)
    t2 = t1 + length
    across = further(r1, -t1, u)
    c2 = dot(across, across) + max(least * least, _NONE)
    n1, n2 = math.sqrt(t1 * t1 + c2), math.sqrt(t2 * t2 + c2)
    inner, product, total = t1 * t2 + c2, n1 * n2, n1 + n2
    # Where the charge is abreast of the link the sum is a difference: the squares' is exact.
    S = product + inner if inner >= 0.0 else length * length * c2 / max(product - inner, _NONE)
    S = max(S, _NONE)
    w = length / S
    lateral, axial = w * total / product, length * (t1 + t2) / (total * product)
    force = further(times(lateral, across), axial, u)
    return force, times(w * length / n2, across), math.log((total + length) ** 2 / (2.0 * S))


@inner_kernel
def closest(p1: Vector, p2: Vector, start: Vector, end: Vector) -> Vector:
    """Return the point of a segment start–end that is closest to a link p1–p2.

    Where they are parallel no point is closest: the paper takes the middle, with a jump.
    """
    u, v, w = minus(p2, p1), minus(end, start), minus(p1, start)
    uu, vv, uv, uw, vw = dot(u, u), dot(v, v), dot(u, v), dot(u, w), dot(v, w)
    square = uu * vv - uv * uv
    if square <= _PARALLEL * uu * vv:
        return further(start, 0.5, v)
    # On the link for the whole lines; then on the line for that point, and back, both bounded.
    s = min(1.0, max(0.0, (uv * vw - vv * uw) / square))
    t = min(1.0, max(0.0, (vw + s * uv) / vv))
    s = min(1.0, max(0.0, (t * uv - uw) / uu))
    t = min(1.0, max(0.0, (vw + s * uv) / vv))
    return further(start, t, v)


@inner_kernel
def by_line(
    p: Vector, u: Vector, length: float, start: Vector, end: Vector, least: float
) -> Effect:
    """Return what a line does that is charged all along, with 1 per metre."""
    along, size = direction(start, end)
    force, lever, potential = _ZERO, _ZERO, 0.0
    for part, share in _RULE:
        # What the point does to the line, turned round.
        pull, _, v = by_charge(start, along, size, further(p, part * length, u), least)
        force = further(force, -share * length, pull)
        lever = further(lever, -share * length * part * length, pull)
        potential += share * length * v
    return force, lever, potential


@inner_kernel
def repelled(distance: float, size: float, least: float) -> tuple[float, float]:
    """Return the force over `size`, and the potential, at a distance from a solid [m].

    The distance counts as d' = d/2 + √(d²/4 + least²): positive, and bounded smoothly.
    """
    root = math.sqrt(0.25 * distance * distance + least * least)
    d = 0.5 * distance + root
    # V = 1/d', and ∂d'/∂d = d' / (d' + least²/d') = d' / 2 root; divided once.
    once = 1.0 / (size * root * d)
    return 0.5 * once, once * size * root


@inner_kernel
def by_round(
    p: Vector, u: Vector, length: float, start: Vector, end: Vector, radius: float, least: float
) -> Effect:
    """Return what a rounded segment does to a link."""
    along = minus(end, start)
    over = 1.0 / max(dot(along, along), _THIN)
    force, lever, potential = _ZERO, _ZERO, 0.0
    for part, share in _RULE:
        away = further(minus(p, start), part * length, u)
        away = further(away, -min(1.0, max(0.0, dot(away, along) * over)), along)
        size = norm(away)
        push, v = repelled(size - radius, max(size, _THIN), least)
        charge = share * length
        force = further(force, charge * push, away)
        lever = further(lever, charge * push * part * length, away)
        potential += charge * v
    return force, lever, potential


@inner_kernel
def by_box(
    p: Vector, u: Vector, length: float, centre: Vector, R: Array, half: Vector, least: float
) -> Effect:
    """Return what a box with attitude R (3, 3) does to a link.

    Inside, the nearest side counts, its distance negative.
    """
    axes = rows_of(R)
    first, along = turned_back(axes, minus(p, centre)), turned_back(axes, u)
    force, lever, potential = _ZERO, _ZERO, 0.0
    for part, share in _RULE:
        x = further(first, part * length, along)
        bx, by, bz = abs(x[0]) - half[0], abs(x[1]) - half[1], abs(x[2]) - half[2]
        out = (max(bx, 0.0), max(by, 0.0), max(bz, 0.0))
        distance = size = norm(out)
        if size <= 0.0:
            distance, size = max(bx, by, bz), 1.0
            out = (1.0 * (bx >= distance), 1.0 * (by >= distance), 1.0 * (bz >= distance))
        push, v = repelled(distance, size, least)
        charge = share * length
        out = (
            math.copysign(out[0], x[0]),
            math.copysign(out[1], x[1]),
            math.copysign(out[2], x[2]),
        )
        force = further(force, charge * push, out)
        lever = further(lever, charge * push * part * length, out)
        potential += charge * v
    return turned(axes, force), turned(axes, lever), potential


def push(
    screws: Array,
    ends: Array,
    body: Index,
    obstacles: tuple[tuple[Array, Array, Array, Array, Array], Array, Flags],
    k: float,
    k_line: float,
    least: float,
    smooth: bool,
) -> tuple[Array, float]:
    """Return the joint torques (n,) [N·m] and the potential [J] of all links (eqs. 15, 16).

    Joints are `screws` (6, n) about World's origin, links `ends` (m, 2, 3), with `body` (m,) joints
    inboard of each, obstacles `Scene.solids`. Points and solids have the strength k
    [N·m], lines `k_line` per metre [N]; `least` [m] bounds distances from below. Sight lines
    without radius are charged all along where `smooth`, else at their point closest to each link.
    """
    torque = np.zeros(screws.shape[1])
    return torque, _push(screws, ends, body, obstacles, k, k_line, least, smooth, torque)


@compiled(
    *(MATRIX, ARRAY3, INDEX),
    record(record(MATRIX, MATRIX, ARRAY3, MATRIX, MATRIX), VECTOR, FLAGS),
    *(NUMBER, NUMBER, NUMBER, FLAG, ROW),
)
def _push(
    screws: Array,
    ends: Array,
    body: Index,
    obstacles: tuple[tuple[Array, Array, Array, Array, Array], Array, Flags],
    k: float,
    k_line: float,
    least: float,
    smooth: bool,
    torque: Array,
) -> float:
    (start, end, R, centre, half), radius, line = obstacles
    n = screws.shape[1]
    wrench, total = np.zeros((n + 1, 6)), 0.0
    for i in range(len(ends)):
        p1, p2 = row_of(ends[i], 0), row_of(ends[i], 1)
        u, length = direction(p1, p2)
        if length == 0.0:  # no charge
            continue
        force, lever, potential = _ZERO, _ZERO, 0.0
        for o in range(len(radius)):
            a, b, strength = row_of(start, o), row_of(end, o), k
            if radius[o] > 0.0 or not (line[o] or a == b):
                f, t, v = by_round(p1, u, length, a, b, radius[o], least)
            elif not line[o]:
                f, t, v = by_charge(p1, u, length, a, least)
            elif smooth:
                f, t, v = by_line(p1, u, length, a, b, least)
                strength = k_line
            else:
                f, t, v = by_charge(p1, u, length, closest(p1, p2, a, b), least)
                strength = k_line
            force, lever = further(force, strength, f), further(lever, strength, t)
            potential += strength * v
        for o in range(len(centre)):
            f, t, v = by_box(p1, u, length, row_of(centre, o), R[o], row_of(half, o), least)
            force, lever, potential = further(force, k, f), further(lever, k, t), potential + k * v
        moment = further(cross(p1, force), 1.0, cross(u, lever))
        for axis in range(3):
            wrench[body[i], axis] += force[axis]
            wrench[body[i], 3 + axis] += moment[axis]
        total += potential
    for j in range(n - 1, -1, -1):  # a link's wrench acts on the joints inboard of it
        for row in range(6):
            wrench[j, row] += wrench[j + 1, row]
            torque[j] += screws[row, j] * wrench[j + 1, row]
    return total


# --- The total potential of an arm and its slope: obstacles, joint limits, manipulability ---------
#
# Scott & Carignan, eqs. 1 and 15–22: V = V_obst + V_jlim + V_manip, and τ = −∂V/∂q exactly.


class Strengths(NamedTuple):
    """How strongly what acts; what is zero is not computed."""

    obstacles: float
    """Of points and solids [N·m]."""
    lines: float
    """Of sight lines, per metre [N]."""
    joint_limits: float
    """[N·m]."""
    manipulability: float
    """[N·m for w in m³]."""


class Value(NamedTuple):
    """The potential at one posture, and its slope."""

    torque: Array
    """−∂V/∂q (n,) [N·m]."""
    parts: dict[str, float]
    """Each part's share of V [N·m = J]."""

    @property
    def total(self) -> float:
        """V [J]."""
        return sum(self.parts.values())


class Potential:
    """V and −∂V/∂q of one arm."""

    def __init__(
        self,
        lower: Array,
        upper: Array,
        body: Index,
        strengths: Strengths,
        least: float,
        smooth_lines: bool = True,
        rank: int = 6,
    ) -> None:
        """Build for joints between `lower` and `upper` (n,) [rad].

        `body` (m,) counts the joints inboard of each link; `least` [m] bounds distances from
        below. Lines are charged all along, or else a charge stands for each where it is closest to
        each link. `rank` is how many axes the arm reaches anywhere.
        """
        self._middle = 0.5 * (lower + upper)
        self._stiffness = strengths.joint_limits / (upper - lower)
        self._body = body
        self._strengths = strengths
        self._least = least
        self._smooth_lines = smooth_lines
        self._rank = rank

    def at(
        self,
        here: Shape,
        scene: Scene | None,
        rest: Array | None = None,
        held: HeldAxes | None = None,
    ) -> Value:
        """Return V and −∂V/∂q of a shape in a scene; None: nothing repels its links.

        `rest` is q_o (n,) [rad], that the joints' springs pull to; None: the middle of the ranges.
        `held` are the axes that the task holds, whose manipulability counts; None: all.
        """
        k, rest = self._strengths, self._middle if rest is None else rest
        torque = np.empty(len(here.q))
        parts = {"joint_limits": _hold(here.q, rest, self._stiffness, torque)}
        if k.manipulability > 0.0:
            # With all six axes it is the same about any point: what moves the point has
            # determinant one.
            anywhere = self._rank == 6 and held is None
            J = here.screws if anywhere else screws(here.screws, -here.tool)
            w, slope = manipulability_slope(J, self._rank, held)
            torque = torque + k.manipulability * slope
            parts["manipulability"] = -k.manipulability * w
        parts["obstacles"] = 0.0
        if scene is not None:
            pushed, parts["obstacles"] = push(
                here.screws,
                here.ends,
                self._body,
                scene.solids,
                k.obstacles,
                k.lines,
                self._least,
                self._smooth_lines,
            )
            torque = torque + pushed
        return Value(torque, parts)


@compiled(VECTOR, VECTOR, VECTOR, ROW)
def _hold(q: Array, rest: Array, stiffness: Array, torque: Array) -> float:
    """Write the torques (n,) of springs that hold q (n,) to `rest`, return their potential."""
    potential = 0.0
    for j in range(len(q)):
        away = rest[j] - q[j]
        torque[j] = stiffness[j] * away
        potential += 0.5 * torque[j] * away
    return potential


# --- How quickly to slide downhill: along the slope, over its own curvature -----------------------
#
# A step down the bare slope is slow where the field is flat and unstable where it is steep.
# Divided by the curvature along the way, all of it is approached at one rate, whatever the
# strengths are.

LOOK = 1e-5
"""Step of the finite difference for the curvature [rad]."""


class FieldView(NamedTuple):
    """Where the arm is, among what, and its potential there."""

    here: Shape
    scene: Scene | None
    """None where nothing repels the links."""
    value: Value
    rest: Array | None = None
    """q_o (n,) [rad]; None: the middle of the ranges."""
    held: HeldAxes | None = None
    """Axes that the task holds; None: all."""


class FieldFlow:
    """Rates downhill for one arm: in its self-motions, and along a virtual link."""

    def __init__(self, potential: Potential, body: Index, flattest: float) -> None:
        """`body` (m,) counts the joints inboard of each link; curvatures count as at least
        `flattest` [N·m/rad]."""
        self._potential = potential
        self._body = body
        self._flattest = flattest

    def look(
        self,
        here: Shape,
        scene: Scene | None,
        rest: Array | None = None,
        held: HeldAxes | None = None,
    ) -> FieldView:
        """Return what there is to know of the field where the arm is, with q_o at `rest` (n,)."""
        return FieldView(here, scene, self._potential.at(here, scene, rest, held), rest, held)

    def self_motion(self, seen: FieldView, null: Array) -> tuple[Array, float]:
        """Return the joint rates (n,) [rad/s], at a gain of 1 /s, to the least potential.

        `null` (r, n) holds orthonormal rows that span the self-motions. The size of the slope
        along them, |Pτ| [N·m], is returned with the rates.
        """
        slope = np.zeros(null.shape[1])
        size = _project(null, seen.value.torque, slope)
        if size < 1e-12:
            return slope, size
        # Where there is but one way, both its senses bend alike.
        way = null[0] if len(null) == 1 else slope / size
        there = self._ahead(seen, way)
        rows, ahead = _kept(seen), _kept(there)
        bend = curvature(way, rows, seen.value.torque, ahead, there.value.torque, LOOK)
        return slope / max(abs(bend), self._flattest), size

    def along(self, seen: FieldView, direction: Array, out: float, stiffness: float) -> float:
        """Return the speed [m/s], at a gain of 1 /s, of the tool along a virtual link.

        The link points along `direction` (3,), a unit vector in World, is `out` [m] now and held
        by a spring [N/m]. J_aug = [J e], and the potential is V + k d²/2.
        """
        way = _lever(seen.here, direction)
        step = LOOK / max(math.sqrt(float(way @ way)), 1e-6)
        there = self._ahead(seen, way * step / LOOK)
        force = float(way @ seen.value.torque)
        bend = (force - float(_lever(there.here, direction) @ there.value.torque)) / step
        return (force - stiffness * out) / max(abs(bend + stiffness), 0.5 * stiffness)

    def _ahead(self, seen: FieldView, way: Array) -> FieldView:
        """Look a small way ahead along joint rates (n,)."""
        held = seen.held
        if held is not None:
            held = held.seen(rotation_exp(LOOK * (seen.here.screws[3:] @ way)))
        return self.look(ahead(seen.here, self._body, way, LOOK), seen.scene, seen.rest, held)


def _kept(seen: FieldView) -> Array:
    """Return the Jacobian (6, n) of what self-motion leaves as it is."""
    here, held = seen.here, seen.held
    return here.screws if held is None else held.own(screws(here.screws, -here.tool))


def _lever(at: Shape, direction: Array) -> Array:
    """Return the joint rates (n,) that shift the tool along a direction (3,)."""
    twist = np.concatenate([direction, np.zeros(3)])  # a shift is the same at every point
    return np.asarray(at.screws.T @ weighed(at.screws, twist))


@compiled(MATRIX, VECTOR, ROW)
def _project(null: Array, torque: Array, slope: Array) -> float:
    """Write the part (n,) of torques along the rows of `null` (r, n), and return its size.

    `slope` is zeros before.
    """
    size2 = 0.0
    for row in range(len(null)):
        part = 0.0
        for j in range(len(torque)):
            part += null[row, j] * torque[j]
        for j in range(len(torque)):
            slope[j] += part * null[row, j]
    for j in range(len(torque)):
        size2 += slope[j] * slope[j]
    return math.sqrt(size2)
