"""A peg as the tool, and blocks with a hole that it fits, made of what MuJoCo touches well.

The peg is a ring of upright capsules: a cylinder against boxes has contact points that leap from
one end of a line to the other, and forces that leap with them. The hole is three rings of boxes,
one to a side: wall, chamfer and rim. A box reaches past the ends of its side into its neighbours,
never into the hole: inside of an octagon is what is inside of all its sides.
"""

import math

import mujoco

from .....config.schema.rig.peg import RigHoleSection, RigPegSection
from .....config.schema.section import PoseSection
from ..geoms import fixed, of_arm, quaternion

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
