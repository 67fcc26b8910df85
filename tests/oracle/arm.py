"""The oracle's model of an arm: its frames and shapes, from the URDF alone.

It shares no code with the server's control and no library with it but numpy: plain products of
homogeneous transforms. Shapes are rows of balls inside the URDF's collision primitives, within a
centimetre or so of them.
"""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from telerobot.config.load import Cell

from .poses import Array, matrix, numbers, origin_of, skew
from .shapes import BallModel, Block, blocks_of, shape_of

NEIGHBOURS = 2
"""Links this many joints apart overlap by design, and are not held against each other [1]."""

_EYE = np.eye(3)


@dataclass
class _TreeJoint:
    """One joint of the URDF's tree, parents first."""

    parent: int
    T: Array
    axis: Array
    """Unit vector (3,) in the child's frame."""
    coordinate: int
    """Index into q; -1 for a joint that does not move."""
    depth: int
    """Number of moving joints from the base to the child."""
    slides: bool = False
    """True for a prismatic joint."""

    def __post_init__(self) -> None:
        self.skew = skew(self.axis)


@dataclass
class OracleArm:
    """Frames, shapes and surroundings of a cell's arm."""

    joints: list[_TreeJoint]
    tip: int
    T_base: Array
    T_tool: Array
    shape: BallModel
    blocks: list[Block] = field(default_factory=list)
    links: tuple[str, ...] = ()
    """Names of the frames, in their order."""

    @classmethod
    def of(cls, cell: Cell) -> Self:
        """Read the arm of a cell and the fixed things of its rig."""
        root = ET.fromstring(cell.robot.description())
        order = {j.name: i for i, j in enumerate(cell.robot.joints)}
        children = {_end(j, "child") for j in root.findall("joint")}
        base = next(
            name for link in root.findall("link") if (name := link.get("name", "")) not in children
        )
        index = {base: 0}
        joints = [_TreeJoint(-1, np.eye(4), np.zeros(3), -1, 0)]
        waiting = root.findall("joint")
        while waiting:
            element = next(j for j in waiting if _end(j, "parent") in index)
            waiting.remove(element)
            parent = index[_end(element, "parent")]
            coordinate = order.get(element.get("name", ""), -1)
            axis = element.find("axis")
            direction = numbers(axis, "xyz") if axis is not None else np.array([1.0, 0.0, 0.0])
            depth = joints[parent].depth + (coordinate >= 0)
            index[_end(element, "child")] = len(joints)
            joints.append(
                _TreeJoint(
                    parent,
                    origin_of(element),
                    direction / np.linalg.norm(direction),
                    coordinate,
                    depth,
                    element.get("type") == "prismatic",
                )
            )
        mechanism = cell.config.mechanism
        return cls(
            joints,
            index[mechanism.tip_link],
            matrix(mechanism.T_world_base),
            matrix(mechanism.T_wrist_mrf),
            shape_of(root, index, cell),
            blocks_of(cell),
            tuple(index),
        )

    def frames(self, q: Array) -> Array:
        """Return every link's pose in World (k, 4, 4) at joint angles q (n,) [rad]."""
        T = np.empty((len(self.joints), 4, 4))
        T[0] = self.T_base
        for i, joint in enumerate(self.joints[1:], start=1):
            T[i] = T[joint.parent] @ joint.T
            if joint.coordinate >= 0:
                way = float(q[joint.coordinate])
                if joint.slides:
                    T[i, :3, 3] += T[i, :3, :3] @ joint.axis * way
                else:
                    K = joint.skew
                    turn = _EYE + math.sin(way) * K + (1.0 - math.cos(way)) * (K @ K)
                    T[i, :3, :3] = T[i, :3, :3] @ turn
        return T

    def tool(self, q: Array) -> Array:
        """Return the MRF's pose in World (4, 4)."""
        return np.asarray(self.frames(q)[self.tip] @ self.T_tool)

    def jacobian(self, q: Array) -> Array:
        """Return the MRF's Jacobian (6, n), World axes: of each joint, its axis and its lever."""
        T, J, i = self.frames(q), np.zeros((6, len(q))), self.tip
        p = T[self.tip, :3, :3] @ self.T_tool[:3, 3] + T[self.tip, :3, 3]
        while i > 0:
            joint = self.joints[i]
            if joint.coordinate >= 0:
                axis = T[i, :3, :3] @ joint.axis
                if joint.slides:
                    J[:3, joint.coordinate] = axis
                else:
                    J[:3, joint.coordinate] = skew(axis) @ (p - T[i, :3, 3])
                    J[3:, joint.coordinate] = axis
            i = joint.parent
        return J

    def balls(self, q: Array) -> tuple[Array, Array]:
        """Return the centres (m, 3) in World and the radii (m,) of the arm's balls [m]."""
        T = self.frames(q)[self.shape.link]
        p = np.einsum("mij,mj->mi", T[:, :3, :3], self.shape.centre) + T[:, :3, 3]
        return p, self.shape.radius

    def clearance(self, q: Array) -> tuple[float, float]:
        """Return the least distance to fixed things and between links [m], inf for none."""
        p, radius = self.balls(q)
        depth = np.array([j.depth for j in self.joints])[self.shape.link]
        things = math.inf
        moving = depth > 0
        for block in self.blocks:
            local = (p[moving] - block.T[:3, 3]) @ block.T[:3, :3]
            beyond = np.abs(local) - block.half
            outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
            distance = outside + np.minimum(beyond.max(axis=1), 0.0) - radius[moving]
            things = min(things, float(distance.min()))
        apart = np.linalg.norm(p[:, None] - p[None], axis=2) - radius[:, None] - radius[None]
        far = np.abs(depth[:, None] - depth[None]) > NEIGHBOURS
        own = float(apart[far].min()) if far.any() else math.inf
        return things, own


def _end(joint: ET.Element, which: str) -> str:
    element = joint.find(which)
    return "" if element is None else element.get("link", "")
