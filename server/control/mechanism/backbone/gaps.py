"""Curves across gaps between two tunnels, solved once: fixed ends, fixed length, least bending.

Where everything slides at one speed, the conditions between tunnels (Chirikjian & Burdick, eqs. 8,
9, 16 and 17) hold for any fixed curve, and so do their rates (eqs. 10 to 13): the slack lives in
the exterior at the base alone. Bend and climb are polynomials along the gap,

    κ ℓ = Σ c_k P_k(2t − 1), k = 0 … 4 (Legendre),   least Σ c_k² / (2k + 1)

subject to end and end tangent, by Newton's method on the Lagrangian from several starts. Where that
curve is too sharp somewhere, its greatest curvature is brought down along the curves that meet both
ends. A curve is made of short arcs, by which the ends are met exactly.
"""

import math

import numpy as np
from numpy.polynomial import legendre

from ...spatial import Array, Pose
from .interior import Turn

ARCS = 24
"""Arcs of one gap [1]."""
DEGREE = 4
STARTS = 8
"""Curves are sought from so many starts, and the one of least bending is taken [1]."""
MOST_STARTS = 64
"""Where none of these is a curve that can be followed, from so many in all [1]."""
MOST_STEPS = 40
LONGEST_STEP = 1.5
"""Coefficients change by no more in one step [rad]."""
MET = 1e-11
"""Ends are met within this, in lengths of the gap [1]."""
SETTLED = 1e-4
"""A curve is the one of least bending when its coefficients change by less [rad]."""
MOST_BLUNTINGS = 30
"""A curve that is too sharp is made blunter in so many steps [1]."""
POWER = 8
"""An arc's weight there is this power of its curvature [1]."""
SAME = 1e-3
"""Curves whose costs differ by a smaller part are one and the same [1]."""
PARTS = (0.3, 0.1, 0.03, 0.01)
"""Parts of such a step that are tried [1]."""
SLIGHT = 1e-6
CROSSING = 0.25
"""Points of a gap that are so far apart along it shall not come near to each other [1]."""


def solve_gap(T: Pose, T_to: Pose, length: float, planar: bool, sharpest: float) -> list[Turn]:
    """Return short turns that lead from a pose to another's place and tangent.

    `length` is the curve's [m], `sharpest` the greatest curvature [1/m]. Raises `ValueError` that
    says why there is none.
    """
    way = T.R.T @ (T_to.p - T.p)
    chord = float(np.linalg.norm(way))
    if length <= chord:
        raise ValueError(f"a length of {length:g} m is no more than its chord, {chord:.4f} m")
    R = T.R.T @ T_to.R
    if planar and (abs(way[2]) > SLIGHT or abs(R[2, 0]) > SLIGHT):
        raise ValueError("a planar arm cannot leave its plane")
    found = _solved(way / length, R[:, 0], planar, sharpest * length)
    if found is None:
        raise ValueError(f"no curve of {length:g} m leads there from any of {MOST_STARTS} starts")
    bends = _bends(found[None], planar)[0]
    curvature = _sharpest(found, planar) / length
    if curvature > sharpest:
        raise ValueError(
            f"the bluntest curve that is found has a curvature of {curvature:.2f} 1/m, at most "
            f"{sharpest:.2f} can be followed"
        )
    points = _ends(found[None], planar)[2][0] * length
    apart = np.abs(np.subtract.outer(np.arange(ARCS + 1), np.arange(ARCS + 1)))
    far = apart > CROSSING * ARCS
    near = np.linalg.norm(points[:, None] - points, axis=2)[far]
    if near.min() < 0.5 * CROSSING * length / math.pi:
        raise ValueError(f"the curve comes to {near.min():.4f} m of itself")
    return [Turn(length / ARCS, float(bend), float(climb)) for bend, climb in bends]


def _solved(way: Array, tangent: Array, planar: bool, sharpest: float) -> Array | None:
    """Return the coefficients of least cost that meet the end; lengths are in that of the gap.

    Where none of the first starts leads to a curve that is not sharper, the first that is blunt
    enough, or can be made so; failing that the bluntest. A start that leads to none of least cost
    may still lead to one that meets the end.
    """
    curves = 1 if planar else 2
    weight = np.tile(1.0 / (2.0 * np.arange(DEGREE + 1) + 1.0), curves)
    draw, best, least = np.random.default_rng(0), None, math.inf
    bluntest, seen = None, list[float]()
    for start in range(MOST_STARTS):
        x = draw.normal(0.0, 0.0 if start == 0 else 2.0, curves * (DEGREE + 1))
        if start == 0:
            x[1] = 0.1
        found = _least(x, way, tangent, planar, weight)
        cost = math.inf if found is None else float(weight @ found**2)
        if cost < least:
            best, least = found, cost
        if start < STARTS - 1:
            continue
        # Beyond the first starts a curve is taken for being blunt.
        found, cost = (best, least) if start == STARTS - 1 else (found, cost)
        if found is None:
            found, cost = _met(x, way, tangent, planar, MOST_STEPS), -1.0
        if found is None or any(abs(cost - other) < SAME * cost for other in seen):
            continue
        seen.append(cost)
        found = _blunter(found, way, tangent, planar, sharpest)
        if bluntest is None or _sharpest(found, planar) < _sharpest(bluntest, planar):
            bluntest = found
        if _sharpest(bluntest, planar) <= sharpest:
            break
    return None if bluntest is None else _met(bluntest, way, tangent, planar)


def _blunter(x: Array, way: Array, tangent: Array, planar: bool, sharpest: float) -> Array:
    """Return coefficients near x (c,) that meet the end with less of the greatest curvature.

    The first whose curvature is nowhere above `sharpest` (of unit length), or the bluntest found.
    """
    blocks = np.eye(1 if planar else 2)
    for _ in range(MOST_BLUNTINGS):
        most = _sharpest(x, planar)
        if most <= sharpest:
            break
        shares = (np.hypot(*_bends(x[None], planar)[0].T) * ARCS / most) ** POWER
        weight = np.kron(blocks, _legendre().T @ (shares[:, None] * _legendre()))
        _, J = _linearised(x, way, tangent, planar)
        free = np.linalg.svd(J)[2][len(J) :].T
        step = free @ np.linalg.lstsq(free.T @ weight @ free, free.T @ weight @ x, rcond=None)[0]
        for part in PARTS:
            tried = _met(x - part * step, way, tangent, planar)
            if tried is not None and _sharpest(tried, planar) < most:
                break
        else:
            break
        x = tried
    return x


def _least(x: Array, way: Array, tangent: Array, planar: bool, weight: Array) -> Array | None:
    """Return coefficients near x (c,) of least cost that meet the end; None if it settles not."""
    for _ in range(MOST_STEPS):
        off, J = _linearised(x, way, tangent, planar)
        JW = J / weight
        try:
            multiplier = np.linalg.solve(JW @ J.T, J @ x - off)
        except np.linalg.LinAlgError:
            return None
        step = JW.T @ multiplier - x
        x = x + step * min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
        if float(np.abs(step).max()) < SETTLED:
            return x
    return None


def _sharpest(x: Array, planar: bool) -> float:
    """Return the greatest curvature of a gap's curve, of unit length [1]."""
    return float(np.hypot(*_bends(x[None], planar)[0].T).max()) * ARCS


def _met(x: Array, way: Array, tangent: Array, planar: bool, steps: int = 6) -> Array | None:
    """Return coefficients near x (c,) that meet the end exactly; None where there are none."""
    for _ in range(steps):
        off, J = _linearised(x, way, tangent, planar)
        if float(np.abs(off).max()) < MET:
            return x
        step = np.asarray(np.linalg.lstsq(J, off, rcond=None)[0], dtype=np.float64)
        x = x - step * min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
    return None


def _linearised(x: Array, way: Array, tangent: Array, planar: bool) -> tuple[Array, Array]:
    """Return how far the end is off (m,), and its Jacobian (m, c) by central differences."""
    h = 1e-6
    tried = np.vstack((x[None], x + h * np.eye(len(x)), x - h * np.eye(len(x))))
    places, tangents, _ = _ends(tried, planar)
    # Along two directions across the wanted tangent; it has to point ahead, too.
    across = np.linalg.svd(tangent[None])[2][1:]
    if planar:
        aside = np.array([-tangent[1], tangent[0], 0.0])
        ahead = np.arctan2(tangents @ aside, tangents @ tangent)[:, None]
        off = np.concatenate(((places - way)[:, :2], ahead), axis=1)
    else:
        angle = np.arccos(np.clip(tangents @ tangent, -1.0, 1.0))
        scale = np.where(angle > 1e-9, angle / np.maximum(np.sin(angle), 1e-9), 1.0)
        off = np.concatenate((places - way, scale[:, None] * (tangents @ across.T)), axis=1)
    n = len(x)
    return off[0], ((off[1 : n + 1] - off[n + 1 :]) / (2.0 * h)).T


def _bends(x: Array, planar: bool) -> Array:
    """Return bend and climb of each arc (s, a, 2) [rad] of coefficients (s, c)."""
    V = _legendre()
    bend = x[:, : DEGREE + 1] @ V.T / ARCS
    climb = np.zeros_like(bend) if planar else x[:, DEGREE + 1 :] @ V.T / ARCS
    return np.stack((bend, climb), axis=2)


def _legendre() -> Array:
    """Return the polynomials at the middle of each arc (a, c): curvature of unit coefficients."""
    t = 2.0 * (np.arange(ARCS) + 0.5) / ARCS - 1.0
    V = np.asarray(legendre.legvander(t, DEGREE), dtype=np.float64)
    V[:, 1:] -= V[:, 1:].mean(axis=0)  # what turns in all is c_0 alone, for arcs, too
    return V


def _ends(x: Array, planar: bool) -> tuple[Array, Array, Array]:
    """Return ends (s, 3), end tangents (s, 3) and all points (s, a + 1, 3) of unit length."""
    bends = _bends(x, planar)
    R, p = np.tile(np.eye(3), (len(x), 1, 1)), np.zeros((len(x), 3))
    points = [p]
    for i in range(ARCS):
        bend, climb = bends[:, i].T
        angle = np.maximum(np.hypot(bend, climb), 1e-12)
        inward = np.stack((np.zeros(len(x)), bend / angle, climb / angle), axis=1)
        ahead = np.stack((np.ones(len(x)), np.zeros(len(x)), np.zeros(len(x))), axis=1)
        s, c = np.sin(angle)[:, None], np.cos(angle)[:, None]
        # (1 − cos α) / α without loss of digits
        sagitta = (2.0 * np.sin(0.5 * angle) ** 2 / angle)[:, None]
        chord = (s / angle[:, None] * ahead + sagitta * inward) / ARCS
        p = p + np.einsum("sij,sj->si", R, chord)
        points.append(p)
        axis = np.cross(ahead, inward)
        turned = np.stack((c * ahead + s * inward, c * inward - s * ahead, axis), axis=2)
        frame = np.stack((ahead, inward, axis), axis=2)
        R = np.einsum("sij,sjk,slk->sil", R, turned, frame)
    return p, R[:, :, 0], np.stack(points, axis=1)
