"""A chassis that drives: a free body on two driven wheels and two casters, on a floor.

The wheels touch the floor as ellipsoids, in one point: cylinders touch along a line, scrub where
the base turns, and odometry is half a metre off after five. The casters are balls without friction.
"""

from typing import Final

import mujoco

from .....config.schema.mechanism.base import DifferentialBaseSection
from ..geoms import ARM, SOLIMP

FLOOR: Final = "floor"
"""Geom that wheels, casters and the arm stand on and touch; it is no obstacle."""
ROLLS: Final = 4
"""Contact group of wheels, casters and floor."""
FREE: Final = "base_free"
"""Joint of the chassis: place and quaternion of Base in World."""
GRIP: Final = 0.9
"""Friction of the wheels on the floor [1]."""

_HALF_WIDTH: Final = 0.4
"""Half the width of a wheel's ellipsoid, per radius [1]."""
_CASTER_RADIUS: Final = 0.04
_CASTERS_APART: Final = 0.6
"""Casters are so far before and behind the axle, per track [1]."""
_SOLREF: Final = (0.008, 1.0)


def put_on_wheels(arm: mujoco.MjSpec, base: DifferentialBaseSection) -> None:
    """Let the root of an arm drive. Raises `ValueError` where a wheel has no body."""
    root, wheels = arm.worldbody.first_body(), base.wheels
    root.add_joint(name=FREE, type=mujoco.mjtJoint.mjJNT_FREE)
    for name in (wheels.left, wheels.right):
        body = arm.joint(name).parent
        for shape in body.geoms:
            shape.contype = shape.conaffinity = 0
        tyre = body.add_geom(
            name=f"{name}_tyre",
            type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            size=(wheels.radius, _HALF_WIDTH * wheels.radius, wheels.radius),
            density=0,
        )
        _rolls(tyre, GRIP)
    for side in (-1.0, 1.0):
        ball = root.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=(_CASTER_RADIUS, 0.0, 0.0),
            pos=(side * _CASTERS_APART * wheels.track, 0.0, _CASTER_RADIUS),
            density=0,
        )
        _rolls(ball, 0.0)


def add_floor(spec: mujoco.MjSpec) -> None:
    """Add the floor, in World's plane of x and y."""
    floor = spec.worldbody.add_geom(
        name=FLOOR, type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0.0, 0.0, 0.05)
    )
    _rolls(floor, 0.0)
    floor.conaffinity = ROLLS | ARM


def _rolls(geom: mujoco.MjsGeom, friction: float) -> None:
    """Make a geom touch the floor; of two, the friction of the rougher one counts."""
    geom.contype = geom.conaffinity = ROLLS
    geom.condim = 3
    geom.friction[:] = friction, 0.0, 0.0
    geom.solref[:], geom.solimp[:] = _SOLREF, SOLIMP
