"""Tool rates into joint rates, beside singularities too (Williams 1997, eqs. 2 and 7)."""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from ....config.schema.cell import ResolveSection
from ..axes import HeldAxes
from ..compiled import COUNT, FLAG, MATRIX, NUMBER, ROW, VECTOR, compiled, inner_kernel, record
from ..inputs import Fold
from ..linalg import svd
from ..spatial import Array, dot

# --- Damped joint rates beside a singularity, and the curvature of the workspace's boundary:
# kernels
#
# `resolution.py` says how they make an answer.

Apart = tuple[Array, float, Array, Array, Array, Array, Array]
DIRECTIONS = record(MATRIX, NUMBER, MATRIX, VECTOR, MATRIX, MATRIX, VECTOR)
"""`singularity.Directions`, as a plain tuple."""

CURVED = 0.05
"""Curvature from which a singularity counts as a boundary of the workspace [m/rad²]."""

_BRAKING = 3.0
"""Deceleration with which joints approach a boundary of the workspace [rad/s²]."""

_ALIKE = 0.5
"""Singular values that differ by less than this part of the larger are looked at together [1]."""

_UNKNOWN = 0.1
"""Below this part of the floor a direction may be mixed with those that are never reached [1]."""

NO_COMMAND = 1e-9
"""A command along a direction is none below this [m/s]."""


@inner_kernel
def damped_gain(sigma: float, region: float, damping: float) -> float:
    """Return joint rate per tool rate along a direction [1/m]."""
    if sigma >= region:
        return 1.0 / sigma
    return sigma / (sigma**2 + damping**2 * (1.0 - (sigma / region) ** 2))


@inner_kernel
def full_gain(sigma: float, region: float, damping: float) -> float:
    """Return the damped gain, no weaker than at λm: there it is about greatest."""
    return damped_gain(max(sigma, damping), region, damping)


@inner_kernel
def _below(sigma: float, floor: float) -> float:
    """Return how far a singular value is below the floor: 0 there, 1 from half of it."""
    return min(1.0, max(0.0, 2.0 * (1.0 - sigma / floor)))


@inner_kernel
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
    """Return the tool's acceleration (6,) under joint motions a and b (n,): (∂J/∂q · a) b.

    In closed form: of two joints, the one nearer to the base turns what the other does,
    ∂_k v_j = ω_min(j,k) × v_max(j,k), and ∂_k ω_j = ω_k × ω_j for k < j, else 0. Rotations weigh
    `length` [m/rad].
    """
    found, w, v = np.zeros(6), np.zeros(3), np.zeros(3)
    for j in range(J.shape[1]):
        for i in range(3):
            v[i] += a[j] * J[i, j]
    for j in range(J.shape[1]):
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


@inner_kernel
def _damp(
    at: Apart, share: float, turned: bool, region: float, damping: float, floor: float, dq: Array
) -> bool:
    """Add rates (n,) [rad/s] along the directions' own motions; return whether damping acts.

    The way home answers `share` of the command below the floor, in place of these.
    """
    J, length, U, sigma, V, _, along = at
    rank, n = V.shape
    singular = False
    u, v = np.empty(6), np.empty(n)
    for i in range(rank):
        s, d = sigma[i], along[i]
        natural = damped_gain(s, region, damping)
        gain = natural
        if s < 2.0 * region and abs(d) > NO_COMMAND:
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
            bound = min(1.0, abs(curvature) / CURVED)
            if curvature > 0.0:
                answered = max(natural, full_gain(s, region, damping))
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
    return singular


@compiled(DIRECTIONS, VECTOR, NUMBER, FLAG, NUMBER, NUMBER, NUMBER, ROW, ROW)
def _answer_beside(
    at: Apart,
    way: Array,
    share: float,
    turned: bool,
    region: float,
    damping: float,
    floor: float,
    dq: Array,
    home: Array,
) -> bool:
    """Write the rates (n,) for a command, and their part along a way home (n,) [rad/s].

    They are no greater than damping alone bounds them. `share` and `turned` are those of the way;
    `dq` is zeros before. Returns whether damping acts.
    """
    sigma, V, along = at[3], at[4], at[6]
    singular = _damp(at, share, turned, region, damping, floor, dq)
    gain = full_gain(sigma[len(V) - 1], region, damping)
    asked = rate = 0.0
    for i in range(6):
        asked += along[i] * along[i]
    for j in range(len(dq)):
        home[j] = gain * way[j]
        rate += (dq[j] + home[j]) ** 2
    most = math.sqrt(asked) / (2.0 * damping * math.sqrt(1.0 - (damping / region) ** 2))
    part = min(1.0, most / max(math.sqrt(rate), 1e-12))
    for j in range(len(dq)):
        dq[j] = part * (dq[j] + home[j])
        home[j] *= part
    return singular


@compiled(DIRECTIONS, NUMBER, NUMBER)
def unfelt_motions(
    at: Apart, region: float, floor: float
) -> tuple[Array, float, Array, Array, Array]:
    """Return the command below the floor, along U (6,), its size, and motions hardly felt there.

    The motions are orthogonal (m, n): first scaled by how little they are felt, then of unit size.
    Last comes their curvature along the command (m, m), the symmetric part.
    """
    J, length, U, sigma, V, null, along = at
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
    if size <= NO_COMMAND:
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


@compiled(DIRECTIONS, VECTOR, VECTOR, NUMBER, NUMBER)
def bending_share(
    at: Apart, parts: Array, direction: Array, floor: float, per_bend: float
) -> float:
    """Return the share of the command below the floor (6,) that a motion (n,) answers as it bends.

    Its bend counts where directions are below the floor: times `per_bend` [rad²/m], up to 1, and
    as far as it is along the command.
    """
    J, length, U, sigma, V, _, _ = at
    below = _all_below(sigma, len(V), floor)
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


# --- Joint rates beside a singularity: held off its boundary, led home from it --------------------
#
# With u the tool direction that fades, v the joint motion that fades with it, σ the singular
# value and κ = uᵀ (∂J/∂q · v) v the curvature of the boundary: a command along u against κ
# leads out of the workspace, and the motion v that answers it is braked so as to end above σ =
# 0; one along κ leads home, and is answered with the full damped gain however small σ is.
#
# At σ = 0 there is more than one motion that the tool hardly feels, and v is any of them. The
# one that counts bends most along the command: the greatest eigenvalue of uᵀ (∂J/∂q · a) b over
# that whole space. The way home along it can be gone in two senses, elbow up and elbow down:
# that which is uphill in σ is chosen; joint limits decide where they leave only one open.
# Nothing else jumps:
#
# - directions whose singular values are nearly the same are looked at together, as the command
#   divides between them: where two cross, u and v are any of their sums;
# - from v to the motion that bends most the answer goes over between floor and half of it, and
#   motions count as unfelt the more the smaller their singular values are;
# - where σ is zero, u may be any sum with directions that the arm never reaches: close to there,
#   these count as well, as directions without a motion.

_TRAVEL = 0.4
"""A way home with less joint travel than this is not taken if the other has more [rad]."""

_SWIFT = 1.0
"""Commands above λm times this are damped in full; slower ones have half of it at most [rad/s]."""

_LEAST_DAMPING = 0.25
"""Part of λm with which the slowest commands are damped, so that noise moves nobody [1]."""

_SHARED = 0.2
"""Motions whose curvatures differ by less than this part of the greatest share the way home [1]."""


class Travel(NamedTuple):
    """How far each joint may still go (n,) [rad]."""

    below: Array
    above: Array

    def along(self, direction: Array) -> float:
        """Return how far all joints can go along a unit direction (n,) before one is stopped."""
        room = np.where(direction > 0.0, self.above, self.below)
        return float((room / np.maximum(np.abs(direction), 1e-9)).min())

    def beside(self, more: int) -> "Travel":
        """Return that of so many `more` joints, which go as far as they like."""
        far = np.full(more, math.inf)
        return Travel(np.concatenate([self.below, far]), np.concatenate([self.above, far]))


class Directions(NamedTuple):
    """The weighted Jacobian taken apart, and a command."""

    J: Array
    """The Jacobian (6, n), not weighted; without the slack of a task's rows."""
    length: float
    """Rotations weigh so much [m/rad]."""
    U: Array
    """Tool directions (6, 6); of a task that leaves axes free, what it holds of them."""
    sigma: Array
    """Singular values (6,); zero for directions that the arm never reaches."""
    V: Array
    """Joint motions (r, n) of the directions that it reaches, the first ones; slack comes last."""
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


class Resolved(NamedTuple):
    """Joint rates for a tool rate."""

    dq: Array
    """Task part (n,) [rad/s]."""
    null: Array
    """Orthonormal rows (n − rank, n) that span the spare motions: I − J⁺J = nullᵀ null."""
    sigma_min: float
    """Least singular value of the weighted Jacobian, of axes that the arm reaches at all [m]."""
    singular: bool
    """True where damping acts on what was asked."""
    way_home: Array | None = None
    """The part (n,) of dq that leads home from a singularity, whose side is chosen; None: none."""


def answer(at: Directions, p: ResolveSection, travel: Travel | None) -> Resolved:
    """Return the rates (n,) [rad/s] that answer a command beside a singularity."""
    region, asked = p.singular_region, math.sqrt(dot(at.along, at.along))
    damping = max(_LEAST_DAMPING * p.damping, min(p.damping, asked / _SWIFT))
    least, n = float(at.sigma[len(at.V) - 1]), at.V.shape[1]
    way = _way_home(at, p, travel) if least < p.floor else None
    found = way or _WayHome(np.zeros(n), 0.0, False)
    dq, home = np.zeros(n), np.empty(n)
    singular = _answer_beside(at[:], *found, region, damping, p.floor, dq, home)
    return Resolved(dq, at.null, least, singular, None if way is None else home)


def _way_home(at: Directions, p: ResolveSection, travel: Travel | None) -> _WayHome | None:
    """Return the motion that the tool hardly feels and that bends most along a command."""
    parts, size, basis, rows, bend = unfelt_motions(at[:], p.singular_region, p.floor)
    if size <= NO_COMMAND:
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
    if size_uphill <= 1e-3 * NO_COMMAND * size:
        direction = vectors[:, -1] @ basis
        size_uphill = math.sqrt(float(direction @ direction))
    direction = direction / size_uphill
    per_bend = lead / most / CURVED
    share = bending_share(at[:], parts, direction, p.floor, per_bend)
    if share <= 0.0:
        return None
    turned = travel is not None and (
        travel.along(direction) < min(_TRAVEL, travel.along(-direction))
    )
    return _WayHome((-1.0 if turned else 1.0) * share * size * direction, share, turned)


# --- Tool rates into joint rates: dq = J⁺ẋ + (I − J⁺J) z (Williams 1997, eqs. 2 and 7) ------------
#
# Exact away from singularities. Near one, damping grows smoothly as the singular value falls,
# λᵢ² = λm² (1 − (σᵢ/σ₀)²), so nothing jumps, and |dq| ≤ |ẋ| / (2 λm √(1 − λm²/σ₀²)). What is left
# of a way to a goal beside a singularity would take minutes so: a slow command needs less, and λm
# falls with its size (as Chan and Lawrence 1988 let it fall with the error), to a quarter. Damping
# alone would let an arm creep ever closer to a singularity that bounds its workspace, such as
# the stretched elbow, and then hold it there: at σ = 0 the joints hear nothing of a command to
# come back. So the direction that a small singular value belongs to is looked at one derivative
# further (`resolution.py`). For a fixed twist the rates are a continuous function of the
# posture, but for one choice: the side to which an elbow at σ ≈ 0 bends.
#
# Some arms never reach some axes: a planar chain moves in three, five joints in five. What is
# asked along the others is not answered, and does not count as a singularity. Nor is what a task
# leaves free: its rows alone are resolved (`axes.py`), with the slack of those that fade as joints
# beyond the arm's, which bend nothing.


def resolve(
    J: Array,
    twist: Array,
    p: ResolveSection,
    travel: Travel | None = None,
    rank: int | None = None,
    held: HeldAxes | None = None,
) -> Resolved:
    """Resolve a twist (6,) [m/s, rad/s] with a chain's Jacobian J (6, n), same axes and point.

    Rotations weigh `p.characteristic_length` metres per radian. `travel` tells which way home from
    a singularity joint limits leave open; `rank` how many axes the arm reaches anywhere, the lesser
    of 6 and n by default; `held` which axes of the point that J is at the task holds, with `rank`
    of its rows reached; None: all.
    """
    length, n = p.characteristic_length, J.shape[1]
    if held is not None:
        twist = held.part(twist)
    U, s, Vt = svd(J if held is None else held.rows(J), length)
    rank = len(s) if rank is None else rank
    if rank == 0:
        return Resolved(np.zeros(n), np.eye(n), math.nan, False)
    sigma_min = float(s[rank - 1])
    along, dq = np.zeros(6), np.zeros(len(Vt))
    _answer(U, s, Vt, twist, length, rank, along, dq)
    # Rows of V belong to real task directions even where σ is small: motion in the null space
    # must not disturb them.
    null = Vt[rank:]
    if held is not None:
        dq, null = dq[:n], null[:, :n].copy()
    if sigma_min >= 2.0 * p.singular_region:
        return Resolved(dq, null, sigma_min, False)
    sigma = np.zeros(6)
    sigma[:rank] = s[:rank]
    if held is not None:
        U, travel = held.keep @ U, None if travel is None else travel.beside(Vt.shape[0] - n)
    found = answer(Directions(J, length, U, sigma, Vt[:rank], Vt[rank:], along), p, travel)
    if held is None:
        return found
    home = None if found.way_home is None else found.way_home[:n]
    return found._replace(dq=found.dq[:n], null=null, way_home=home)


@compiled(MATRIX, VECTOR, MATRIX, VECTOR, NUMBER, COUNT, ROW, ROW)
def _answer(
    U: Array,
    s: Array,
    Vt: Array,
    twist: Array,
    length: float,
    rank: int,
    along: Array,
    dq: Array,
) -> None:
    """Write the parts (6,) of the weighted twist along U, and rates (n,) that answer in full.

    From U (6, 6), singular values (r,) and Vt (n, n) of the weighted Jacobian. Of the parts the
    first `rank` are answered. Both are zeros before.
    """
    for i in range(6):
        for k in range(6):
            along[i] += U[k, i] * (twist[k] if k < 3 else length * twist[k])
        if i < rank:
            rate = along[i] / s[i]
            for j in range(len(dq)):
                dq[j] += rate * Vt[i, j]


# --- Joints that are commanded directly: jogged, led to a posture, or beside the tool -------------
#
# The rates z of joints that fold are both a source's, J z, and a redundancy objective's, the rest
# (`reflex` in either table).

GAIN = 4.0
"""Approach to a posture close to it [1/s]."""

REACHED = 2e-4
"""A posture is reached within this angle of every joint [rad]."""


class JointMotion:
    """Rates of joints that are commanded themselves, in place of a tool motion."""

    def __init__(self, velocity: Array, approach: Callable[[Array], Array]) -> None:
        """Build it for joints with bounds of speed (n,) [rad/s].

        `approach` gives the rates (n,) at which joints can still stop within ways (n,) [rad].
        """
        self._velocity, self._approach = velocity, approach

    def rates(
        self, q: Array, jog: Array | None, posture: Array | None, speed_factor: float
    ) -> Array | None:
        """Return joint rates (n,) at q (n,): the jog's, else a posture's; None for neither.

        Towards a posture all joints go in a straight line, as fast as each can still stop at it.
        """
        if jog is not None:
            return jog
        if posture is None:
            return None
        error = posture - q
        size = np.maximum(np.abs(error), 1e-9)
        fastest = np.minimum(self._approach(size), speed_factor * self._velocity)
        return np.asarray(error * min(GAIN, float((fastest / size).min())))

    def folding(self, fold: Fold, q: Array, J: Array, factor: float) -> Array:
        """Return joint rates (n,) from q (n,) to a posture that the arm folds to, in proportion.

        J (6, n) is the tool's, `factor` the reduced-speed setting.
        """
        goal = np.where(np.isnan(fold.posture), q, fold.posture)
        dq = self.rates(q, None, goal, factor)
        if dq is None:
            return np.zeros(len(q))
        v = float(np.linalg.norm(J[:3] @ dq))
        return dq * min(1.0, factor * fold.speed / max(v, 1e-12))


def at_posture(q: Array, posture: Array) -> bool:
    """Return whether joints at q (n,) have reached a posture (n,)."""
    return bool(np.abs(posture - q).max() < REACHED)


FOLDING: Final = "reflex"
"""Name of what folds an arm, among the sources and the objectives."""
