"""The arm as capsules on a forest of joints: fitted, placed, differentiated; their travel."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin

from ....config.errors import ConfigError
from ....config.load import Cell
from ..compiled import (
    ARRAY3,
    ARRAY4,
    BLOCK,
    COUNTS,
    FLAGS,
    FLAGS2,
    INDEX,
    MATRIX,
    NUMBER,
    ROW,
    STACK,
    TABLE,
    VECTOR,
    compiled,
)
from ..scene import Flags, Index
from ..spatial import Array, Pose
from ..wheels import DifferentialDrive, Rolled
from .distance import PAIRS, PLACED, ROOTS, TREE, Pairs, PlacedArrays, Roots, TreeArrays

# --- Forward kinematics of a forest of joints at several postures: frames, axes and segments at
# once
#
# A joint's frame in its parent's is a constant plus two constants times functions of its angle
# (Rodrigues). A parent is a joint before it, or a root, whose pose in World the caller gives.


def frames_at(tree: TreeArrays, q: Array, roots: Roots) -> Array:
    """Return the joints' frames (s, n, 3, 4) in World at postures q (s, n) [rad or m]."""
    found = np.empty((*q.shape, 3, 4))
    _frame(tree, q, roots, found)
    return found


@compiled(TREE, MATRIX, ROOTS, BLOCK)
def _frame(tree: TreeArrays, q: Array, roots: Roots, found: Array) -> None:
    (parents, prismatic, parts, _), (R, p) = tree, roots
    postures, n = q.shape
    step = np.empty((3, 4))
    for s in range(postures):
        instant = min(s, len(p) - 1)
        for i in range(n):
            sine, cosine = q[s, i], 0.0
            if not prismatic[i]:
                sine, cosine = math.sin(q[s, i]), 1.0 - math.cos(q[s, i])
            for row in range(3):
                for k in range(4):
                    step[row, k] = parts[i, 0, row, k] + sine * parts[i, 1, row, k]
                    step[row, k] += cosine * parts[i, 2, row, k]
            parent, root = parents[i], -1 - parents[i]
            for row in range(3):
                if parent >= 0:
                    x, y = found[s, parent, row, 0], found[s, parent, row, 1]
                    z, place = found[s, parent, row, 2], found[s, parent, row, 3]
                else:
                    x, y = R[instant, root, row, 0], R[instant, root, row, 1]
                    z, place = R[instant, root, row, 2], p[instant, root, row]
                for k in range(4):
                    found[s, i, row, k] = x * step[0, k] + y * step[1, k] + z * step[2, k]
                found[s, i, row, 3] += place


def axes_at(frames: Array, axis: Array) -> Array:
    """Return axes (n, 3), given in frames (s, n, 3, 4), in World (s, n, 3)."""
    found = np.empty((len(frames), len(axis), 3))
    _turn(frames, axis, found)
    return found


@compiled(ARRAY4, MATRIX, STACK)
def _turn(frames: Array, axis: Array, found: Array) -> None:
    for s in range(len(frames)):
        for j in range(len(axis)):
            x, y, z = axis[j]
            for i in range(3):
                found[s, j, i] = (
                    frames[s, j, i, 0] * x + frames[s, j, i, 1] * y + frames[s, j, i, 2] * z
                )


def placed_at(
    tree: TreeArrays, q: Array, roots: Roots, body: Index, segments: Array
) -> tuple[Array, Array, Array]:
    """Return segments (c, 2, 3), fixed to bodies (c,), in World (s, c, 2, 3) [m].

    And the joints' frames, as `frames_at` has them, and their axes (s, n, 3).
    """
    postures, n = q.shape
    ends, frames = np.empty((postures, len(body), 2, 3)), np.empty((postures, n, 3, 4))
    axes = np.empty((postures, n, 3))
    _place(tree, q, roots, body, segments, ends, frames, axes)
    return ends, frames, axes


@compiled(TREE, MATRIX, ROOTS, INDEX, ARRAY3, BLOCK, BLOCK, STACK)
def _place(
    tree: TreeArrays,
    q: Array,
    roots: Roots,
    body: Index,
    segments: Array,
    ends: Array,
    frames: Array,
    axes: Array,
) -> None:
    _frame(tree, q, roots, frames)
    _turn(frames, tree[3], axes)
    (R, p), capsules = roots, len(body)
    for s in range(len(frames)):
        instant = min(s, len(p) - 1)
        for c in range(capsules):
            joint, root = body[c] - 1, -body[c]
            for row in range(3):
                if joint >= 0:
                    x, y = frames[s, joint, row, 0], frames[s, joint, row, 1]
                    z, place = frames[s, joint, row, 2], frames[s, joint, row, 3]
                else:
                    x, y = R[instant, root, row, 0], R[instant, root, row, 1]
                    z, place = R[instant, root, row, 2], p[instant, root, row]
                for e in range(2):
                    way = x * segments[c, e, 0] + y * segments[c, e, 1] + z * segments[c, e, 2]
                    ends[s, c, e, row] = way + place


# --- The joints of a cell as a forest: a tree for each root, read from the URDF -------------------


class Tree(NamedTuple):
    """n joints, parents before children."""

    parent: Index
    """Of each joint (n,): the joint that carries it, or −1 − r where root r does."""
    prismatic: Flags
    """Which joints are prismatic (n,); the others turn."""
    parts: Array
    """Of each joint (n, 3, 3, 4): its frame in its parent's at zero, and what is added by functions
    of its angle: times sin and 1 − cos, or times the way of a prismatic one and 0."""
    axis: Array
    """Axes (n, 3) in the joints' own frames."""

    @staticmethod
    def of_all(each: "Sequence[Tree]") -> "Tree":
        """Return the trees of several mechanisms as one."""
        return each[0] if len(each) == 1 else Tree(*map(np.concatenate, zip(*each, strict=True)))


class Branch:
    """The joints of one mechanism among those of the cell."""

    def __init__(self, part: Cell, first: int, root: int) -> None:
        """Read them from the URDF; those outside of the mechanism stand at zero.

        `first` of all joints is its first, and `root` carries them.
        """
        self.model = model = pin.buildModelFromXML(part.robot.description())
        self.prefix = part.prefix
        self._data, self._first, self._root = model.createData(), first, root
        pin.forwardKinematics(model, self._data, pin.neutral(model))
        self._ids = [model.getJointId(joint.name) for joint in part.robot.joints]
        self.n = len(self._ids)
        self.rolling = DifferentialDrive.from_cell(part)
        """The wheels that the root rolls on, its first two joints; None for one that stands."""
        self.tree = self._tree()
        base = part.config.mechanism.T_world_base
        self.T_world_base = Pose.from_xyz_rpy(base.xyz, base.rpy)
        far = [max(abs(joint.lower), abs(joint.upper)) for joint in part.robot.joints]
        self.stroke = np.where(self.tree.prismatic, far, 0.0)

    def body_of(self, link: str) -> tuple[int, Pose]:
        """Return the body that a link of the URDF is part of, and the link's pose in it.

        Raises `KeyError` for a link that the URDF does not have.
        """
        if not self.model.existFrame(link, pin.FrameType.BODY):
            raise KeyError(link)
        placed = self.model.frames[self.model.getFrameId(link, pin.FrameType.BODY)]
        return self.carried(placed.parentJoint, placed.placement)

    def carried(self, joint: int, placement: "pin.SE3") -> tuple[int, Pose]:
        """Return the body that carries a thing at a joint of the URDF, and its pose in the body."""
        own = self._carrier(joint)
        T = self._data.oMi[joint] * placement
        if own:
            T = self._data.oMi[self._ids[own - 1]].inverse() * T
        return self._body(own), Pose(T.rotation.copy(), T.translation.copy())

    def links(self, q: Array) -> dict[str, Pose]:
        """Return the pose in Base of every link of the URDF at joints q (n,), wheels turned."""
        data, way = self.model.createData(), np.zeros(self.model.nv)
        way[[self.model.joints[j].idx_v for j in self._ids]] = q
        whole = pin.integrate(self.model, pin.neutral(self.model), way)
        pin.framesForwardKinematics(self.model, data, whole)
        return {
            frame.name: Pose(T.rotation, T.translation)
            for frame, T in zip(self.model.frames, data.oMf, strict=True)
            if frame.type == pin.FrameType.BODY
        }

    def _body(self, own: int) -> int:
        """Return the number among all of a body that is counted from this mechanism's Base."""
        return self._first + own if own else -self._root

    def _carrier(self, joint: int) -> int:
        """Return which of the own bodies carries a joint of the URDF, or is moved by it."""
        supports = self.model.supports[joint].tolist()
        # What is on a wheel is as good as on the root: it turns in its own place.
        first = 0 if self.rolling is None else 2
        return max((self._ids.index(j) + 1 for j in supports if j in self._ids[first:]), default=0)

    def _tree(self) -> Tree:
        """Read the tree of the joints; Base is their root."""
        n, model, data = self.n, self.model, self._data
        parents = np.empty(n, dtype=np.int64)
        prismatic, parts, axes = np.zeros(n, dtype=bool), np.zeros((n, 3, 3, 4)), np.zeros((n, 3))
        for i, j in enumerate(self._ids):
            carrier = self._carrier(model.parents[j])
            before = data.oMi[self._ids[carrier - 1]] if carrier else pin.SE3.Identity()
            parents[i] = self._body(carrier) - 1
            placement = (before.inverse() * data.oMi[j]).homogeneous
            joint_data = model.joints[j].createData()
            model.joints[j].calc(joint_data, np.zeros(1))
            linear, angular = np.asarray(joint_data.S).reshape(2, 3)
            prismatic[i] = bool(linear.any())
            axes[i] = linear if prismatic[i] else angular
            parts[i, 0] = placement[:3]
            if prismatic[i]:
                parts[i, 1, :, 3] = placement[:3, :3] @ linear
            elif self.rolling is not None and i < 2:
                # The wheel turns all that the root carries about the other one's place.
                side = 1.0 if i else -1.0
                parts[i, 0] = np.eye(3, 4)
                parts[i, 0, 1, 3] = side * 0.5 * self.rolling.track
                axes[i] = 0.0, 0.0, side * self.rolling.turn
            else:
                K = pin.skew(angular)
                parts[i, 1, :, :3] = placement[:3, :3] @ K
                parts[i, 2, :, :3] = placement[:3, :3] @ K @ K
        return Tree(parents, prismatic, parts, axes)


class Forest:
    """Forward kinematics of a cell's n joints, for capsules and control points.

    Bodies are numbered: joint j moves body j + 1; body −r is root r, the Base of mechanism r. The
    tick's own Jacobian is `model.py`'s, whose rounding the shipped hashes hold.
    """

    def __init__(self, cell: Cell) -> None:
        """Read the joints of every mechanism from its URDF, one after the other."""
        self.branches: tuple[Branch, ...] = ()
        """One for each mechanism."""
        self.n = 0
        for root, part in enumerate(cell.parts):
            self.branches += (Branch(part, self.n, root),)
            self.n += self.branches[-1].n
        self.tree = Tree.of_all([branch.tree for branch in self.branches])
        self.stroke = np.concatenate([branch.stroke for branch in self.branches])
        """How far each prismatic joint may be out (n,) [m]; zero for the others."""
        self._standing = _roots([branch.T_world_base for branch in self.branches])
        self.rolling = self.branches[0].rolling if len(self.branches) == 1 else None
        """The wheels that an only root rolls on."""
        self.gear = None if self.rolling is None else np.ones(self.n)
        """Angle of what a joint moves per angle of the joint (n,) [1]; None: 1 for all."""
        roots = len(self.branches)
        self._moves = np.zeros((roots + self.n, self.n), dtype=bool)
        if self.gear is not None and self.rolling is not None:
            self.gear[:2] = self.rolling.turn
            self._moves[roots - 1, :2] = True
        for j, parent in enumerate(self.tree.parent.tolist()):
            self._moves[roots + j] = self._moves[roots + parent]
            self._moves[roots + j, j] = True

    def frames(self, q: Array, T_world_base: Pose | None = None) -> Array:
        """Return the joints' frames (s, n, 3, 4) in World at postures q (s, n) [rad or m]."""
        return frames_at(self.tree[:], q, self._roots(T_world_base, q))

    def axes(self, frames: Array) -> Array:
        """Return the joints' axes (s, n, 3) in World, given their frames (s, n, 3, 4)."""
        return axes_at(frames, self.tree.axis)

    def placed(
        self, q: Array, body: Index, segments: Array, T_world_base: Pose | None = None
    ) -> tuple[Array, Array, Array]:
        """Return segments (c, 2, 3) on bodies (c,) at postures q (s, n), in World (s, c, 2, 3) [m].

        With the joints' frames (s, n, 3, 4) and axes (s, n, 3).
        """
        return placed_at(self.tree[:], q, self._roots(T_world_base, q), body, segments)

    def moves(self, body: Index) -> Flags:
        """Return which joints move bodies (c,): (c, n)."""
        return np.asarray(self._moves[len(self.branches) - 1 + body])

    def root(self, body: int) -> int:
        """Return the root that carries a body."""
        while body > 0:
            body = int(self.tree.parent[body - 1]) + 1
        return -body

    def body_of(self, link: str) -> tuple[int, Pose]:
        """Return the body that a link is part of, and the link's pose in it.

        With several mechanisms, `link` begins with the name of its own. Raises `KeyError` for a
        link that there is not.
        """
        for branch in self.branches:
            own = link.removeprefix(branch.prefix)
            if link.startswith(branch.prefix) and branch.model.existFrame(own, pin.FrameType.BODY):
                return branch.body_of(own)
        raise KeyError(link)

    def _roots(self, T_world_base: Pose | None, q: Array) -> Roots:
        """Return where the roots are; `T_world_base` is that of an only Base, which moves.

        One that rolls gets there as its wheels turn from one posture of q (s, n) to the next.
        """
        if T_world_base is None:
            return self._standing
        if self.rolling is None or not isinstance(T_world_base, Rolled):
            return _roots([T_world_base])
        R, p = self.rolling.places(T_world_base, q[:, :2])
        return R[:, None], p[:, None]


def _roots(poses: Sequence[Pose]) -> Roots:
    """Return the poses of the roots, at all postures."""
    return np.array([[T.R for T in poses]]), np.array([[T.p for T in poses]])


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


@compiled(MATRIX, MATRIX, INDEX, VECTOR, VECTOR)
def carried(
    normal: Array, lever: Array, obstacle: Index, speed: Array, twist: Array
) -> tuple[Array, Array]:
    """Return `speed` and `carried` (k,), as in `NearPairs`, where Base moves with a twist (6,).

    `lever` (k, 3) leads from Base to the places [m].
    """
    nearer, fastest = speed.copy(), np.zeros(len(speed))
    wx, wy, wz = twist[3:]
    for i in range(len(speed)):
        if obstacle[i] < 0:
            continue
        x, y, z = lever[i]
        vx = twist[0] + wy * z - wz * y
        vy = twist[1] + wz * x - wx * z
        vz = twist[2] + wx * y - wy * x
        closing = -(normal[i, 0] * vx + normal[i, 1] * vy + normal[i, 2] * vz)
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
        self._from_root = _length(origins - forest.branches[0].T_world_base.p)
        """From each joint's origin to the first root, at zero (n,) [m]."""

    def place(self, q: Array, T_world_base: Pose | None = None) -> Placed:
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
            if forest.rolling is not None and forest.gear is not None:
                far = way + float(self._from_root[joint]) + 0.5 * forest.rolling.track
                lever[:2] = far * forest.gear[:2]
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
