"""The joints of a cell as a forest: a tree for each root, read from the URDF."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ....config.load import Cell
from ..scene import Flags, Index
from ..spatial import Array, Pose
from ..wheels.rolling import Rolled, Rolling
from .forward_kinematics import axes_at, frames_at, placed_at
from .records import Roots


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
        self.rolling = Rolling.from_cell(part)
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
    tick's own Jacobian is `mechanism/kinematics.py`'s, whose rounding the shipped hashes hold.
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
