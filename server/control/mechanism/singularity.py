"""Joint rates beside a singularity: held off its boundary, led home from it.

With u the tool direction that fades, v the joint motion that fades with it, σ the singular value
and κ = uᵀ (∂J/∂q · v) v the curvature of the boundary: a command along u against κ leads out of the
workspace, and the motion v that answers it is braked so as to end above σ = 0; one along κ leads
home, and is answered with the full damped gain however small σ is.

At σ = 0 there is more than one motion that the tool hardly feels, and v is any of them. The one
that counts bends most along the command: the greatest eigenvalue of uᵀ (∂J/∂q · a) b over that
whole space. The way home along it can be gone in two senses, elbow up and elbow down: that which is
uphill in σ is chosen; joint limits decide where they leave only one open. Nothing else jumps:

- directions whose singular values are nearly the same (`_ALIKE`) are looked at together, as the
  command divides between them: where two cross, u and v are any of their sums;
- from v to the motion that bends most the answer goes over between floor and half of it, and
  motions count as unfelt the more the smaller their singular values are;
- where σ is zero, u may be any sum with directions that the arm never reaches: close to there,
  these count as well, as directions without a motion.
"""

import math
from typing import NamedTuple

import numpy as np

from ....config.schema.cell import Resolve
from ..compiled import COUNT, FLAG, MATRIX, NUMBER, VECTOR, compiled
from ..spatial import Array

_CURVED = 0.05
"""Curvature from which a singularity counts as a boundary of the workspace [m/rad²]."""

_BRAKING = 3.0
"""Deceleration with which joints approach a boundary of the workspace [rad/s²]."""

_TRAVEL = 0.4
"""A way home with less joint travel than this is not taken if the other has more [rad]."""

_ALIKE = 0.5
"""Singular values that differ by less than this part of the larger are looked at together [1]."""

_SHARED = 0.2
"""Motions whose curvatures differ by less than this part of the greatest share the way home [1]."""

_UNKNOWN = 0.1
"""Below this part of the floor a direction may be mixed with those that are never reached [1]."""

_NONE = 1e-9
"""A command along a direction is none below this [m/s]."""


class Travel(NamedTuple):
    """How far each joint may still go (n,) [rad]."""

    below: Array
    above: Array

    def along(self, direction: Array) -> float:
        """Return how far all joints can go along a unit direction (n,) before one is stopped."""
        room = np.where(direction > 0.0, self.above, self.below)
        return float((room / np.maximum(np.abs(direction), 1e-9)).min())


class Directions(NamedTuple):
    """The weighted Jacobian taken apart, and a command."""

    J: Array
    """The Jacobian (6, n), not weighted."""
    length: float
    """Rotations weigh so much [m/rad]."""
    U: Array
    """Tool directions (6, 6)."""
    sigma: Array
    """Singular values (6,); zero for directions that the arm never reaches."""
    V: Array
    """Joint motions (r, n) of the directions that it reaches, the first ones."""
    null: Array
    """Spare motions (n − r, n)."""
    along: Array
    """Parts of the weighted command along U (6,)."""


class _WayHome(NamedTuple):
    """The motion that bends most along a command."""

    way: Array
    """Rates (n,) per gain, in the sense to be gone [m/s]."""
    share: float
    """Part of the command that is answered so, 0 to 1."""
    turned: bool
    """True where joint limits bar the way that is uphill."""


class Answer(NamedTuple):
    """Joint rates for a command, and how they came about."""

    dq: Array
    """(n,) [rad/s]."""
    way_home: Array | None
    """The part (n,) of them along motions that bend most [rad/s]; None: none."""
    singular: bool
    """True where damping acts on what was asked."""


def answer(at: Directions, p: Resolve, travel: Travel | None) -> Answer:
    """Return the rates (n,) [rad/s] that answer a command beside a singularity."""
    region, damping = p.singular_region, p.damping
    least = float(at.sigma[len(at.V) - 1])
    way = _way_home(at, p, travel) if least < p.floor else None
    share, turned = (0.0, False) if way is None else (way.share, way.turned)
    felt, singular = _felt(
        at.J, at.length, at.U, at.sigma, at.V, at.along, share, turned, region, damping, p.floor
    )
    home = np.zeros(len(felt)) if way is None else _full_gain(least, region, damping) * way.way
    dq, bounded = _bounded(felt, home, at.along, region, damping)
    return Answer(dq, None if way is None else bounded * home, singular)


def _way_home(at: Directions, p: Resolve, travel: Travel | None) -> _WayHome | None:
    """Return the motion that the tool hardly feels and that bends most along a command."""
    parts, size, basis, rows, bend = _unfelt(*at, p.singular_region, p.floor)
    if size <= _NONE:
        return None
    values, vectors = np.linalg.eigh(bend)
    # Where motions bend both ways, those that bend more decide which way leads home.
    most, lead = float(values[-1]), float(values[-1] + min(values[0], 0.0))
    if lead <= 0.0:
        return None
    alike = np.maximum(0.0, 1.0 - (most - values) / (_SHARED * most))
    uphill = (at.sigma * parts)[: len(at.V)] @ at.V
    direction = ((vectors * alike) @ (vectors.T @ (rows @ uphill))) @ basis
    size_uphill = math.sqrt(float(direction @ direction))
    if size_uphill <= 1e-3 * _NONE * size:
        direction = vectors[:, -1] @ basis
        size_uphill = math.sqrt(float(direction @ direction))
    direction = direction / size_uphill
    per_bend = lead / most / _CURVED
    share = _bending(
        at.J, at.length, at.U, at.sigma, len(at.V), parts, direction, p.floor, per_bend
    )
    if share <= 0.0:
        return None
    turned = travel is not None and (
        travel.along(direction) < min(_TRAVEL, travel.along(-direction))
    )
    return _WayHome((-1.0 if turned else 1.0) * share * size * direction, share, turned)


@compiled(NUMBER, NUMBER, NUMBER)
def damped_gain(sigma: float, region: float, damping: float) -> float:
    """Return joint rate per tool rate along a direction [1/m]."""
    if sigma >= region:
        return 1.0 / sigma
    return sigma / (sigma**2 + damping**2 * (1.0 - (sigma / region) ** 2))


@compiled(NUMBER, NUMBER, NUMBER)
def _full_gain(sigma: float, region: float, damping: float) -> float:
    """Return the damped gain, no weaker than at λm: there it is about greatest."""
    return damped_gain(max(sigma, damping), region, damping)


@compiled(NUMBER, NUMBER)
def _below(sigma: float, floor: float) -> float:
    """Return how far a singular value is below the floor: 0 there, 1 from half of it."""
    return min(1.0, max(0.0, 2.0 * (1.0 - sigma / floor)))


@compiled(VECTOR, COUNT, NUMBER)
def _all_below(sigma: Array, rank: int, floor: float) -> Array:
    """Return how far directions (6,) are below the floor.

    Those that are never reached count only where they cannot be told from one that is: close to 0.
    """
    found = np.empty(6)
    for i in range(6):
        if i < rank:
            found[i] = _below(sigma[i], floor)
        else:
            found[i] = max(0.0, 1.0 - sigma[rank - 1] / (_UNKNOWN * floor))
    return found


@compiled(MATRIX, VECTOR, VECTOR, NUMBER)
def bend(J: Array, a: Array, b: Array, length: float) -> Array:
    """Return how the tool's way bends (6,) under joint motions a and b (n,): (∂J/∂q · a) b.

    In closed form, as in `jacobian_rate.py`; rotations weigh `length` [m/rad].
    """
    found, w, v = np.zeros(6), np.zeros(3), np.zeros(3)
    for j in range(len(a)):
        for i in range(3):
            v[i] += a[j] * J[i, j]
    for j in range(len(a)):
        vx, vy, vz, x, y, z = J[0, j], J[1, j], J[2, j], J[3, j], J[4, j], J[5, j]
        found[3] += length * b[j] * (w[1] * z - w[2] * y)
        found[4] += length * b[j] * (w[2] * x - w[0] * z)
        found[5] += length * b[j] * (w[0] * y - w[1] * x)
        w[0], w[1], w[2] = w[0] + a[j] * x, w[1] + a[j] * y, w[2] + a[j] * z
        v[0], v[1], v[2] = v[0] - a[j] * vx, v[1] - a[j] * vy, v[2] - a[j] * vz
        found[0] += b[j] * (w[1] * vz - w[2] * vy + y * v[2] - z * v[1])
        found[1] += b[j] * (w[2] * vx - w[0] * vz + z * v[0] - x * v[2])
        found[2] += b[j] * (w[0] * vy - w[1] * vx + x * v[1] - y * v[0])
    return found


@compiled(
    MATRIX, NUMBER, MATRIX, VECTOR, MATRIX, VECTOR, NUMBER, FLAG, NUMBER, NUMBER, NUMBER
)  # fmt: skip
def _felt(
    J: Array, length: float, U: Array, sigma: Array, V: Array, along: Array,
    share: float, turned: bool, region: float, damping: float, floor: float,
) -> tuple[Array, bool]:  # fmt: skip
    """Return rates (n,) along the directions' own motions, and whether damping acts.

    `share` of what is asked below the floor is answered by the way home, in place of these.
    """
    rank, n = V.shape
    dq, singular = np.zeros(n), False
    u, v = np.empty(6), np.empty(n)
    for i in range(rank):
        s, d = sigma[i], along[i]
        natural = damped_gain(s, region, damping)
        gain = natural
        if s < 2.0 * region and abs(d) > _NONE:
            # The command along this direction and those that are like it, as one.
            size2 = 0.0
            for r in range(6):
                u[r] = 0.0
            for j in range(n):
                v[j] = 0.0
            for k in range(rank):
                like = 1.0
                if k != i:
                    like -= abs(sigma[k] - s) / max(sigma[k], s) / _ALIKE
                if like > 0.0:
                    part = like * along[k]
                    size2 += part * part
                    for r in range(6):
                        u[r] += part * U[r, k]
                    for j in range(n):
                        v[j] += part * V[k, j]
            size, curvature = math.sqrt(size2), 0.0
            for j in range(n):
                v[j] /= size
            way = bend(J, v, v, length)
            for r in range(6):
                curvature += u[r] / size * way[r]
            # A singularity without curvature, as a wrist's, is no boundary: nothing is held there.
            bound = min(1.0, abs(curvature) / _CURVED)
            if curvature > 0.0:
                answered = max(natural, _full_gain(s, region, damping))
            else:
                room = max(0.0, s - floor)
                fastest = math.sqrt(2.0 * _BRAKING * room / max(-curvature, 1e-9))
                answered = min(natural, fastest / size)
            # All of that up to 1.5 σ0, and nothing of it from 2 σ0.
            bound *= min(1.0, max(0.0, 2.0 * (2.0 - s / region)))
            gain += bound * (answered - natural)
            below = _below(s, floor)
            if below > 0.0:
                left = (1.0 - share) * (natural if curvature >= 0.0 else min(natural, gain))
                gain = 0.0 if turned else gain + below * (left - gain)
            singular = singular or below > 0.0 or gain * s < 0.999
        for j in range(n):
            dq[j] += gain * d * V[i, j]
    return dq, singular


@compiled(MATRIX, NUMBER, MATRIX, VECTOR, MATRIX, MATRIX, VECTOR, NUMBER, NUMBER)
def _unfelt(
    J: Array, length: float, U: Array, sigma: Array, V: Array, null: Array, along: Array,
    region: float, floor: float,
) -> tuple[Array, float, Array, Array, Array]:  # fmt: skip
    """Return what is asked below the floor, along U (6,), its size, and what is hardly felt there.

    Motions, orthogonal (m, n), scaled by how little they are felt, and of unit size; and how they
    bend along what is asked (m, m), the symmetric part.
    """
    rank, n = V.shape
    below = _all_below(sigma, rank, floor)
    parts, size, u = np.empty(6), 0.0, np.zeros(6)
    for i in range(6):
        parts[i] = below[i] * along[i]
        size += parts[i] * parts[i]
    size = math.sqrt(size)
    first = rank
    while first > 0 and sigma[first - 1] < region:
        first -= 1
    m = n - first
    basis, rows, bends = np.empty((m, n)), np.empty((m, n)), np.zeros((m, m))
    if size <= _NONE:
        return parts, size, basis, rows, bends
    for r in range(6):
        for i in range(6):
            u[r] += parts[i] / size * U[r, i]
    for k in range(m):
        scale = 1.0
        if first + k < rank:
            scale = min(1.0, (region - sigma[first + k]) / (region - floor))
        for j in range(n):
            rows[k, j] = V[first + k, j] if first + k < rank else null[first + k - rank, j]
            basis[k, j] = scale * rows[k, j]
    for a in range(m):
        for b in range(m):
            way = bend(J, basis[a], basis[b], length)
            for r in range(6):
                bends[a, b] += 0.5 * u[r] * way[r]
                bends[b, a] += 0.5 * u[r] * way[r]
    return parts, size, basis, rows, bends


@compiled(MATRIX, NUMBER, MATRIX, VECTOR, COUNT, VECTOR, VECTOR, NUMBER, NUMBER)
def _bending(
    J: Array, length: float, U: Array, sigma: Array, rank: int, parts: Array, direction: Array,
    floor: float, per_bend: float,
) -> float:  # fmt: skip
    """Return the share of what is asked (6,) that a motion (n,) answers as it bends.

    Its bend counts where directions are below the floor: times `per_bend` [rad²/m], up to 1, and
    as far as it is along what is asked.
    """
    below = _all_below(sigma, rank, floor)
    way, size2, bend2, common = bend(J, direction, direction, length), 0.0, 0.0, 0.0
    for i in range(6):
        part = 0.0
        for r in range(6):
            part += U[r, i] * way[r]
        part *= below[i]
        size2 += parts[i] * parts[i]
        bend2 += part * part
        common += parts[i] * part
    if common <= 0.0:
        return 0.0
    most = math.sqrt(bend2)
    return min(1.0, most * per_bend) * common / (most * math.sqrt(size2))


@compiled(VECTOR, VECTOR, VECTOR, NUMBER, NUMBER)
def _bounded(
    felt: Array, home: Array, along: Array, region: float, damping: float
) -> tuple[Array, float]:
    """Return both rates (n,) together, no greater than damping alone bounds them, and the share."""
    asked = rate = 0.0
    for i in range(6):
        asked += along[i] * along[i]
    for j in range(len(felt)):
        rate += (felt[j] + home[j]) ** 2
    most = math.sqrt(asked) / (2.0 * damping * math.sqrt(1.0 - (damping / region) ** 2))
    share = min(1.0, most / max(math.sqrt(rate), 1e-12))
    dq = np.empty(len(felt))
    for j in range(len(felt)):
        dq[j] = share * (felt[j] + home[j])
    return dq, share
