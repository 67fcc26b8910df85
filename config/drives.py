"""Drives of an arm: several in one table, their joints' bounds, and virtual ones for any arm."""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import ConfigError
from .schema.cell import CellConfig
from .schema.mechanism import MOST_DRIVES, DriveSection
from .schema.rig import RigDriveSection
from .urdf.elements import floats, origin_of, rotation
from .urdf.robot import Robot, UrdfJoint

# --- Joint bounds: the limits of the robot description, less the margin of each drive -------------


class JointBounds(NamedTuple):
    """Least and greatest angle that joints may be commanded to, in their order [rad]."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]


def joint_bounds(
    joints: Iterable[UrdfJoint], drives: Iterable[DriveSection], further: float = 0.0
) -> JointBounds:
    """Return the bounds of joints, `further` [rad] inside what they may be commanded to."""
    margins = {drive.joint: drive.position_margin + further for drive in drives}
    bounds = [(j.lower + margins[j.name], j.upper - margins[j.name]) for j in joints]
    return JointBounds(tuple(b[0] for b in bounds), tuple(b[1] for b in bounds))


# --- One `[[mechanism.drives]]` table for several joints: `joint = "j1..j15"`, nodes counted on ---

HIGHEST_NODE: Final = 126
"""The daemon's own is the next one."""
_RANGE: Final = re.compile(r"([A-Za-z][A-Za-z0-9_-]*?)(\d+)\.\.([A-Za-z][A-Za-z0-9_-]*?)(\d+)")


def expand(path: Path, config: CellConfig, place: str) -> CellConfig:
    """Return the configuration with one drive for each joint; the mechanism stands at `place`.

    Raises `ConfigError`.
    """
    drives: list[DriveSection] = []
    for i, drive in enumerate(config.mechanism.drives):
        drives += _joints_of(f"{path}: {place}.drives[{i}]", i, drive)
    if len(drives) > MOST_DRIVES:
        raise ConfigError(f"{path}: {place}.drives: {len(drives)} joints, at most {MOST_DRIVES}")
    mechanism = config.mechanism.model_copy(update={"drives": tuple(drives)})
    return config.model_copy(update={"mechanism": mechanism})


def _joints_of(where: str, index: int, drive: DriveSection) -> list[DriveSection]:
    """Return the drives that a table means, in the order of counting."""
    names = [drive.joint] if ".." not in drive.joint else _names(where, drive.joint)
    last = drive.node + len(names) - 1
    if len(names) > 1 and last > HIGHEST_NODE:
        raise ConfigError(
            f"{where}.node: value {drive.node}: joints {drive.joint} need nodes up to "
            f"{last}; must be at most {HIGHEST_NODE}"
        )
    return [drive.of_table(index, name, drive.node + k) for k, name in enumerate(names)]


def _names(where: str, text: str) -> list[str]:
    match = _RANGE.fullmatch(text)
    stem, low, other, high = match.groups() if match else ("", "1", "", "0")
    count = int(high[:9]) - int(low[:9]) + 1
    if stem != other or not 1 <= count <= MOST_DRIVES or len(high) > 9:
        raise ConfigError(
            f"{where}.joint: value '{text}': a range counts up by at most {MOST_DRIVES} joints of "
            "one name, as 'j1..j15' does"
        )
    width = len(low) if low.startswith("0") else 0
    return [f"{stem}{int(low) + k:0{width}d}" for k in range(count)]


# --- Virtual drives for any arm: loop gains and rotors by the inertia that each joint moves -------
#
# The loops of all joints are as quick: a natural frequency of `LOOP` at the greatest inertia
# that the joint meets, which the rotor's part keeps from falling far below.

Vector = NDArray[np.float64]
LOOP: Final = 80.0
"""Natural frequency of a position loop [rad/s]."""
DAMPING: Final = 0.8
"""Its damping ratio [1]."""
INTEGRAL: Final = 10.0
"""Integral over proportional gain [1/s]."""
ROTOR: Final = 0.3
"""Inertia of a rotor behind its gear, by the greatest that its joint moves [1]."""
LEAST_ROTOR: Final = 5e-3
"""Of the smallest gear motors, at the joint [kg·m²]."""
FRICTION: Final = 0.01
"""Coulomb friction, by the greatest torque of the drive [1]."""
STUCK: Final = 2e-3
"""A joint that is off by so much breaks loose, however strong the drive is said to be [rad]."""
_POSTURES: Final = 16
"""So many are looked at, beside those that the cell names [1]."""


class _Body(NamedTuple):
    """A link: the joint that carries it, and its mass."""

    name: str
    joint: str
    movable: bool
    prismatic: bool
    above: int
    """Index of its parent, −1 for the root."""
    R: Vector
    p: Vector
    axis: Vector
    mass: float
    com: Vector
    inertia: Vector


def with_drives(config: CellConfig, robot: Robot) -> CellConfig:
    """Return the configuration with all values of `[rig.drive]` that the file leaves out."""
    if config.rig is None:
        return config
    given = config.rig.drive
    names = ("stiffness", "damping", "integral", "armature", "friction")
    if all(getattr(given, name) for name in names):
        return config
    missing = {k: v for k, v in _drives(config, robot).items() if not getattr(given, k)}
    rig = config.rig.model_copy(update={"drive": given.model_copy(update=missing)})
    return config.model_copy(update={"rig": rig})


def _drives(config: CellConfig, robot: Robot) -> dict[str, tuple[float, ...]]:
    rig, drives = config.rig, {drive.joint: drive for drive in config.mechanism.drives}
    payload = 0.0 if rig is None else rig.payload_mass
    named = [q for q in config.mechanism.postures.values() if len(q) == len(robot.joints)]
    moved = greatest_inertias(robot, config.mechanism.tip_link, named, payload)
    if (base := config.mechanism.base) is not None:
        moved[:2] += 0.5 * _mass(robot) * base.wheels.radius**2
    given = RigDriveSection() if rig is None else rig.drive
    n = len(moved)
    told = np.resize(np.array(given.armature), n) if given.armature else None
    rotors = np.maximum(ROTOR * moved, LEAST_ROTOR) if told is None else told
    whole = moved + rotors
    torque = np.array([drives[joint.name].max_torque for joint in robot.joints])
    friction = np.minimum(FRICTION * torque, STUCK * LOOP**2 * whole)
    return {
        "stiffness": _rounded(LOOP**2 * whole),
        "damping": _rounded(2.0 * DAMPING * LOOP * whole),
        "integral": _rounded(INTEGRAL * LOOP**2 * whole),
        "armature": _rounded(rotors),
        "friction": _rounded(friction),
    }


def greatest_inertias(
    robot: Robot, tip_link: str, postures: list[tuple[float, ...]], payload: float
) -> Vector:
    """Return the greatest inertia that each joint moves at some postures (n,) [kg·m² or kg].

    Of the joint alone, the others held; with a point mass `payload` [kg] at the tip link.
    """
    bodies = _bodies(ET.fromstring(robot.description()), tip_link, payload)
    lower = np.array([max(joint.lower, -math.pi) for joint in robot.joints])
    upper = np.array([min(joint.upper, math.pi) for joint in robot.joints])
    lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)
    draw = np.random.default_rng(0)
    drawn = [draw.uniform(lower, upper) for _ in range(_POSTURES)]
    order = [joint.name for joint in robot.joints]
    each = [_inertias(bodies, dict(zip(order, q, strict=True))) for q in (*postures, *drawn)]
    return np.array([max(one.get(name, 0.0) for one in each) for name in order])


def _mass(robot: Robot) -> float:
    """Return the mass of all links [kg]."""
    links = ET.fromstring(robot.description()).findall("link")
    return math.fsum(_inertial(link)[0] for link in links)


def _bodies(root: ET.Element, tip_link: str, payload: float) -> list[_Body]:
    """Return all links, parents first."""
    carried: dict[str, ET.Element] = {}
    below: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        parent, child = _link(joint, "parent"), _link(joint, "child")
        carried[child] = joint
        below.setdefault(parent, []).append(child)
    links = {link.get("name", ""): link for link in root.findall("link")}
    found: list[_Body] = []
    waiting = [(name, -1) for name in links if name not in carried]
    while waiting:
        name, above = waiting.pop()
        mass, com, inertia = _inertial(links[name])
        if name == tip_link and payload > 0.0:
            com = (mass * com) / (mass + payload)
            mass += payload
        joint_ = carried.get(name)
        kind = "fixed" if joint_ is None else joint_.get("type", "")
        R, p = origin_of(joint_)
        axis = None if joint_ is None else joint_.find("axis")
        along = floats("1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
        found.append(
            _Body(
                name, "" if joint_ is None else joint_.get("name", ""), kind != "fixed",
                kind == "prismatic", above, R, p, along / max(float(np.linalg.norm(along)), 1e-12),
                mass, com, inertia,
            )
        )  # fmt: skip
        waiting += [(child, len(found) - 1) for child in below.get(name, []) if child in links]
    return found


def _inertias(bodies: list[_Body], q: dict[str, float]) -> dict[str, float]:
    """Return what each joint moves about its axis, or along it, at one posture."""
    frames: list[tuple[Vector, Vector]] = []
    axes: dict[str, tuple[Vector, Vector, bool]] = {}
    moved: dict[str, float] = {}
    movers: list[tuple[str, ...]] = []
    for body in bodies:
        R, p = frames[body.above] if body.above >= 0 else (np.eye(3), np.zeros(3))
        p, R = p + R @ body.p, R @ body.R
        by = movers[body.above] if body.above >= 0 else ()
        if body.movable:
            by, axes[body.joint] = (*by, body.joint), (p, R @ body.axis, body.prismatic)
            moved[body.joint] = 0.0
            value = q.get(body.joint, 0.0)
            if body.prismatic:
                p = p + R @ body.axis * value
            else:
                R = R @ rotation(body.axis, value)
        frames.append((R, p))
        movers.append(by)
        centre, inertia = p + R @ body.com, R @ body.inertia @ R.T
        for name in by:
            origin, axis, prismatic = axes[name]
            lever = np.cross(axis, centre - origin)
            about = float(axis @ inertia @ axis) + body.mass * float(lever @ lever)
            moved[name] += body.mass if prismatic else about
    return moved


def _inertial(link: ET.Element) -> tuple[float, Vector, Vector]:
    inertial = link.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    tensor = None if inertial is None else inertial.find("inertia")
    if inertial is None or mass is None or tensor is None:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    R, com = origin_of(inertial)
    xx, xy, xz, yy, yz, zz = (
        float(tensor.get(k, "0")) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return float(mass.get("value", "0")), com, R @ own @ R.T


def _link(joint: ET.Element, which: str) -> str:
    element = joint.find(which)
    return "" if element is None else element.get("link", "")


def _rounded(values: Vector) -> tuple[float, ...]:
    """Return three digits of each, as a person would write them."""
    return tuple(float(f"{max(x, 1e-9):.3g}") for x in values.tolist())
