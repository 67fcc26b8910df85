"""What moves in the virtual world: a platform under the arm, the Carrier, a chassis that drives."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell
from ....config.schema.mechanism import DifferentialBaseSection
from ....config.schema.surroundings import RigMotionSection
from ....protocols.messages.perception import RigMotion
from .geoms import ARM, SOLIMP

# --- Movers of the virtual world: the platform under the arm, and the Carrier ---------------------

Vector = NDArray[np.float64]

MOST_ACCELERATION = 50.0
"""Greatest acceleration of a sway, at its turning points [m/s², rad/s²]."""
_TAKE_UP = 4.0
"""Natural frequency with which a sway is taken up and laid down [rad/s]."""


@dataclass
class Mover:
    """A displacement (6,) that drifts and sways, smoothly whatever it is told."""

    dt: float
    acceleration: float
    place: Vector = field(default_factory=lambda: np.zeros(6))
    """Displacement now [m, rad]."""
    rate: Vector = field(default_factory=lambda: np.zeros(6))
    """Its rate now [m/s, rad/s]."""
    _drift: Vector = field(default_factory=lambda: np.zeros((3, 6)))
    """Displacement by the twist, its rate, and the rate that was told."""
    _sway: Vector = field(default_factory=lambda: np.zeros((3, 6)))
    """Amplitude of the sway, its rate, and the amplitude that was told."""
    _phase: float = 0.0
    _period_s: float = 4.0

    def move(self, motion: RigMotion | RigMotionSection) -> None:
        """Move like this from now on."""
        self._drift[2], self._sway[2] = motion.twist, motion.sway
        self._period_s = motion.period_s

    def step(self) -> None:
        """Advance by one physics step."""
        dt, drift, sway = self.dt, self._drift, self._sway
        most = self.acceleration * dt
        drift[1] += np.clip(drift[2] - drift[1], -most, most)
        drift[0] += drift[1] * dt
        sway[1] += dt * (_TAKE_UP**2 * (sway[2] - sway[0]) - 2.0 * _TAKE_UP * sway[1])
        sway[0] += sway[1] * dt
        self._phase += 2.0 * math.pi * dt / self._period_s
        place = drift[0] + sway[0] * math.sin(self._phase)
        self.rate = (place - self.place) / dt
        self.place = place


class Movers:
    """All of a cell's movers by name: `platform` where Base may move, `carrier` where it may."""

    def __init__(self, cell: Cell) -> None:
        rig, frames = cell.config.rig, cell.config.frames
        if rig is None:
            raise ValueError(f"cell {cell.config.name} has no [rig]: nothing to simulate")
        rolls = cell.config.mechanism.base is not None
        there = {"platform": None if rolls else frames.base, "carrier": frames.carrier}
        self.by_name = {
            name: Mover(rig.physics_step_s, rig.frames.acceleration)
            for name, frame in there.items()
            if frame is not None
        }
        for name, mover in self.by_name.items():
            mover.move(getattr(rig.frames, name))

    def move(self, motion: RigMotion) -> None:
        """Move one of them.

        Raises `ValueError`, in one line, where the cell has it not, and for a sway that is absurd.
        """
        if motion.target not in self.by_name:
            table = {"platform": "frames.base", "carrier": "frames.carrier"}[motion.target]
            raise ValueError(f"motion: no {motion.target} in a cell without [{table}]")
        peak = max(abs(x) for x in motion.sway) * (2.0 * math.pi / motion.period_s) ** 2
        if peak > MOST_ACCELERATION:
            raise ValueError(
                f"motion: a sway of {max(abs(x) for x in motion.sway):g} in {motion.period_s:g} s "
                f"accelerates by {peak:.3g}: must be at most {MOST_ACCELERATION:g} m/s², rad/s²"
            )
        self.by_name[motion.target].move(motion)

    def step(self) -> None:
        """Advance all by one physics step."""
        for mover in self.by_name.values():
            mover.step()


# --- A chassis that drives: a free body on wheels, and on casters where they are two, on a floor --
#
# The wheels touch the floor as ellipsoids, in one point: cylinders touch along a line, scrub
# where the base turns, and odometry is half a metre off after five. The casters are balls
# without friction. Wheels that follow a driven one are tyres on axles of their own, coupled to it:
# their links keep mass and shape. With Coulomb friction and equal loads, wheels on two axles L
# apart with a track b turn the base as if it were 1 + (L / b)² as wide: the friction of each is
# against its slip, and the moments of what slips ahead and aside balance.

FLOOR: Final = "floor"
"""Geom that wheels, casters and the arm stand on and touch; it is no obstacle."""
ROLLS: Final = 4
"""Contact group of wheels, casters and floor."""
CHASSIS: Final = 8
"""Contact group of the chassis, which touches all that an arm does but the floor."""
FREE: Final = "base_free"
"""Joint of the chassis: place and quaternion of Base in World."""
TYRE: Final = "_tyre"
"""Geoms of a side's wheels begin with the driven joint's name and this."""
GRIP: Final = 0.9
"""Friction of wheels that roll on the floor [1]."""
_SKIDS: Final = 0.6
"""The same of wheels that slide over it as the base turns [1]."""

_HALF_WIDTH: Final = 0.4
"""Half the width of a wheel's ellipsoid, per radius [1]."""
_CASTER_RADIUS: Final = 0.04
_CASTERS_APART: Final = 0.6
"""Casters are so far before and behind the axle, per track [1]."""
_SOLREF: Final = (0.008, 1.0)
_SOFT_SOLREF: Final = (0.04, 1.0)
"""Of tyres on several axles: hard ones rock the chassis, and touch the floor by turns."""
_TYRE_MASS: Final = 0.1
_TYRE_INERTIA: Final = 0.02
"""Of a wheel that follows a driven one, about its axle [kg·m²]; its link has its mass [kg]."""
_BELT_SOLREF: Final = (0.004, 1.0)


def put_on_wheels(
    arm: mujoco.MjSpec,
    base: DifferentialBaseSection,
    height: float,
    axles: Mapping[str, tuple[float, ...]],
) -> None:
    """Let the root of an arm drive, so high above the floor [m].

    `axles` are where in Base followers turn (3,) [m], by joint. Raises `ValueError` where a wheel
    has no body.
    """
    root, wheels, tyres = arm.worldbody.first_body(), base.wheels, list[mujoco.MjsGeom]()
    root.add_joint(name=FREE, type=mujoco.mjtJoint.mjJNT_FREE)
    for name in (wheels.left, wheels.right):
        body = arm.joint(name).parent
        for shape in body.geoms:
            shape.contype = shape.conaffinity = 0
        tyre = _tyre(body, f"{name}{TYRE}", wheels.radius)
        tyres.append(tyre)
        axis = np.array(arm.joint(name).axis)
        axis = axis if axis[1] >= 0.0 else -axis
        if axis[1] < 0.99:  # the tyre's y axis along the wheel's
            turn = np.array([1.0 + axis[1], axis[2], 0.0, -axis[0]])
            tyre.quat = turn / np.linalg.norm(turn)
    for name, place in axles.items():
        driven = wheels.left if place[1] > 0.0 else wheels.right
        body = root.add_body(name=f"{name}_axle", pos=place)  # behind the arm's, in the model
        body.mass, body.explicitinertial, body.inertia[:] = _TYRE_MASS, True, [_TYRE_INERTIA] * 3
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, 1.0, 0.0))
        tyres.append(_tyre(body, f"{driven}{TYRE}_{name}", wheels.radius))
        belt = arm.add_equality(
            name=f"{name}_belt",
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=name,
            name2=driven,
        )
        belt.data[1] = 1.0
        belt.solref[:], belt.solimp[:] = _BELT_SOLREF, SOLIMP
    for tyre in tyres if axles else ():
        tyre.solref[:], tyre.priority, tyre.friction[0] = _SOFT_SOLREF, 1, _SKIDS
    for body in _welded(root):  # capsules reach below it where a chassis is flat
        for shape in body.geoms:
            shape.contype &= ~ARM
            shape.contype |= CHASSIS
    for side in (-1.0, 1.0) if not axles else ():
        ball = root.add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=(_CASTER_RADIUS, 0.0, 0.0),
            pos=(side * _CASTERS_APART * wheels.track, 0.0, _CASTER_RADIUS - height),
            density=0,
        )
        _rolls(ball, 0.0)


def _tyre(body: mujoco.MjsBody, name: str, radius: float) -> mujoco.MjsGeom:
    """Add what touches the floor of a wheel that turns about the body's y axis."""
    tyre = body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        size=(radius, _HALF_WIDTH * radius, radius),
        density=0,
    )
    _rolls(tyre, GRIP)
    return tyre


def _welded(body: mujoco.MjsBody) -> Iterator[mujoco.MjsBody]:
    """Yield a body, and those that no joint moves relative to it."""
    yield body
    for child in body.bodies:
        if not child.joints:
            yield from _welded(child)


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
