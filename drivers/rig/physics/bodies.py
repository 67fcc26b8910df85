"""Bodies of the virtual world: solids, bridge, tunnel walls, peg and holes."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell
from ....config.schema.mechanism import SegmentSection
from ....config.schema.rig import RigBridgeSection, RigHoleSection, RigPegSection, RigPersonSection
from ....config.schema.section import PoseSection
from ....config.schema.surroundings import ObstacleSection
from .geoms import fixed, of_arm, quaternion

# --- A bridge across the way, and a person who walks in: things that only a scanner can tell of ---

PERSON = "person"
"""Body, which can be placed elsewhere, as those of a bridge can."""


def add_bridge(spec: mujoco.MjSpec, bridge: RigBridgeSection) -> None:
    """Add pillars and beam."""
    quat = (math.cos(0.5 * bridge.skew), 0.0, 0.0, math.sin(0.5 * bridge.skew))
    for name, (pos, half) in bridge.blocks.items():
        body = spec.worldbody.add_body(name=name, pos=pos, quat=quat, mocap=True)
        fixed(body.add_geom(name=f"{name}_box", type=mujoco.mjtGeom.mjGEOM_BOX, size=half))


def add_person(spec: mujoco.MjSpec, person: RigPersonSection) -> None:
    """Add who may walk in: an upright capsule on the floor."""
    x, y, z = person.xyz
    body = spec.worldbody.add_body(name=PERSON, pos=(x, y, z + 0.5 * person.height), mocap=True)
    shape = body.add_geom(name=f"{PERSON}_shape", type=mujoco.mjtGeom.mjGEOM_CAPSULE)
    shape.size[:2] = person.radius, 0.5 * person.height - person.radius
    fixed(shape)


# --- A peg as the tool, and blocks with a hole that it fits, made of what MuJoCo touches well -----
#
# The peg is a ring of upright capsules: a cylinder against boxes has contact points that leap
# from one end of a line to the other, and forces that leap with them. The hole is three rings
# of boxes, one to a side: wall, chamfer and rim. A box reaches past the ends of its side into
# its neighbours, never into the hole: inside of an octagon is what is inside of all its sides.

CAPSULES = 12
"""In the peg's ring."""
SIDES = 8
"""Of a hole."""
_CONDIM = 4
"""Contacts of the peg resist sliding and twisting."""


def add_peg(tip: mujoco.MjsBody, mrf: PoseSection, peg: RigPegSection) -> None:
    """Fix the peg to the tip, its end at the MRF."""
    body = tip.add_body(name="peg", pos=mrf.xyz, quat=quaternion(mrf))
    make_peg(body, peg, "peg")


def make_peg(body: mujoco.MjsBody, peg: RigPegSection, name: str) -> None:
    """Make a body a peg; names of its geoms begin with `name`."""
    across = peg.mass * (3.0 * peg.radius**2 + peg.length**2) / 12.0
    body.mass, body.explicitinertial = peg.mass, True
    body.ipos = (0.0, 0.0, -peg.length / 2.0)
    body.inertia = (across, across, peg.mass * peg.radius**2 / 2.0)
    around, first, last = peg.radius - peg.rounding, -peg.rounding, peg.rounding - peg.length
    for i in range(CAPSULES):
        angle = 2.0 * math.pi * i / CAPSULES
        x, y = around * math.cos(angle), around * math.sin(angle)
        capsule = body.add_geom(
            name=f"{name}_{i}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=(x, y, first, x, y, last),
            size=(peg.rounding, 0.0, 0.0),
            density=0,
        )
        of_arm(capsule)
        capsule.condim, capsule.priority = _CONDIM, 1  # the peg's word counts in its contacts
        capsule.friction[0] = peg.friction


def add_hole(spec: mujoco.MjSpec, hole: RigHoleSection) -> None:
    """Put the block of a hole where it really is."""
    meant, true = hole.T_world_hole, hole.misplaced
    place = spec.worldbody.add_body(
        name=f"{hole.name}_meant", pos=meant.xyz, quat=quaternion(meant)
    )
    body = place.add_body(name=hole.name, pos=true.xyz, quat=quaternion(true))
    r, c, outside = hole.radius, hole.chamfer, hole.half_size
    across = outside * math.tan(math.pi / SIDES)
    slope = c * math.sqrt(2.0)
    for i in range(SIDES):
        angle = 2.0 * math.pi * i / SIDES
        upright = quaternion(PoseSection(rpy=(0.0, 0.0, angle)))
        leaning = quaternion(PoseSection(rpy=(0.0, -math.pi / 4.0, angle)))
        # x out from the axis, z up from the mouth; the chamfer's box lies behind its face
        middle, deep = r + c / 2.0, slope / 2.0 * math.sqrt(0.5)
        _add_box(body, angle, (r + outside) / 2.0, -(c + hole.depth) / 2.0, upright,
                 ((outside - r) / 2.0, across, (hole.depth - c) / 2.0))  # fmt: skip
        _add_box(body, angle, middle + deep, -c / 2.0 - deep, leaning,
                 (slope / 2.0, across, slope / 2.0))  # fmt: skip
        _add_box(body, angle, (r + c + outside) / 2.0, -c / 2.0, upright,
                 ((outside - r - c) / 2.0, across, c / 2.0))  # fmt: skip


def _add_box(
    body: mujoco.MjsBody,
    angle: float,
    out: float,
    up: float,
    quat: tuple[float, ...],
    half: tuple[float, float, float],
) -> None:
    place = (out * math.cos(angle), out * math.sin(angle), up)
    fixed(body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=place, quat=quat, size=half))


# --- The cell's obstacles as physical things: solid bodies that can be moved ----------------------

Vector = NDArray[np.float64]

POINT = 0.001
"""Radius of what is only a point to the daemon [m]."""


def add_solid(
    spec: mujoco.MjSpec, obstacle: ObstacleSection, quat: tuple[float, float, float, float]
) -> mujoco.MjsGeom | None:
    """Add an obstacle that can be moved; return its shape, None for a sight line."""
    if obstacle.shape == "sight_line" or obstacle.xyz is None:
        return None
    body = spec.worldbody.add_body(
        name=f"obstacle_{obstacle.name}", pos=obstacle.xyz, quat=quat, mocap=True
    )
    kind = mujoco.mjtGeom
    radius = obstacle.radius or POINT
    name = f"obstacle_{obstacle.name}_shape"
    match obstacle.shape:
        case "box":
            return body.add_geom(name=name, type=kind.mjGEOM_BOX, size=obstacle.half_size)
        case "capsule":
            end = np.subtract(obstacle.to or obstacle.xyz, obstacle.xyz)
            fromto = [0.0, 0.0, 0.0, *end.tolist()]
            return body.add_geom(
                name=name, type=kind.mjGEOM_CAPSULE, fromto=fromto, size=[radius, 0.0, 0.0]
            )
        case _:
            return body.add_geom(name=name, type=kind.mjGEOM_SPHERE, size=[radius, 0.0, 0.0])


def attitude(obstacle: ObstacleSection) -> PoseSection:
    """Return the attitude of an obstacle's body: a box's own."""
    return PoseSection(rpy=obstacle.rpy if obstacle.shape == "box" else (0.0, 0.0, 0.0))


def place(model: mujoco.MjModel, data: mujoco.MjData, name: str, xyz: Vector) -> None:
    """Move an obstacle. Raises `ValueError`, in one line, for one that there is not."""
    bodies = (f"obstacle_{name}", name)
    found = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body) for body in bodies]
    body = next((i for i in found if i >= 0 and model.body_mocapid[i] >= 0), -1)
    if body < 0:
        raise ValueError(f"fault place: no solid obstacle {name!r} in the cell")
    data.mocap_pos[model.body_mocapid[body]] = xyz


# --- The walls of a tunnel, as boxes: on either side of a planar arm, in rings of eight in space
#
# Each box is tangent to the tunnel's wall in the middle of its piece of the centre line, and
# moved back where the wall bulges inward: the free room is nowhere narrower than the rig says.

STEP = math.pi / 8
"""A box spans so much of a turn [rad]."""
LONGEST = 0.05
"""A ring of boxes around a straight piece is at most so long, in half lengths [m]."""

_Vector = NDArray[np.float64]


class _Piece(NamedTuple):
    """A short piece of the centre line: where its middle is, and how it turns."""

    middle: _Vector
    """(3,) [m]"""
    R: NDArray[np.float64]
    """Columns: tangent in the middle, to where it turns, and across (3, 3)."""
    length: float
    angle: float
    screw: float
    """How far a helix leaves the plane of the arc in its middle, at its ends [m]."""


def add_tunnel(spec: mujoco.MjSpec, cell: Cell) -> None:
    """Add the walls of a cell's tunnel to the model, all of one body, `tunnel`."""
    backbone, rig = cell.config.mechanism.backbone, cell.config.rig
    if backbone is None or rig is None:
        return
    walls, tunnel = spec.worldbody.add_body(name=f"{cell.prefix}tunnel"), rig.tunnel
    planar = backbone.axes == "planar"
    sides = (0.0, math.pi) if planar else tuple(i * math.pi / 4 for i in range(8))
    depth = 0.0
    for i, piece in enumerate(_pieces(backbone.entrance, tunnel.pieces or backbone.tunnel)):
        half = backbone.half_width
        if tunnel.half_width is not None and depth >= tunnel.narrow_from:
            half = tunnel.half_width
        depth += piece.length
        for k, side in enumerate(sides):
            out = math.cos(side) * piece.R[:, 1] + math.sin(side) * piece.R[:, 2]
            reach, inward = 0.5 * piece.length, piece.screw
            if piece.angle > 0.0:
                radius = piece.length / piece.angle - half * math.cos(side)
                reach = radius * math.tan(0.5 * piece.angle)
                inward += max(0.0, math.cos(side)) * radius * (1.0 - math.cos(0.5 * piece.angle))
            away = half + inward + 0.5 * tunnel.thickness
            across = tunnel.half_height
            if not planar:
                across = (half + inward + tunnel.thickness) * math.tan(math.pi / 8)
            R = np.column_stack((piece.R[:, 0], out, np.cross(piece.R[:, 0], out)))
            quat = np.zeros(4)
            mujoco.mju_mat2Quat(quat, R.ravel())
            fixed(
                walls.add_geom(
                    name=f"{cell.prefix}tunnel_{i}_{k}",
                    type=mujoco.mjtGeom.mjGEOM_BOX,
                    pos=piece.middle + away * out + np.array(tunnel.shift),
                    quat=quat,
                    size=(reach, 0.5 * tunnel.thickness, across),
                )
            )


def _pieces(entrance: PoseSection, tunnel: Sequence[SegmentSection]) -> Iterator[_Piece]:
    """Cut the centre line of what has walls into short pieces."""
    p, R = np.array(entrance.xyz), _attitude(entrance.rpy)
    for segment in tunnel:
        if segment.open:
            return
        if segment.to is not None:
            p, R = np.array(segment.to.xyz), _attitude(segment.to.rpy)
            continue
        bend = np.array([segment.bend, segment.climb])
        angle, roll = float(np.linalg.norm(bend)), segment.roll
        turn = np.array([roll, -segment.climb, segment.bend])
        count = math.ceil(math.hypot(angle, roll) / STEP - 1e-9)
        if not angle:
            count = math.ceil(segment.length / (2.0 * LONGEST) - 1e-9)
        count = max(1, count)
        inward = np.array([0.0, *(bend / angle if angle else (1.0, 0.0))])
        length = segment.length / count
        for _ in range(count):
            way, half = _onward(0.5 * length, 0.5 * turn / count)
            middle, mid = p + R @ way, R @ half
            to = mid @ inward
            across = np.cross(mid[:, 0], to)
            screw = angle * abs(roll) * length / (48.0 * count**2)
            yield _Piece(
                middle, np.column_stack((mid[:, 0], to, across)), length, angle / count, screw
            )
            way, whole = _onward(length, turn / count)
            p, R = p + R @ way, R @ whole


def _onward(length: float, turn: _Vector) -> tuple[_Vector, NDArray[np.float64]]:
    """Return the way (3,) [m] along x that turns evenly by a vector (3,) [rad], and R (3, 3)."""
    way, angle = np.array([1.0, 0.0, 0.0]), float(np.linalg.norm(turn))
    if not angle:
        return length * way, np.eye(3)
    quat, R, axis = np.zeros(4), np.zeros(9), turn / angle
    mujoco.mju_axisAngle2Quat(quat, axis, angle)
    mujoco.mju_quat2Mat(R, quat)
    once = np.cross(axis, way)
    way = way + (1.0 - math.cos(angle)) / angle * once
    way += (1.0 - math.sin(angle) / angle) * np.cross(axis, once)
    return length * way, R.reshape(3, 3)


def _attitude(rpy: tuple[float, float, float]) -> NDArray[np.float64]:
    quat, R = np.zeros(4), np.zeros(9)
    mujoco.mju_euler2Quat(quat, np.array(rpy), "XYZ")
    mujoco.mju_quat2Mat(R, quat)
    return R.reshape(3, 3)
