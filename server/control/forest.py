"""A cell's joints as a forest of trees: frames, Jacobians, and the torques that a motion needs."""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple, Self

import numpy as np
import pinocchio as pin

from ...config.load import Cell
from .compiled import (
    ARRAY3,
    ARRAY4,
    BLOCK,
    COUNT,
    FLAGS,
    INDEX,
    MATRIX,
    ROW,
    STACK,
    TABLE,
    VECTOR,
    compiled,
    inner_kernel,
    record,
)
from .linalg import Vector, cross, dot, row_of, rows_of, turned, turned_back
from .scene import Flags, Index
from .spatial import Array, Kinematics, Pose
from .wheels import DifferentialDrive, Rolled

# --- The joints of a cell as a forest: a tree for each root ---------------------------------------

TREE: Final = record(INDEX, FLAGS, ARRAY4, MATRIX)
"""A `Tree`, as kernels take it."""
TreeArrays = tuple[Index, Flags, Array, Array]

ROOTS: Final = record(ARRAY4, ARRAY3)
"""Attitudes (s, r, 3, 3) and places (s, r, 3) [m] of roots in World; s = 1 where none moves."""
Roots = tuple[Array, Array]

Bases = Pose | Sequence[Pose] | None
"""Where Bases that may move are: of an only mechanism, or of all; None: where the cell has them."""


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


# --- Forward kinematics at several postures: frames, axes and segments at once
#
# A joint's frame in its parent's is a constant plus two constants times functions of its angle
# (Rodrigues). A parent is a joint before it, or a root, whose pose in World the caller gives.


def frames_at(tree: TreeArrays, q: Array, roots: Roots) -> Array:
    """Return the joints' frames (s, n, 3, 4) in World at postures q (s, n) [rad or m]."""
    found = np.empty((*q.shape, 3, 4))
    _frame(tree, q, roots, found)
    return found


@inner_kernel
def frames_of(tree: TreeArrays, q: Array, R: Array, p: Array, found: Array) -> None:
    """Write the frames (n, 3, 4) at one posture q (n,), of roots at R (r, 3, 3), p (r, 3)."""
    parents, prismatic, parts, _ = tree
    step = np.empty((3, 4))
    for i in range(len(q)):
        sine, cosine = q[i], 0.0
        if not prismatic[i]:
            sine, cosine = math.sin(q[i]), 1.0 - math.cos(q[i])
        for row in range(3):
            for k in range(4):
                step[row, k] = parts[i, 0, row, k] + sine * parts[i, 1, row, k]
                step[row, k] += cosine * parts[i, 2, row, k]
        parent, root = parents[i], -1 - parents[i]
        for row in range(3):
            if parent >= 0:
                x, y, z = found[parent, row, 0], found[parent, row, 1], found[parent, row, 2]
                place = found[parent, row, 3]
            else:
                x, y, z, place = R[root, row, 0], R[root, row, 1], R[root, row, 2], p[root, row]
            for k in range(4):
                found[i, row, k] = x * step[0, k] + y * step[1, k] + z * step[2, k]
            found[i, row, 3] += place


@compiled(TREE, MATRIX, ROOTS, BLOCK)
def _frame(tree: TreeArrays, q: Array, roots: Roots, found: Array) -> None:
    R, p = roots
    for s in range(len(q)):
        instant = min(s, len(p) - 1)
        frames_of(tree, q[s], R[instant], p[instant], found[s])


def axes_at(frames: Array, axis: Array) -> Array:
    """Return axes (n, 3), given in frames (s, n, 3, 4), in World (s, n, 3)."""
    found = np.empty((len(frames), len(axis), 3))
    _turn(frames, axis, found)
    return found


@inner_kernel
def axes_of(frames: Array, axis: Array, found: Array) -> None:
    """Write axes (n, 3), given in frames (n, 3, 4), in World."""
    for j in range(len(axis)):
        x, y, z = axis[j]
        for i in range(3):
            found[j, i] = frames[j, i, 0] * x + frames[j, i, 1] * y + frames[j, i, 2] * z


@compiled(ARRAY4, MATRIX, STACK)
def _turn(frames: Array, axis: Array, found: Array) -> None:
    for s in range(len(frames)):
        axes_of(frames[s], axis, found[s])


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


# --- Where a tip is, and its Jacobian -------------------------------------------------------------


class Tip(NamedTuple):
    """A frame on a body of a tree with one root."""

    body: int
    R: Array
    """Its attitude (3, 3) in the body's frame."""
    p: Array
    """Its place (3,) there [m]."""
    moves: Flags
    """Which joints move it (n,)."""


TIP: Final = record(COUNT, MATRIX, VECTOR, FLAGS)


def kinematics(tree: Tree, tip: Tip, q: Array, T_world_base: Pose, T_wrist_mrf: Pose) -> Kinematics:
    """Return frames and Jacobian at joints q (n,) [rad or m]; the tip is the Wrist."""
    T_world_wrist = Pose(np.empty((3, 3)), np.empty(3))
    T_world_mrf, J = Pose(np.empty((3, 3)), np.empty(3)), np.empty((6, len(q)))
    _kinematics(
        tree[:], tip[:], q, *T_world_base, *T_wrist_mrf, *T_world_wrist, *T_world_mrf, J
    )  # fmt: skip
    return Kinematics(T_world_wrist, T_world_mrf, J)


def at_mrf(T_world_wrist: Pose, J_wrist: Array, T_wrist_mrf: Pose) -> Kinematics:
    """Return the kinematics of a Wrist at a pose, whose Jacobian is (6, n), with its MRF."""
    T_world_mrf, J = Pose(np.empty((3, 3)), np.empty(3)), J_wrist.copy()
    _to_mrf(*T_world_wrist, *T_wrist_mrf, *T_world_mrf, J)
    return Kinematics(T_world_wrist, T_world_mrf, J)


@inner_kernel
def _placed(frame: Array, R_at: Array, p_at: Array, R: Array, p: Array) -> None:
    """Write where a frame is that is at R_at, p_at in one (3, 4)."""
    for i in range(3):
        x, y, z = frame[i, 0], frame[i, 1], frame[i, 2]
        for k in range(3):
            R[i, k] = x * R_at[0, k] + y * R_at[1, k] + z * R_at[2, k]
        p[i] = frame[i, 3] + x * p_at[0] + y * p_at[1] + z * p_at[2]


@inner_kernel
def _stand(tree: TreeArrays, q: Array, R: Array, p: Array, frames: Array, axes: Array) -> None:
    """Write the frames (1 + n, 3, 4) of a root at R, p and of its joints, and axes (n, 3)."""
    R_root, p_root = np.empty((1, 3, 3)), np.empty((1, 3))
    for i in range(3):
        p_root[0, i] = frames[0, i, 3] = p[i]
        for k in range(3):
            R_root[0, i, k] = frames[0, i, k] = R[i, k]
    frames_of(tree, q, R_root, p_root, frames[1:])
    axes_of(frames[1:], tree[3], axes)


@inner_kernel
def _jacobian(
    frames: Array, axes: Array, prismatic: Flags, moves: Flags, p: Array, J: Array
) -> None:
    """Write the Jacobian (6, n) of a point p (3,) that some joints move."""
    for j in range(len(moves)):
        zx, zy, zz = axes[j, 0], axes[j, 1], axes[j, 2]
        if not moves[j]:
            zx = zy = zz = 0.0
        if prismatic[j]:
            J[0, j], J[1, j], J[2, j] = zx, zy, zz
            J[3, j] = J[4, j] = J[5, j] = 0.0
        else:
            x = p[0] - frames[1 + j, 0, 3]
            y = p[1] - frames[1 + j, 1, 3]
            z = p[2] - frames[1 + j, 2, 3]
            J[0, j], J[1, j], J[2, j] = zy * z - zz * y, zz * x - zx * z, zx * y - zy * x
            J[3, j], J[4, j], J[5, j] = zx, zy, zz


@inner_kernel
def _move_to_mrf(
    R: Array, p: Array, R_wrist_mrf: Array, p_wrist_mrf: Array, R_mrf: Array, p_mrf: Array, J: Array
) -> None:
    """Write the MRF's place, and make its Jacobian of the Wrist's, whose place is R, p.

    v_mrf = v_wrist + ω × lever: Williams 1997, the first half of eq. 1 read backwards.
    """
    lever = np.zeros(3)
    for i in range(3):
        for k in range(3):
            lever[i] += R[i, k] * p_wrist_mrf[k]
        for j in range(3):
            R_mrf[i, j] = R[i, 0] * R_wrist_mrf[0, j] + R[i, 1] * R_wrist_mrf[1, j]
            R_mrf[i, j] += R[i, 2] * R_wrist_mrf[2, j]
        p_mrf[i] = p[i] + lever[i]
    x, y, z = lever[0], lever[1], lever[2]
    for j in range(J.shape[1]):
        wx, wy, wz = J[3, j], J[4, j], J[5, j]
        J[0, j] = J[0, j] + wy * z - wz * y
        J[1, j] = J[1, j] + wz * x - wx * z
        J[2, j] = J[2, j] + wx * y - wy * x


@compiled(TREE, TIP, VECTOR, *2 * (MATRIX, VECTOR), TABLE, ROW, TABLE, ROW, TABLE)
def _kinematics(
    tree: TreeArrays,
    tip: tuple[Any, ...],
    q: Array,
    R_base: Array,
    p_base: Array,
    R_wrist_mrf: Array,
    p_wrist_mrf: Array,
    R_wrist: Array,
    p_wrist: Array,
    R_mrf: Array,
    p_mrf: Array,
    J: Array,
) -> None:
    """Write the Wrist's and the MRF's place, and the Jacobian of the MRF (6, n)."""
    body, R_tip, p_tip, moves = tip
    frames, axes = np.empty((1 + len(q), 3, 4)), np.empty((len(q), 3))
    _stand(tree, q, R_base, p_base, frames, axes)
    _placed(frames[body], R_tip, p_tip, R_wrist, p_wrist)
    _jacobian(frames, axes, tree[1], moves, p_wrist, J)
    _move_to_mrf(R_wrist, p_wrist, R_wrist_mrf, p_wrist_mrf, R_mrf, p_mrf, J)


@compiled(MATRIX, VECTOR, MATRIX, VECTOR, TABLE, ROW, TABLE)
def _to_mrf(
    R: Array, p: Array, R_wrist_mrf: Array, p_wrist_mrf: Array, R_mrf: Array, p_mrf: Array, J: Array
) -> None:
    _move_to_mrf(R, p, R_wrist_mrf, p_wrist_mrf, R_mrf, p_mrf, J)


# --- What a motion needs --------------------------------------------------------------------------


class Masses(NamedTuple):
    """What a tree with one root moves: its root, and a body at each joint."""

    mass: Array
    """(1 + n,) [kg]"""
    com: Array
    """Centres of mass (1 + n, 3) in the joints' frames [m]."""
    inertia: Array
    """Inertias (1 + n, 3, 3) about them [kg·m²]."""
    rotor: Array
    """What turns with the joints alone (n,) [kg·m²]: the drives' rotors, and wheels."""
    rolling: int
    """How many joints, the first ones, move the root as well [1]: two wheels, or none."""

    def hang(self, body: int, inertia: "pin.Inertia") -> None:
        """Let a body be this one."""
        self.mass[body], self.com[body] = inertia.mass, inertia.lever
        self.inertia[body] = inertia.inertia


MASSES: Final = record(VECTOR, MATRIX, ARRAY3, VECTOR, COUNT)


def needed(
    tree: Tree, tip: Tip, masses: Masses, falls: Array, motion: tuple[Array, Array, Array]
) -> tuple[Array, Array]:
    """Return the torques of a motion (2, n) [N·m], and the Jacobian of a tip (6, n).

    The first are those of q, q̇ and q̈ (n,), the second of q and q̇ alone, both without contact and
    friction. Joints that move the root, as wheels do, carry it along what they move it by. Things
    fall as `falls` (3,) says [m/s²], in Base axes. The Jacobian is at the tip's origin and in its
    own axes, of a Base that stands.
    """
    tau, J = np.empty((2, len(motion[0]))), np.empty((6, len(motion[0])))
    _needed(tree[:], tip[:], masses[:], falls, *motion, tau, J)
    return tau, J


@inner_kernel
def _plus(A: Array, i: int, x: Vector, share: float) -> None:
    A[i, 0] += share * x[0]
    A[i, 1] += share * x[1]
    A[i, 2] += share * x[2]


@inner_kernel
def _weigh(
    frame: Array, masses: tuple[Any, ...], body: int, moves: tuple[Any, ...], needs: tuple[Any, ...]
) -> None:
    """Write force and moment (1 + n, 3) that a body needs, about its frame's origin."""
    mass, com, inertia, _, _ = masses
    w, alpha, a = row_of(moves[0], body), row_of(moves[1], body), row_of(moves[2], body)
    R, own, f = rows_of(frame), rows_of(inertia[body]), needs[0]
    c, own_w = turned(R, row_of(com, body)), turned_back(R, w)
    turning = turned(R, turned(own, turned_back(R, alpha)))
    spin = turned(R, cross(own_w, turned(own, own_w)))
    f[body] = 0.0
    for part in (a, cross(alpha, c), cross(w, cross(w, c))):
        _plus(f, body, part, mass[body])
    needs[1][body] = 0.0
    for part in (turning, spin, cross(c, row_of(f, body))):
        _plus(needs[1], body, part, 1.0)


@inner_kernel
def _between(frames: Array, a: int, b: int) -> Vector:
    """Return the way from frame a's origin to frame b's."""
    return (
        frames[b, 0, 3] - frames[a, 0, 3],
        frames[b, 1, 3] - frames[a, 1, 3],
        frames[b, 2, 3] - frames[a, 2, 3],
    )


@inner_kernel
def _set_out(
    frames: Array,
    axes: Array,
    rolling: int,
    dq: Array,
    ddq: Array,
    more: float,
    falls: Array,
    turning: tuple[Array, Array, Array],
) -> None:
    """Write how the root turns and accelerates, by the joints that move it; `more`: by q̈, too."""
    w, alpha, a = turning
    v = np.zeros((1, 3))
    w[0], alpha[0] = 0.0, 0.0
    for i in range(3):
        a[0, i] = -falls[i]
    for j in range(rolling):
        z = row_of(axes, j)
        by = cross(z, _between(frames, 1 + j, 0))
        _plus(w, 0, z, dq[j])
        _plus(v, 0, by, dq[j])
        _plus(alpha, 0, z, more * ddq[j])
        _plus(a, 0, by, more * ddq[j])
    _plus(a, 0, cross(row_of(w, 0), row_of(v, 0)), 1.0)


@compiled(TREE, TIP, MASSES, *4 * (VECTOR,), TABLE, TABLE)
def _needed(
    tree: TreeArrays,
    tip: tuple[Any, ...],
    masses: tuple[Any, ...],
    falls: Array,
    q: Array,
    dq: Array,
    ddq: Array,
    tau: Array,
    J: Array,
) -> None:
    """Write torques (2, n) and a Jacobian (6, n): Luh, Walker and Paul 1980, in Base axes."""
    parents, prismatic, _, _ = tree
    body, R_tip, p_tip, moves = tip
    rotor, rolling, n = masses[3], masses[4], len(q)
    frames, axes = np.empty((1 + n, 3, 4)), np.empty((n, 3))
    _stand(tree, q, np.eye(3), np.zeros(3), frames, axes)
    turning = np.empty((1 + n, 3)), np.empty((1 + n, 3)), np.empty((1 + n, 3))
    needs = np.empty((1 + n, 3)), np.empty((1 + n, 3))
    w, alpha, a = turning
    for row in range(2):
        more = 1.0 if row == 0 else 0.0
        _set_out(frames, axes, rolling, dq, ddq, more, falls, turning)
        _weigh(frames[0], masses, 0, turning, needs)
        for j in range(n):
            own, b = 1 + j, 1 + parents[j]
            z, lever = row_of(axes, j), _between(frames, b, own)
            w_b, alpha_b = row_of(w, b), row_of(alpha, b)
            w[own], alpha[own], a[own] = w[b], alpha[b], a[b]
            _plus(a, own, cross(alpha_b, lever), 1.0)
            _plus(a, own, cross(w_b, cross(w_b, lever)), 1.0)
            across = cross(w_b, z)
            if prismatic[j]:
                _plus(a, own, z, more * ddq[j])
                _plus(a, own, across, 2.0 * dq[j])
            else:
                _plus(w, own, z, dq[j])
                _plus(alpha, own, z, more * ddq[j])
                _plus(alpha, own, across, dq[j])
            _weigh(frames[own], masses, own, turning, needs)
        for j in range(n - 1, -1, -1):
            own, b = 1 + j, 1 + parents[j]
            f, m = row_of(needs[0], own), row_of(needs[1], own)
            tau[row, j] = dot(row_of(axes, j), f if prismatic[j] else m) + rotor[j] * more * ddq[j]
            _plus(needs[0], b, f, 1.0)
            _plus(needs[1], b, m, 1.0)
            _plus(needs[1], b, cross(_between(frames, b, own), f), 1.0)
        f, m = row_of(needs[0], 0), row_of(needs[1], 0)
        for j in range(rolling):
            about = cross(_between(frames, 1 + j, 0), f)
            tau[row, j] += dot(row_of(axes, j), m) + dot(row_of(axes, j), about)
    R, p = np.empty((3, 3)), np.empty(3)
    _placed(frames[body], R_tip, p_tip, R, p)
    _jacobian(frames, axes, prismatic, moves, p, J)
    for j in range(n):
        for i in (0, 3):
            x, y, z = J[i, j], J[i + 1, j], J[i + 2, j]
            for k in range(3):
                J[i + k, j] = R[0, k] * x + R[1, k] * y + R[2, k] * z


# --- The same, read from a URDF -------------------------------------------------------------------


class Mounting(NamedTuple):
    """What a mechanism's Base is fixed to, and where."""

    body: int = 0
    """Of the forest: a root, or the body that the tip link of another mechanism is part of."""
    T: Pose = Pose.identity()
    """Base in it."""


class Branch:
    """The joints of one mechanism among those of the cell."""

    def __init__(
        self,
        model: "pin.Model",
        joints: Sequence[str],
        rolling: DifferentialDrive | None,
        first: int = 0,
        on: "Mounting | None" = None,
        prefix: str = "",
    ) -> None:
        """Read them from the URDF's `model`; those outside of the mechanism stand at zero.

        `first` of all joints is its first, and Base is `on` a body, none: on root 0; names of its
        links begin with the `prefix` where there are several mechanisms.
        """
        self.model, self.prefix = model, prefix
        self._data, self._first = model.createData(), first
        self._on = Mounting() if on is None else on
        pin.forwardKinematics(model, self._data, pin.neutral(model))
        self._ids = [model.getJointId(name) for name in joints]
        self.n = len(self._ids)
        self.rolling = rolling
        """The wheels that the root rolls on, its first two joints; None for one that stands."""
        self.wheels = slice(first, first + 2)
        """Where they are among all joints."""
        self.tree = self._tree()

    @classmethod
    def of(cls, part: Cell, first: int = 0, on: "Mounting | None" = None) -> Self:
        """Read that of one mechanism of a cell."""
        joints, rolling = part.robot.joints, DifferentialDrive.from_cell(part)
        model, names = pin.buildModelFromXML(part.robot.description()), [j.name for j in joints]
        return cls(model, names, rolling, first, on, part.prefix)

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
        found = Pose(T.rotation.copy(), T.translation.copy())
        return self._body(own), found if own else self._on.T @ found

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
        return self._first + own if own else self._on.body

    def _carrier(self, joint: int) -> int:
        """Return which of the own bodies carries a joint of the URDF, or is moved by it."""
        supports = self.model.supports[joint].tolist()
        # What is on a wheel is as good as on the root: it turns in its own place.
        first = 0 if self.rolling is None else 2
        return max((self._ids.index(j) + 1 for j in supports if j in self._ids[first:]), default=0)

    def _tree(self) -> Tree:
        """Read the tree of the joints; Base is their root."""
        n, model, data = self.n, self.model, self._data
        parents, base = np.empty(n, dtype=np.int64), pin.SE3(*self._on.T).inverse()
        prismatic, parts, axes = np.zeros(n, dtype=bool), np.zeros((n, 3, 3, 4)), np.zeros((n, 3))
        for i, j in enumerate(self._ids):
            carrier = self._carrier(model.parents[j])
            before = data.oMi[self._ids[carrier - 1]] if carrier else base
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
                # The wheel turns all that the root carries about the other one's place: Zhang 2013,
                # eq. 6, its first two columns.
                side = 1.0 if i else -1.0
                parts[i, 0] = np.eye(3, 4)
                parts[i, 0, :2, 3] = self.rolling.centre, side * 0.5 * self.rolling.track
                axes[i] = 0.0, 0.0, side * self.rolling.turn
            else:
                K = pin.skew(angular)
                parts[i, 1, :, :3] = placement[:3, :3] @ K
                parts[i, 2, :, :3] = placement[:3, :3] @ K @ K
        return Tree(parents, prismatic, parts, axes)


def standing_on(part: Cell) -> Pose:
    """Return where the Base of a mechanism is in the tip link of the one that it stands on."""
    T = part.config.mechanism.T_on
    return Pose.identity() if T is None else Pose.from_xyz_rpy(T.xyz, T.rpy)


class Forest:
    """Forward kinematics of a cell's n joints, for capsules and control points.

    Bodies are numbered: joint j moves body j + 1; body −r is root r, the Base of mechanism r,
    unless that stands on another.
    """

    def __init__(self, cell: Cell) -> None:
        """Read the joints of every mechanism from its URDF, one after the other."""
        self.branches: tuple[Branch, ...] = ()
        """One for each mechanism."""
        self.n = 0
        for root, (part, under) in enumerate(zip(cell.parts, cell.carriers, strict=True)):
            on = Mounting(-root)
            if under >= 0:
                carrier = cell.parts[under].config.mechanism
                on = Mounting(*self.body_of(f"{cell.parts[under].prefix}{carrier.tip_link}"))
                on = on._replace(T=on.T @ standing_on(part))
            branch = Branch.of(part, self.n, on)
            self.branches, self.n = (*self.branches, branch), self.n + branch.n
        self.tree = Tree.of_all([branch.tree for branch in self.branches])
        far = [max(abs(j.lower), abs(j.upper)) for part in cell.parts for j in part.robot.joints]
        self.stroke = np.where(self.tree.prismatic, far, 0.0)
        """How far each prismatic joint may be out (n,) [m]; zero for the others."""
        bases = [part.config.mechanism.T_world_base for part in cell.parts]
        self.bases = [Pose.from_xyz_rpy(base.xyz, base.rpy) for base in bases]
        """Where the cell has each root in World."""
        self._standing = _roots(self.bases)
        self._rolling = [(r, b) for r, b in enumerate(self.branches) if b.rolling is not None]
        self.gear = np.ones(self.n) if self._rolling else None
        """Angle of what a joint moves per angle of the joint (n,) [1]; None: 1 for all."""
        roots = len(self.branches)
        self._moves = np.zeros((roots + self.n, self.n), dtype=bool)
        for r, branch in self._rolling:
            if self.gear is not None and branch.rolling is not None:
                self.gear[branch.wheels] = branch.rolling.turn
                self._moves[roots - 1 - r, branch.wheels] = True
        for j, parent in enumerate(self.tree.parent.tolist()):
            self._moves[roots + j] = self._moves[roots + parent]
            self._moves[roots + j, j] = True

    def frames(self, q: Array, T_world_base: Bases = None) -> Array:
        """Return the joints' frames (s, n, 3, 4) in World at postures q (s, n) [rad or m]."""
        return frames_at(self.tree[:], q, self._roots(T_world_base, q))

    def axes(self, frames: Array) -> Array:
        """Return the joints' axes (s, n, 3) in World, given their frames (s, n, 3, 4)."""
        return axes_at(frames, self.tree.axis)

    def placed(
        self, q: Array, body: Index, segments: Array, T_world_base: Bases = None
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

    def _roots(self, T_world_base: Bases, q: Array) -> Roots:
        """Return where the roots are.

        One that rolls gets there as its wheels turn from one posture of q (s, n) to the next.
        """
        if T_world_base is None:
            return self._standing
        each = [T_world_base] if isinstance(T_world_base, Pose) else T_world_base
        if not any(isinstance(T, Rolled) for T in each):
            return _roots(each)
        R, p = np.empty((len(q), len(each), 3, 3)), np.empty((len(q), len(each), 3))
        for r, T in enumerate(each):
            R[:, r], p[:, r] = T
        for r, branch in self._rolling:
            at = each[r]
            if branch.rolling is not None and isinstance(at, Rolled):
                R[:, r], p[:, r] = branch.rolling.places(at, q[:, branch.wheels])
        return R, p


def _roots(poses: Sequence[Pose]) -> Roots:
    """Return the poses of the roots, at all postures."""
    return np.array([[T.R for T in poses]]), np.array([[T.p for T in poses]])
