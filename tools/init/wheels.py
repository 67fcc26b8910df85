"""A base that `init` finds: two driven wheels on one axle, or why what carries the arm is held."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ...config.urdf.elements import check_elements, end_of, floats, origin_of
from ...config.urdf.links import movable
from ...config.urdf.robot import ALONG_AXLE
from ...config.urdf.shapes import Array, link_shape
from .draft import QUICKEST, STRONGEST, DriveDraft, Wheels, limit_of
from .robot import UrdfArm, carried_mass, is_wheel, moves

LIKE: Final = 0.01  # radii that differ by more of one are two, and places of the track [1]
AT_FLOOR: Final = 0.1  # a wheel's rim is on the root's floor within this part of its radius [1]
LEAST_RADIUS: Final = 0.01  # of a wheel that a cell can have [m]
UNKNOWN_SPEED: Final = 5.0  # of a wheel whose URDF says none [rad/s]
RIM: Final = 0.75  # a wheel rolls no faster [m/s]
STRAIGHT: Final = 2.0 / 3.0  # part of a wheel's speed for straight on, the rest is to turn [1]
SPEED: Final = (0.5, 1.0)  # most of a base [m/s], [rad/s]
STOPS_S: Final = 0.85  # time in which the acceleration ends the greatest speed [s]
STARTS: Final = 1.0  # a base accelerates no more [m/s²]
PART: Final = 0.6  # of a wheel's torque that accelerates the base [1]
_OF_A_CASTER: Final = re.compile(r"caster|castor|swivel", re.IGNORECASE)


@dataclass(frozen=True)
class _Wheel:
    """One wheel of the chassis; all in the root link."""

    joint: ET.Element
    place: Array  # (3,) [m]
    axis: Array  # unit vector (3,)
    radius: float  # by its shape; 0: it has none [m]

    @property
    def name(self) -> str:
        return self.joint.get("name", "")


def base_of(arms: Sequence[UrdfArm], packages: Mapping[str, Path]) -> Wheels | str | None:
    """Return the driven wheels of the base that carries a file's only arm.

    Where the base moves otherwise, or as no cell can have it, the reason why it is held; None of an
    arm that stands. Raises `ConfigError` for numbers and meshes that cannot be read.
    """
    arm = arms[0]
    check_elements(arm.root, arm.urdf, ("joint",))
    wheels = _wheels(arm, packages)
    kinds = (
        ("(planar)",)
        if len(arms) > 1
        else ("(planar)", "(prismatic)", "(revolute)", "(continuous)")
    )
    over_floor = [told for told in arm.standing if told.endswith(kinds)]
    names = ", ".join(wheel.name for wheel in wheels)
    if not wheels:
        away = [
            joint.get("name", "")
            for joint in arm.root.findall("joint")
            if moves(joint) and is_wheel(joint) and not _of_a_caster(arm, joint)
        ]
        if away:
            return f"no wheel of it is on its chassis and turns for ever: {', '.join(away)}"
        return f"no wheels drive it: {', '.join(over_floor)}" if over_floor else None
    if len(wheels) != 2:
        return f"{len(wheels)} wheels drive it, not two on one axle: {names}"
    left, right = sorted(wheels, key=lambda wheel: -float(wheel.place[1]))
    if min(abs(float(wheel.axis[1])) for wheel in wheels) < ALONG_AXLE:
        axes = ", ".join(f"{w.name} about {_shown(w.axis)}" for w in wheels)
        return f"its wheels must turn about the root link's y axis: {axes}"
    found = _checked(arm, left, right)
    if len(arms) > 1 and isinstance(found, Wheels):
        return f"{names} drive it, but a cell of several arms has no base that drives"
    return found


def _checked(arm: UrdfArm, left: _Wheel, right: _Wheel) -> Wheels | str:
    """Return two wheels that turn about y; or why they are none of a differential base."""
    track = float(left.place[1] - right.place[1])
    middle = 0.5 * (left.place + right.place)
    names = f"{left.name} and {right.name}"
    apart = float(np.abs(left.place - right.place)[[0, 2]].max())
    if not 0.05 < track <= 5.0 or apart > LIKE * track:
        return (
            f"{names} are not on one axle: at {_shown(left.place)} and {_shown(right.place)} m of "
            "the root link"
        )
    if float(np.abs(middle[:2]).max()) > LIKE * track:
        return (
            f"the middle of {names} is at x {middle[0]:.4g}, y {middle[1]:.4g} m of the root link: "
            f"must be within {LIKE * track:.3g} m of it"
        )
    radii = [wheel.radius for wheel in (left, right)]
    radius = 0.5 * sum(radii)
    if 0.0 in radii:  # the root link is on the floor
        radius = float(middle[2])
    elif abs(radii[0] - radii[1]) > LIKE * radius:
        return f"{names} have different radii: {radii[0]:.4g} and {radii[1]:.4g} m"
    if not LEAST_RADIUS < radius <= 2.0:
        return f"{names} have no radius: by shape and place {radius:.4g} m"
    height = radius - float(middle[2])
    if abs(height) <= LIKE * radius:
        height = 0.0
    mass = carried_mass(arm, arm.tree.roots[0])
    drives = _drive(left.joint, radius, mass), _drive(right.joint, radius, mass)
    rim = radius * min(drive.velocity for drive in drives)
    speed = min(SPEED[0], STRAIGHT * rim)
    angular = min(SPEED[1], 1.98 * (rim - speed) / track)
    return Wheels(round(radius, 5), round(track, 5), round(height, 5), speed, angular, drives)


def _wheels(arm: UrdfArm, packages: Mapping[str, Path]) -> list[_Wheel]:
    """Return the wheels on a chassis that turn for ever, casters left out.

    A wheel is called so, or its rim is on the root link's floor.
    """
    found, order = [], arm.root.findall("joint")
    for joint, R, p in sorted(_on_chassis(arm), key=lambda row: order.index(row[0])):
        if joint.get("type") != "continuous" or joint.find("mimic") is not None:
            continue
        axis = joint.find("axis")
        own = floats("1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
        own = own / max(float(np.linalg.norm(own)), 1e-12)
        along = R @ own
        beyond = arm.tree.walk(end_of(joint, "child"))
        further = [j for link, _, _ in beyond for j in arm.tree.below(link)]
        if abs(along[2]) > 0.5 or any(map(movable, further)) or _of_a_caster(arm, joint):
            continue
        radius = _radius(arm, end_of(joint, "child"), own, packages)
        on_floor = radius > 0.0 and abs(float(p[2]) - radius) < AT_FLOOR * radius
        if is_wheel(joint) or on_floor:
            found.append(_Wheel(joint, p, along, radius))
    return found


def _on_chassis(arm: UrdfArm) -> Iterator[tuple[ET.Element, Array, Array]]:
    """Yield joints on the root link, or on links held on it, with attitude and place in it."""
    standing = {told.rsplit(" (", 1)[0] for told in arm.standing}

    def held(joint: ET.Element) -> bool:
        still = joint.get("name") in standing or joint.get("type") in ("fixed", "prismatic")
        return still and joint not in arm.chain

    for link, R, p in arm.tree.walk(arm.tree.roots[0], held):
        for joint in arm.tree.below(link):
            if joint not in arm.chain and not held(joint):
                turn, shift = origin_of(joint)
                yield joint, R @ turn, p + R @ shift


def _radius(arm: UrdfArm, link: str, axis: Array, packages: Mapping[str, Path]) -> float:
    """Return how far a wheel's shape stands out from its axis (3,) [m]; 0 without a shape."""
    most = 0.0
    for name, R, p in arm.tree.walk(link):
        shape = link_shape(arm.tree.links[name], arm.urdf, packages, around=False)
        if shape is not None:
            points = shape.triangles.reshape(-1, 3) @ R.T + p
            most = max(most, float(np.linalg.norm(np.cross(points, axis), axis=1).max()))
    return most


def _drive(joint: ET.Element, radius: float, mass: float) -> DriveDraft:
    """Return the drive of a wheel that rolls half of a mass [kg]."""
    name, notes = joint.get("name", ""), []
    speed, torque = limit_of(joint, "velocity"), limit_of(joint, "effort")
    if speed <= 0.0:
        notes.append(f"the URDF has no speed limit of {name}")
    velocity = min(0.5 * speed if speed > 0.0 else UNKNOWN_SPEED, RIM / radius)
    acceleration = min(QUICKEST, STARTS / radius)
    inertia = 1.3 * 0.5 * mass * radius**2  # with the rotor's
    needed = inertia * min(acceleration, velocity / STOPS_S)
    if not 0.3 * needed < torque <= STRONGEST:
        told = "is missing, or absurd"
        if 0.0 < torque <= STRONGEST:
            told = f"is {torque:g}, and would not drive the base, which takes {needed:.3g}"
        notes.append(f"the URDF's torque limit of {name} {told}")
        torque = float(f"{2.0 * needed + 0.5:.2g}")
    acceleration = max(0.05, min(acceleration, PART * torque / inertia))
    velocity = max(2e-3, min(velocity, STOPS_S * acceleration))
    return DriveDraft(name, False, velocity, acceleration, torque, notes=notes, rolls=True)


def _of_a_caster(arm: UrdfArm, joint: ET.Element) -> bool:
    """Return whether a joint is a caster's: called so, or on a joint that turns for ever."""
    above = [j for j in arm.root.findall("joint") if end_of(j, "child") == end_of(joint, "parent")]
    names = f"{joint.get('name')} {end_of(joint, 'parent')} {end_of(joint, 'child')}"
    swivels = any(j.get("type") == "continuous" and j not in arm.chain for j in above)
    carries = any(f"{j.get('name')} (continuous)" in arm.standing for j in above)
    return _OF_A_CASTER.search(names) is not None or (swivels and not carries)


def _shown(vector: Array) -> str:
    return "(" + ", ".join(f"{float(x) + 0.0:.3g}" for x in vector) + ")"
