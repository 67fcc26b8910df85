"""The campaign's own model of an arm: where its frames and shapes are, from the URDF alone.

It shares no code with the server's control and no library with it but numpy: plain products of
homogeneous transforms. Shapes are rows of balls inside the URDF's collision primitives, within a
centimetre or so of them.
"""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...config.load import Cell
from ...config.schema import Pose

Array = NDArray[np.float64]

NEIGHBOURS = 2
"""Links this many joints apart overlap by design, and are not held against each other [1]."""
PLATE = 0.04
"""Thickness of the rig's wall [m]."""


class Shape(NamedTuple):
    """Balls fixed to the links: all arrays have one row per ball."""

    link: NDArray[np.int64]
    """Index of the link's frame."""
    centre: Array
    """In the link's frame (m, 3) [m]."""
    radius: Array


class Block(NamedTuple):
    """A box in World: pose (4, 4) of its centre, half the sides (3,) [m]."""

    T: Array
    half: Array


@dataclass
class _Joint:
    """One joint of the URDF's tree, parents first."""

    parent: int
    T: Array
    axis: Array | None
    coordinate: int
    """Index into q; -1 for a joint that does not move."""
    depth: int
    """Number of moving joints from the base to the child."""


@dataclass
class Arm:
    """Frames, shapes and surroundings of a cell's arm."""

    joints: list[_Joint]
    tip: int
    T_base: Array
    T_tool: Array
    shape: Shape
    blocks: list[Block] = field(default_factory=list)

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
        joints = [_Joint(-1, np.eye(4), None, -1, 0)]
        waiting = root.findall("joint")
        while waiting:
            element = next(j for j in waiting if _end(j, "parent") in index)
            waiting.remove(element)
            parent = index[_end(element, "parent")]
            coordinate = order.get(element.get("name", ""), -1)
            axis = element.find("axis")
            direction = _numbers(axis, "xyz") if axis is not None else np.array([1.0, 0.0, 0.0])
            depth = joints[parent].depth + (coordinate >= 0)
            index[_end(element, "child")] = len(joints)
            joints.append(
                _Joint(
                    parent,
                    _origin(element),
                    direction / np.linalg.norm(direction),
                    coordinate,
                    depth,
                )
            )
        mechanism = cell.config.mechanism
        return cls(
            joints,
            index[mechanism.tip_link],
            matrix(mechanism.T_world_base),
            matrix(mechanism.T_wrist_mrf),
            _shape(root, index, cell),
            _blocks(cell),
        )

    def frames(self, q: Array) -> Array:
        """Return every link's pose in World (k, 4, 4) at joint angles q (n,) [rad]."""
        T = np.empty((len(self.joints), 4, 4))
        T[0] = self.T_base
        for i, joint in enumerate(self.joints[1:], start=1):
            T[i] = T[joint.parent] @ joint.T
            if joint.coordinate >= 0 and joint.axis is not None:
                T[i, :3, :3] = T[i, :3, :3] @ rotation(joint.axis * q[joint.coordinate])
        return T

    def tool(self, q: Array) -> Array:
        """Return the MRF's pose in World (4, 4)."""
        return np.asarray(self.frames(q)[self.tip] @ self.T_tool)

    def jacobian(self, q: Array, step: float = 1e-6) -> Array:
        """Return the MRF's Jacobian (6, n), World axes, by central differences of the pose."""
        J = np.empty((6, len(q)))
        for i in range(len(q)):
            aside = np.zeros(len(q))
            aside[i] = step
            J[:, i] = difference(self.tool(q + aside), self.tool(q - aside)) / (2.0 * step)
        return J

    def clearance(self, q: Array) -> tuple[float, float]:
        """Return the least distance to fixed things and between links [m], inf for none."""
        T = self.frames(q)[self.shape.link]
        p = np.einsum("mij,mj->mi", T[:, :3, :3], self.shape.centre) + T[:, :3, 3]
        radius = self.shape.radius
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


def rotation(vector: Array) -> Array:
    """Return the rotation (3, 3) about a vector (3,) by its length [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = (vector / angle).tolist()
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K))


def rotation_vector(R: Array) -> Array:
    """Return the vector (3,) [rad] of a rotation (3, 3), through its unit quaternion."""
    # The eigenvector of this matrix's greatest eigenvalue is the quaternion (Bar-Itzhack 2000).
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    N = np.array(
        [
            [a - e - i, d + b, g + c, h - f],
            [d + b, e - a - i, h + f, c - g],
            [g + c, h + f, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    quaternion = np.linalg.eigh(N / 3.0)[1][:, -1]
    if quaternion[3] < 0.0:
        quaternion = -quaternion
    sine = float(np.linalg.norm(quaternion[:3]))
    angle = 2.0 * math.atan2(sine, float(quaternion[3]))
    return np.asarray(quaternion[:3] * (angle / sine if sine > 1e-12 else 2.0))


def difference(T_to: Array, T_from: Array) -> Array:
    """Return the twist (6,) in World axes that leads from one pose to another in one second."""
    turn = rotation_vector(T_to[:3, :3] @ T_from[:3, :3].T)
    return np.concatenate([T_to[:3, 3] - T_from[:3, 3], turn])


def matrix(pose: Pose) -> Array:
    """Return a pose of the cell file as a homogeneous matrix (4, 4)."""
    return _matrix(np.array(pose.xyz), np.array(pose.rpy))


def _matrix(xyz: Array, rpy: Array) -> Array:
    T = np.eye(4)
    x, y, z = np.eye(3)
    T[:3, :3] = rotation(z * rpy[2]) @ rotation(y * rpy[1]) @ rotation(x * rpy[0])
    T[:3, 3] = xyz
    return T


def _origin(element: ET.Element) -> Array:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    return _matrix(_numbers(origin, "xyz"), _numbers(origin, "rpy"))


def _numbers(element: ET.Element, name: str) -> Array:
    return np.array([float(word) for word in element.get(name, "0 0 0").split()])


def _end(joint: ET.Element, which: str) -> str:
    element = joint.find(which)
    return "" if element is None else element.get("link", "")


def _shape(root: ET.Element, index: dict[str, int], cell: Cell) -> Shape:
    links: list[int] = []
    centres: list[Array] = []
    radii: list[float] = []

    def add(link: int, T: Array, half_length: float, radius: float) -> None:
        count = 1 + math.ceil(2.0 * half_length / radius)
        for z in np.linspace(-half_length, half_length, count) if count > 1 else (0.0,):
            links.append(link)
            centres.append(T[:3, :3] @ np.array([0.0, 0.0, z]) + T[:3, 3])
            radii.append(radius)

    for element in root.findall("link"):
        link = index[element.get("name", "")]
        for collision in element.findall("collision"):
            T = _origin(collision)
            cylinder = collision.find("geometry/cylinder")
            sphere = collision.find("geometry/sphere")
            if cylinder is not None:
                radius = float(cylinder.get("radius", "0"))
                half_length = 0.5 * float(cylinder.get("length", "0"))
                add(link, T, max(0.0, half_length - 0.5 * radius), radius)
            elif sphere is not None:
                add(link, T, 0.0, float(sphere.get("radius", "0")))
    rig = cell.config.rig
    if rig is not None and rig.tool_radius > 0.0:
        tip = index[cell.config.mechanism.tip_link]
        add(tip, matrix(cell.config.mechanism.T_wrist_mrf), 0.0, rig.tool_radius)
    return Shape(np.array(links), np.array(centres), np.array(radii))


def _blocks(cell: Cell) -> list[Block]:
    rig = cell.config.rig
    if rig is None:
        return []
    blocks = [
        Block(_matrix(np.array(b.xyz), np.array(b.rpy)), np.array(b.half_size)) for b in rig.boxes
    ]
    if rig.wall is not None:
        z = np.array(rig.wall.normal) / np.linalg.norm(rig.wall.normal)
        x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
        x /= np.linalg.norm(x)
        T = np.eye(4)
        T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
        T[:3, 3] = np.array(rig.wall.xyz) - 0.5 * PLATE * z
        half = np.array([rig.wall.half_size, rig.wall.half_size, 0.5 * PLATE])
        blocks.append(Block(T, half))
    return blocks
