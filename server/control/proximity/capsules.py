"""The arm as capsules on a forest of joints: fitted, placed; how far they travel."""

import math
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin

from ....config.errors import ConfigError
from ....config.load import Cell
from ..compiled import (
    COUNTS,
    FLAGS,
    FLAGS2,
    INDEX,
    MATRIX,
    NUMBER,
    ROW,
    TABLE,
    VECTOR,
    compiled,
    inner_kernel,
)
from ..forest import Bases, Branch, Forest
from ..linalg import Vector
from ..scene import Flags, Index
from ..spatial import Array, Pose
from .distance import NEAREST, PAIRS, PLACED, Near, Pairs, PlacedArrays

# --- Bounds on the travel of links: by motions of the joints, and carried by a Base that moves ----

CURVED: Final = 1e-9
"""Below this sum of ways a lever does not grow [1]."""

_UNIT: Final = 1e-9
"""An axis of a length that differs from 1 by less is of unit length; wheels have shorter ones."""


def levers(placed: PlacedArrays, moves: Flags, prismatic: Flags) -> Array:
    """Return the levers (c, n) [m] of capsules at the first posture, as `Capsules.levers` says.

    `moves` (c, n) tells which joints move them, `prismatic` (n,) which joints slide.
    """
    lever = np.zeros(moves.shape)
    _lever(placed, moves, prismatic, lever)
    return lever


@compiled(PLACED, FLAGS2, FLAGS, TABLE)
def _lever(placed: PlacedArrays, moves: Flags, prismatic: Flags, lever: Array) -> None:
    ends, frames, axes = placed
    for c in range(len(moves)):
        for j in range(moves.shape[1]):
            if not moves[c, j]:
                continue
            if prismatic[j]:
                lever[c, j] = 1.0
                continue
            farthest, axis2 = 0.0, 0.0
            for i in range(3):
                axis2 += axes[0, j, i] ** 2
            if abs(axis2 - 1.0) < _UNIT:
                axis2 = 1.0
            for e in range(2):
                length2, along = 0.0, 0.0
                for i in range(3):
                    arm = ends[0, c, e, i] - frames[0, j, i, 3]
                    length2 += arm * arm
                    along += arm * axes[0, j, i]
                farthest = max(farthest, length2 - along * along / axis2)
            lever[c, j] = math.sqrt(farthest)


@compiled(MATRIX, VECTOR)
def travel(lever: Array, way: Array) -> Array:
    """Return how far capsules move at most (c,) [m] when joints move by no more than `way` (n,).

    The levers (c, n) themselves grow with the motion: D' ≤ Σ way (lever + D), so that
    D ≤ lever·way (exp(σ) − 1)/σ with σ the sum of all ways.
    """
    total = 0.0
    for j in range(len(way)):
        total += way[j]
    growth = math.expm1(total) / total if total > CURVED else 1.0
    found = np.zeros(len(lever))
    for c in range(len(lever)):
        for j in range(len(way)):
            found[c] += lever[c, j] * way[j]
        found[c] *= growth
    return found


def surroundings(
    placed: PlacedArrays, moves: Flags, prismatic: Flags,
    speed: Array, acceleration: Array, factor: float, lag: float, margin: float,
) -> tuple[Array, Array]:  # fmt: skip
    """Return the levers (c, n) [m], and the search radii around capsules (c,) [m].

    A capsule travels so far before joints at `speed` (n,) stand, which brake at `factor` times
    `acceleration` (n,) after `lag` [s]; plus `margin` [m].
    """
    lever, around = np.zeros(moves.shape), np.empty(len(moves))
    _surround(placed, moves, prismatic, speed, acceleration, factor, lag, margin, lever, around)
    return lever, around


@compiled(PLACED, FLAGS2, FLAGS, VECTOR, VECTOR, NUMBER, NUMBER, NUMBER, TABLE, ROW)
def _surround(
    placed: PlacedArrays, moves: Flags, prismatic: Flags,
    speed: Array, acceleration: Array, factor: float, lag: float, margin: float,
    lever: Array, around: Array,
) -> None:  # fmt: skip
    _lever(placed, moves, prismatic, lever)
    way = np.empty(len(speed))
    for j in range(len(speed)):
        way[j] = speed[j] * (lag + 0.5 * speed[j] / (factor * acceleration[j]))
    gone = travel(lever, way)
    for c in range(len(gone)):
        around[c] = gone[c] + margin


@inner_kernel
def _velocity(twist: Array, p: Array, x: float, y: float, z: float) -> Vector:
    """Return the velocity at a place of a body at p (3,) that moves with a twist (6,)."""
    wx, wy, wz = twist[3], twist[4], twist[5]
    x, y, z = x - p[0], y - p[1], z - p[2]
    return twist[0] + wy * z - wz * y, twist[1] + wz * x - wx * z, twist[2] + wx * y - wy * x


@compiled(NEAREST, INDEX, INDEX, VECTOR, MATRIX, MATRIX)
def carried(
    near: Near, first: Index, second: Index, speed: Array, places: Array, twists: Array
) -> tuple[Array, Array]:
    """Return `speed` and `carried` (k,), as in `NearPairs`, where Bases move with twists (r, 6).

    The Bases are at `places` (r, 3) [m]; `first` and `second` (k,) tell which of them carries
    either side of a pair, −1 for what none does. Two sides on one Base are at rest to it.
    """
    distance, normal, place = near
    nearer, fastest = speed.copy(), np.zeros(len(speed))
    for i in range(len(speed)):
        a, b = first[i], second[i]
        if a == b:
            continue
        x, y, z = place[i]
        nx, ny, nz = normal[i]
        vx, vy, vz = _velocity(twists[a], places[a], x, y, z)
        if b >= 0:
            x, y, z = x - distance[i] * nx, y - distance[i] * ny, z - distance[i] * nz
            ux, uy, uz = _velocity(twists[b], places[b], x, y, z)
            vx, vy, vz = vx - ux, vy - uy, vz - uz
        closing = -(nx * vx + ny * vy + nz * vz)
        nearer[i] = max(speed[i] + closing, 0.0)
        fastest[i] = math.sqrt(vx * vx + vy * vy + vz * vz)
    return nearer, fastest


def doubtful(
    lever: Array, way: Array, room: Array, pairs: Pairs, gap: Array, least: Array
) -> tuple[bool, Index, Array]:
    """Return which pairs may come below `least` (k,) [m], and how much closer each may come [m].

    `way` (n,) is how far joints move at most, `lever` (c, n) the capsules'. The first result is
    whether any capsule leaves its `room` (c,) [m]: then other pairs matter, too.
    """
    which, closer = np.empty(len(gap), dtype=np.int64), np.empty(len(gap))
    leaves, found = _doubt(lever, way, room, pairs, gap, least, which, closer)
    return leaves, which[:found], closer[:found]


@compiled(MATRIX, VECTOR, VECTOR, PAIRS, VECTOR, VECTOR, COUNTS, ROW)
def _doubt(
    lever: Array, way: Array, room: Array, pairs: Pairs, gap: Array, least: Array,
    which: Index, closer: Array,
) -> tuple[bool, int]:  # fmt: skip
    """Write what `doubtful` returns; return whether a capsule leaves, and how many there are."""
    (first, second), gone = pairs, travel(lever, way)
    found, leaves = 0, False
    for c in range(len(gone)):
        leaves = leaves or gone[c] > room[c]
    for i in range(len(gap)):
        together = gone[first[i]]
        if second[i] < len(gone):
            together += gone[second[i]]
        if gap[i] - together < least[i]:
            which[found], closer[found] = i, together
            found += 1
    return leaves, found


# --- The arm as capsules: fitted around the primitives of its URDF, placed and differentiated -----

SLACK = 1e-9
"""A part that sticks out of another by less is inside it [m]."""


class Capsule(NamedTuple):
    """All points within a radius of a segment that is fixed to a body."""

    link: str
    body: int
    start: Array
    end: Array
    radius: float


class Placed(NamedTuple):
    """The capsules' segments at s postures, in World."""

    ends: Array
    """(s, c, 2, 3) [m]."""
    frames: Array
    """The joints' frames (s, n, 3, 4)."""
    axes: Array
    """The joints' axes (s, n, 3)."""


class Capsules:
    """The c capsules of a cell's arms, from Base to tool."""

    def __init__(self, cell: Cell) -> None:
        """Fit them. Raises `ConfigError` for a shape that needs a capsule from the cell."""
        self.forest = forest = Forest(cell)
        self.each = fitted(cell, forest)
        self.links = tuple(c.link for c in self.each)
        """Names of their links (c,)."""
        self.radius = np.array([c.radius for c in self.each])
        self.body: Index = np.array([c.body for c in self.each], dtype=np.int64)
        self.moves = forest.moves(self.body)
        """Which joints move each of them (c, n)."""
        self.movable = tuple(bool(row.any()) for row in self.moves)
        """Which of them any joint moves (c,)."""
        self.half_length = np.array([0.5 * float(_length(c.end - c.start)) for c in self.each])
        self._segments = np.array([[c.start, c.end] for c in self.each]).reshape(-1, 2, 3)
        origins = forest.frames(np.zeros((1, forest.n)))[0, :, :, 3]
        steps = [
            float(_length(origins[j] - origins[parent])) if parent >= 0 else 0.0
            for j, parent in enumerate(forest.tree.parent.tolist())
        ]
        self._steps = np.array(steps) + forest.stroke
        """From each joint's origin to that of its parent, at most (n,) [m]."""
        places = [forest.bases[forest.root(j + 1)].p for j in range(forest.n)]
        self._from_root = _length(origins - np.array(places))
        """From each joint's origin to its root, at zero (n,) [m]."""

    def place(self, q: Array, T_world_base: Bases = None) -> Placed:
        """Return where the capsules are at postures q (s, n) [rad]."""
        return Placed(*self.forest.placed(q, self.body, self._segments, T_world_base))

    def levers(self, placed: Placed) -> Array:
        """Return the distances of capsules from the joints' axes at one posture (c, n) [m].

        Of either end, the farther; zero for joints that do not move it, 1 for prismatic ones.
        """
        return levers(placed[:], self.moves, self.forest.tree.prismatic)

    def reach(self, body: int, far: float) -> Array:
        """Return bounds on the levers (n,) [m] of a point `far` from the origin of a body.

        They hold at every posture: the way along the joints is never longer.
        """
        forest, joint = self.forest, body - 1
        lever = np.zeros(forest.n)
        if joint >= 0:
            lever[joint] = way = far + forest.stroke[joint]
            while (parent := int(forest.tree.parent[joint])) >= 0:
                lever[parent] = way = way + self._steps[joint]
                joint = parent
            branch = forest.branches[forest.root(body)]
            if branch.rolling is not None:
                turns = math.hypot(branch.rolling.centre, 0.5 * branch.rolling.track)
                far = way + float(self._from_root[joint]) + turns
                lever[branch.wheels] = far * branch.rolling.turn
        prismatic = forest.tree.prismatic
        lever[prismatic] = np.minimum(lever[prismatic], 1.0)
        return lever


def fitted(cell: Cell, forest: Forest) -> tuple[Capsule, ...]:
    """Return the capsules around a cell's arms: of their URDFs, then what the cell adds.

    Raises `ConfigError` for a link whose shape is a mesh and that the cell gives no capsule.
    """
    stated = cell.config.avoidance.capsules
    if cell.prefix and not cell.others:  # one of several: the file tells of all
        stated = tuple(given for given in stated if given.link.startswith(cell.prefix))
    bodies: list[tuple[int, Pose]] = []
    for i, given in enumerate(stated):
        named = [("link", given.link), *((f"holds[{k}]", x) for k, x in enumerate(given.holds))]
        for key, link in named:
            where = f"{cell.path}: avoidance.capsules[{i}].{key}: value '{link}'"
            try:
                found_at = forest.body_of(link)
            except KeyError:
                raise ConfigError(f"{where}: no such link in {cell.robot.urdf}") from None
            if key == "link":
                bodies.append(found_at)
            elif found_at[0] != bodies[-1][0]:
                raise ConfigError(
                    f"{where}: must be fixed to '{given.link}', and a joint parts them"
                )
    found = []
    known = {link for given in stated for link in (given.link, *given.holds)}
    for part, branch in zip(cell.parts, forest.branches, strict=True):
        found += _of_urdf(part, branch, known)
    for given, (body, T) in zip(stated, bodies, strict=True):
        a, b = T.R @ np.array(given.start) + T.p, T.R @ np.array(given.end) + T.p
        found.append(Capsule(given.link, body, a, b, given.radius))
    outer = [c for i, c in enumerate(found) if not _inside_another(c, i, found)]
    return tuple(sorted(outer, key=lambda c: c.body))


def _of_urdf(part: Cell, branch: Branch, stated: set[str]) -> list[Capsule]:
    """Return the capsules around the primitives of one mechanism's URDF.

    Links whose capsules are `stated` may have any shape.
    """
    found: list[Capsule] = []
    bare = [link for link in part.robot.mesh_links() if branch.prefix + link not in stated]
    if bare:
        raise ConfigError(
            *(
                f"{part.path}: avoidance.capsules: link '{branch.prefix}{link}' of "
                f"{part.robot.urdf} is a mesh: give it capsules here"
                for link in bare
            )
        )
    for shape in _collision_shapes(part, branch):
        link = branch.prefix + branch.model.frames[shape.parentFrame].name
        body, T = branch.carried(shape.parentJoint, shape.placement)
        around = _around(shape.geometry)
        if around is not None:
            axis, radius = around
            found.append(Capsule(link, body, T.p - T.R @ axis, T.p + T.R @ axis, radius))
        elif link not in stated:
            raise ConfigError(
                f"{part.path}: avoidance.capsules: link '{link}' of {part.robot.urdf} is a "
                f"{type(shape.geometry).__name__}: give it capsules here"
            )
    return found


def _collision_shapes(cell: Cell, branch: Branch) -> list["pin.GeometryObject"]:
    description = cell.robot.description()
    try:
        geometry = pin.buildGeomFromUrdfString(
            branch.model, description, pin.GeometryType.COLLISION
        )
    except (ValueError, RuntimeError) as error:
        words = str(error).splitlines()[0]
        raise ConfigError(f"{cell.robot.urdf}: <collision>: {words}") from None
    return list(geometry.geometryObjects)


def _around(shape: object) -> tuple[Array, float] | None:
    """Return half the segment (3,) and the radius of a capsule around a primitive, or None."""
    match type(shape).__name__:
        case "Sphere":
            return np.zeros(3), float(shape.radius)  # type: ignore[attr-defined]  # untyped
        case "Cylinder" | "Capsule":
            along = np.array([0.0, 0.0, float(shape.halfLength)])  # type: ignore[attr-defined]  # untyped
            return along, float(shape.radius)  # type: ignore[attr-defined]  # untyped
        case "Box":
            half = np.array(shape.halfSide)  # type: ignore[attr-defined]  # untyped
            k = int(np.argmax(half))
            across = np.delete(half, k)
            return np.eye(3)[k] * half[k], float(_length(across))
        case _:
            return None


def _inside_another(capsule: Capsule, i: int, others: list[Capsule]) -> bool:
    """Return whether a capsule lies inside another one of its body; of equal ones, the later."""
    for k, other in enumerate(others):
        if k == i or other.body != capsule.body:
            continue
        room = other.radius - capsule.radius + SLACK
        inside = all(_distance(p, other) <= room for p in (capsule.start, capsule.end))
        if inside and not (k > i and _inside_another_exactly(other, capsule)):
            return True
    return False


def _inside_another_exactly(inner: Capsule, outer: Capsule) -> bool:
    room = outer.radius - inner.radius + SLACK
    return all(_distance(p, outer) <= room for p in (inner.start, inner.end))


def _distance(point: Array, capsule: Capsule) -> float:
    """Return the distance of a point from a capsule's segment [m]."""
    along = capsule.end - capsule.start
    length2 = float(along @ along)
    part = 0.0 if length2 == 0.0 else float(along @ (point - capsule.start)) / length2
    return float(_length(point - capsule.start - min(1.0, max(0.0, part)) * along))


def _length(v: Array) -> Array:
    return np.asarray(np.sqrt((v * v).sum(-1)))
