"""The arm angle: where the elbow is on its circle about the line from shoulder to wrist.

Of arms whose first three axes meet in the shoulder S, and the first two after the elbow in the
wrist W: S-R-S arms, whose wrist stands while the tool does, and those alike whose last axes pass W
at a distance. With the elbow E, e = E − S, w = W − S, the unit vector ŵ of w, p = e − ŵ (ŵ·e) and
the direction V of the first shoulder axis,

    φ = atan2(ŵ·(V × p), V·p)                           (Kreutz-Delgado, Long & Seraji 1992)

is how far the plane of S, E and W is turned about ŵ, right-handed, out of the plane of S, W and V:
the SEW angle of Scott & Carignan 2008, Fig. 6. It is 0 where the elbow is furthest along V, and
there the third joint is at 0 or π: the reference plane is that of the arm without this joint
(Shimizu et al. 2008). It says nothing of where the wrist is, nor how Base stands in World.

Two cases have no angle: the stretched or folded elbow, p = 0, which is on no circle; and the wrist
on the first axis, w ∥ V, where no plane is the reference.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Self

import numpy as np

from ..compiled import INDEX, MATRIX, ROW, VECTOR, compiled, inner_kernel
from ..scene import Index
from ..spatial import Array, Kinematics, Pose

_MEET: Final = 1e-4
"""Axes that pass each other no farther than this meet [m]."""
_LINK: Final = 0.01
"""Upper arm and forearm are longer than this [m]."""
_SPLAYED: Final = 1e-3
"""Sine of the angle between two axes from which their common point is sought [1]."""
UNDEFINED: Final = 0.01
"""No angle is told where p is below this part of e, or where this is the sine of the angle from V
to w [1]."""
_ON_LINE: Final = 1e-9
"""Elbows that are this near to the line from shoulder to wrist are on it [m]."""
_JOINTS: Final = 7
"""Fewest joints: three of the shoulder, one of the elbow, three of the wrist [1]."""


class ElbowReading(NamedTuple):
    """The elbow on its circle."""

    angle: float
    """φ [rad], −π to π; NaN where there is none."""
    slope: Array
    """∂φ/∂q (n,) [1]; zeros where the elbow is on no circle."""


class ArmAngle:
    """Reads the arm angle of one mechanism."""

    def __init__(self, joints: Sequence[int]) -> None:
        """Build it; `joints` are the places of the first two of the shoulder, the elbow's, and the
        first two of the wrist.
        """
        self._joints = np.array(joints, dtype=np.int64)

    @classmethod
    def of(cls, samples: Sequence[tuple[Pose, Array]]) -> Self | None:
        """Return that of a chain by its kinematics at some postures; None for one that has none.

        Each sample is T_world_wrist and the Jacobian (6, n) of the Wrist. Joints that do not move
        the Wrist, as one that turns a scanner, are none of the arm's.
        """
        moves = np.any([np.abs(J).max(axis=0) > 0.0 for _, J in samples], axis=0)
        chain = np.flatnonzero(moves)
        for first in range(len(chain) - _JOINTS + 1):
            joints = chain[first : first + 6]
            if all(_is_elbowed(T, J[:, joints]) for T, J in samples):
                return cls(joints[[0, 1, 3, 4, 5]].tolist())
        return None

    def look(self, k: Kinematics) -> ElbowReading:
        """Return angle and slope by the Jacobian of the MRF."""
        slope = np.zeros(k.J.shape[1])
        return ElbowReading(_look(k.J, k.T_world_mrf.p, self._joints, slope), slope)


def _is_elbowed(T: Pose, J: Array) -> bool:
    """Return whether three axes meet, one turns an elbow, and two meet: the columns of J (6, 6)."""
    axes = J[3:]
    if float(np.abs(np.linalg.norm(axes, axis=0) - 1.0).max()) > 1e-9:
        return False  # one slides
    on = T.p[:, None] + np.cross(axes, J[:3], axis=0)
    S, W = _meeting(on[:, :3], axes[:, :3]), _meeting(on[:, 4:], axes[:, 4:])
    if S is None or W is None:
        return False
    return min(_off(S, on[:, 3], axes[:, 3]), _off(W, on[:, 3], axes[:, 3])) > _LINK


def _meeting(on: Array, axes: Array) -> Array | None:
    """Return the point (3,) where lines through points (3, m) along axes (3, m) meet, or None.

    The first two are not parallel.
    """
    across = np.cross(axes[:, 0], axes[:, 1])
    size2 = float(across @ across)
    if size2 < _SPLAYED**2:
        return None
    way = np.cross(on[:, 1] - on[:, 0], axes[:, 1])
    point = np.asarray(on[:, 0] + float(way @ across) / size2 * axes[:, 0])
    offs = [_off(point, *line) for line in zip(on.T, axes.T, strict=True)]
    return point if max(offs) < _MEET else None


def _off(point: Array, on: Array, axis: Array) -> float:
    """Return how far a point is from a line [m]."""
    return float(np.linalg.norm(np.cross(point - on, axis)))


@inner_kernel
def _nearest(J: Array, p: Array, j: int) -> Array:
    """Return the point (3,) of a joint's axis that is nearest to the point p that J is at.

    Of a turn ω by which that goes at v: p + ω × v.
    """
    found = np.empty(3)
    for row in range(3):
        i, k = (row + 1) % 3, (row + 2) % 3
        found[row] = p[row] + J[3 + i, j] * J[k, j] - J[3 + k, j] * J[i, j]
    return found


@inner_kernel
def _common(J: Array, p: Array, first: int, second: int) -> Array:
    """Return the point (3,) where the axes of two joints meet."""
    a, b = _nearest(J, p, first), _nearest(J, p, second)
    across = first_way = second_way = 0.0
    for row in range(3):
        across += J[3 + row, first] * J[3 + row, second]
        first_way += (b[row] - a[row]) * J[3 + row, first]
        second_way += (b[row] - a[row]) * J[3 + row, second]
    ahead = (first_way - across * second_way) / (1.0 - across * across)
    for row in range(3):
        a[row] += ahead * J[3 + row, first]
    return a


@compiled(MATRIX, VECTOR, INDEX, ROW)
def _look(J: Array, at: Array, joints: Index, slope: Array) -> float:
    """Write ∂φ/∂q (n,), zeros before, and return φ [rad].

    From the Jacobian (6, n) of the point `at` (3,), and the places (5,) of the joints.
    """
    first, elbow = joints[0], joints[2]
    S, W = _common(J, at, first, joints[1]), _common(J, at, joints[3], joints[4])
    E = _nearest(J, at, elbow)
    along = 0.0
    for row in range(3):
        along += (S[row] - E[row]) * J[3 + row, elbow]
    V, w, e, p, r = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    size_w2 = size_e2 = 0.0
    for row in range(3):
        E[row] += along * J[3 + row, elbow]
        V[row], w[row], e[row] = J[3 + row, first], W[row] - S[row], E[row] - S[row]
        size_w2 += w[row] * w[row]
        size_e2 += e[row] * e[row]
    size_w, size_e = math.sqrt(size_w2), math.sqrt(size_e2)
    if size_w < _ON_LINE:
        return math.nan
    e_on_w = V_on_w = 0.0
    for row in range(3):
        w[row] /= size_w
        e_on_w += e[row] * w[row]
        V_on_w += V[row] * w[row]
    size_p2 = size_r2 = 0.0
    for row in range(3):
        p[row], r[row] = e[row] - e_on_w * w[row], V[row] - V_on_w * w[row]
        size_p2 += p[row] * p[row]
        size_r2 += r[row] * r[row]
    size_p, size_r = math.sqrt(size_p2), max(math.sqrt(size_r2), _ON_LINE)
    if size_p < _ON_LINE:
        return math.nan
    # The reference is r = V − ŵ (ŵ·V). With t = ŵ × p̂ and s = ŵ × r̂, the rates at which p and r
    # turn about ŵ are apart by dφ.
    t, s = np.empty(3), np.empty(3)
    y = x = 0.0
    for row in range(3):
        i, k = (row + 1) % 3, (row + 2) % 3
        t[row] = (w[i] * p[k] - w[k] * p[i]) / size_p
        s[row] = (w[i] * r[k] - w[k] * r[i]) / size_r
        y -= V[row] * t[row] * size_p
        x += V[row] * p[row]
    for j in range(first, elbow + 1):
        e_turns = w_turns = r_turns = 0.0
        for row in range(3):
            i, k = (row + 1) % 3, (row + 2) % 3
            a, b = J[3 + i, j], J[3 + k, j]
            goes = J[row, j] + a * (W[k] - at[k]) - b * (W[i] - at[i])
            w_turns += t[row] * goes
            r_turns += s[row] * goes
            if j < elbow:
                e_turns += t[row] * (J[row, j] + a * (E[k] - at[k]) - b * (E[i] - at[i]))
        slope[j] = (e_turns - e_on_w / size_w * w_turns) / size_p
        slope[j] += V_on_w / (size_w * size_r) * r_turns
    if size_p < UNDEFINED * size_e or size_r < UNDEFINED:
        return math.nan
    return math.atan2(y, x)
