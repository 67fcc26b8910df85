"""The robot description: the serial chain of a URDF, and the joints beside it."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from ..errors import ConfigError, nearest
from ..schema.cell import CellConfig
from ..schema.mechanism import DriveSection, LinkInertialSection
from .elements import (
    balance,
    carriers,
    check_bodies,
    check_elements,
    floats,
    give_inertials,
    leave_out,
    mesh_links,
    normalise,
    origin_of,
    refuse_xacro,
    simplify,
    unshaped_links,
)

# --- The robot description: the serial chain of a URDF from its root link to the tip link ---------
#
# Only what the cell's drives are held against is read here; kinematics, inertias and shapes are
# for the libraries that compute with them. They are given a plain description: the chain's
# joints, all others fixed, and no meshes, which nothing that runs an arm reads.

CONTINUOUS_RANGE: Final = 2 * math.pi
"""A continuous joint is bounded to one turn either way: cables and counts are finite [rad]."""

TURNS_FOR_EVER: Final = 1e9
"""Wheels have no position limits: no command gets here [rad]."""
ALONG_AXLE: Final = 1.0 - 1e-5
"""Part of a wheel's unit axis along Base's y axis, at least: files write 1.57 for a turn [1]."""
LARGEST_FILE: Final = 1 << 24
"""A URDF of more bytes holds meshes, or is none [1]."""
DEEPEST: Final = 32
"""Elements are not nested more deeply than this [1]."""
_MOVABLE: Final = ("revolute", "continuous", "prismatic")
_SAID: Final = ("lower", "upper", "velocity", "effort")


@dataclass(frozen=True)
class UrdfJoint:
    """A movable joint with its limits; a prismatic one in metres and newtons."""

    name: str
    lower: float
    """Least position [rad or m]."""
    upper: float
    """Greatest position [rad or m]."""
    velocity: float
    """Speed bound [rad/s or m/s]."""
    effort: float
    """Torque or force bound [N·m or N]."""
    kind: str = "revolute"
    """revolute, continuous or prismatic."""
    reversed: bool = False
    """The file's axis points the other way: a wheel that turns about -y of Base."""


@dataclass(frozen=True)
class Robot:
    """A serial chain: the file that it stands in, and its movable joints from base to tip.

    Movable joints outside of the chain (a gripper's) do not appear: they are held at zero.
    """

    urdf: Path
    joints: tuple[UrdfJoint, ...]
    inertials: tuple[LinkInertialSection, ...] = ()
    """Of links for which the cell has others than the file, or the file none."""
    without: tuple[str, ...] = ()
    """Links that other mechanisms have, each with all that it carries."""
    first_link: str = ""
    """The link that the chain's first joint moves."""

    def tree(self) -> ET.Element:
        """Return the outer element of the file, less what other mechanisms have."""
        root = read_tree(self.urdf)
        if self.without:
            leave_out(root, self.without, self.first_link)
        return root

    def links(self) -> list[str]:
        """Return the names of all links."""
        return [link.get("name", "") for link in self.tree().findall("link")]

    def unshaped_links(self) -> list[str]:
        """Return the names of links that have mass but no shape to keep clear by."""
        return list(unshaped_links(self.tree()))

    def mesh_links(self) -> list[str]:
        """Return the names of links whose shape holds a mesh: capsules have to stand for it."""
        return mesh_links(self.tree())

    def description(self, root_link: str | None = None, *, looks: bool = False) -> str:
        """Return a plain URDF: each continuous joint of the chain as a bounded revolute one.

        Numbers are written in one way; joints outside of the chain are fixed, at zero; meshes and
        all that is only looked at are left out, unless `looks`; inertias are those that the cell
        has; a wheel's positive sense drives ahead. With `root_link` the root is called so.

        Libraries give a continuous joint two coordinates; a drive has one.
        """
        root = self.tree()
        give_inertials(root, self.urdf, self.inertials)
        balance(root)
        simplify(root, [joint.name for joint in self.joints], root_link, looks=looks)
        normalise(root)
        self._put_wheels_first(root)
        known = {joint.name: joint for joint in self.joints}
        for element in root.findall("joint"):
            if (joint := known.get(element.get("name", ""))) is not None:
                _give_limits(element, joint)
        return ET.tostring(root, encoding="unicode")

    def _put_wheels_first(self, root: ET.Element) -> None:
        """Move wheels before all other joints: MuJoCo orders bodies as joints stand in the file."""
        wheels = [joint.name for joint in self.joints if joint.upper >= TURNS_FOR_EVER]
        elements = {e.get("name", ""): e for e in root.findall("joint")}
        order = [name for name in elements if name in wheels]
        if order == wheels and list(elements)[: len(wheels)] == wheels:
            return
        for name in reversed(wheels):
            root.remove(elements[name])
            root.insert(0, elements[name])


def read_robot(
    urdf: Path,
    tip_link: str,
    asked_by: str,
    drives: Mapping[str, DriveSection] | None = None,
    inertials: tuple[LinkInertialSection, ...] = (),
    *,
    first_joint: str | None = None,
    without: tuple[str, ...] = (),
) -> Robot:
    """Read the chain that ends in `tip_link`, and begins with `first_joint` where that is said.

    `asked_by` is the file and key that names the tip link, for the error. `drives`, by joint, and
    `inertials` say what the file leaves out; the links `without` are other mechanisms'. Raises
    `ConfigError` if the file cannot be read, is not a URDF, or holds no such chain of joints that
    we can drive.
    """
    root = read_tree(urdf)
    links = [link.get("name", "") for link in root.findall("link")]
    if tip_link not in links:
        hint = nearest(tip_link, links)
        raise ConfigError(f"{asked_by}: value '{tip_link}': no such link in {urdf}{hint}")
    place = asked_by.removesuffix("tip_link")
    for other in without:
        if other not in links:
            hint = nearest(other, links)
            raise ConfigError(f"{place}without: value '{other}': no such link in {urdf}{hint}")
    if without:
        if first_joint is None:
            raise ConfigError(f"{place}without: needs first_joint, which the arm begins with")
        first = root.find(f"joint[@name='{first_joint}']")
        own = "" if first is None else _end(first, "child", urdf)
        if own in carriers(root, tip_link):  # otherwise told below
            for other in without:
                if own in carriers(root, other):
                    raise ConfigError(
                        f"{place}without: value '{other}': first_joint '{first_joint}' carries it: "
                        "must be another mechanism's"
                    )
            leave_out(root, without, own)
            links = [link.get("name", "") for link in root.findall("link")]
    give_inertials(root, urdf, inertials)
    parent_joint: dict[str, ET.Element] = {}
    for element in root.findall("joint"):
        child = _end(element, "child", urdf)
        if child in parent_joint:
            raise ConfigError(f"{urdf}: link '{child}': is the child of two joints")
        parent_joint[child] = element
    roots = [link for link in links if link not in parent_joint]
    if len(roots) > 1:
        raise ConfigError(f"{urdf}: links '{roots[0]}' and '{roots[1]}': only one can be the root")
    check_elements(root, urdf)
    joints: list[UrdfJoint] = []
    wrong: list[str] = []
    visited = {tip_link}
    link = first_link = tip_link
    begun = False
    while link in parent_joint:
        element = parent_joint[link]
        if not begun and not _is_fixed(element, roots):
            try:
                joints.append(_joint(element, urdf, (drives or {}).get(element.get("name", ""))))
            except ConfigError as error:
                wrong += error.messages
            first_link, begun = link, element.get("name") == first_joint
        link = _end(element, "parent", urdf)
        if link in visited:
            raise ConfigError(f"{urdf}: link '{link}': the chain runs in a circle")
        if link not in links:
            raise ConfigError(f"{urdf}: joint '{element.get('name')}': no link '{link}'")
        visited.add(link)
    if first_joint is not None and not begun:
        names = [joint.name for joint in joints]
        raise ConfigError(
            f"{place}first_joint: value '{first_joint}': no movable joint on the way to "
            f"'{tip_link}' in {urdf}{nearest(first_joint, names)}"
        )
    if wrong:
        raise ConfigError(*reversed(wrong))
    if not joints:
        raise ConfigError(f"{asked_by}: value '{tip_link}': no movable joint leads to it in {urdf}")
    if len(joints) == 1:
        raise ConfigError(
            f"{asked_by}: value '{tip_link}': only joint '{joints[0].name}' of {urdf} leads to it: "
            "must be at least 2 joints"
        )
    check_bodies(root, urdf, [joint.name for joint in joints], parent_joint)
    return Robot(urdf, tuple(reversed(joints)), inertials, without, first_link)


def read_tree(urdf: Path) -> ET.Element:
    """Return the outer element of a URDF. Raises `ConfigError` for a file that is none."""
    try:
        size = urdf.stat().st_size
        if size > LARGEST_FILE:
            raise ConfigError(f"{urdf}: {size} bytes: must be at most {LARGEST_FILE}")
        root = ET.parse(urdf).getroot()
    except OSError as error:
        raise ConfigError(f"{urdf}: cannot be read: {error.strerror}") from None
    except (ET.ParseError, UnicodeError, LookupError) as error:
        raise ConfigError(f"{urdf}: not well-formed XML: {error}") from None
    if _depth(root) > DEEPEST:
        raise ConfigError(f"{urdf}: elements are nested more than {DEEPEST} deep")
    refuse_xacro(root, urdf)
    if root.tag != "robot":
        raise ConfigError(f"{urdf}: not a URDF: the outer element is <{root.tag}>, not <robot>")
    return root


def _depth(root: ET.Element) -> int:
    """Return how deeply elements are nested, as far as `DEEPEST` and one more."""
    layer, depth = [root], 0
    while layer and depth <= DEEPEST:
        layer, depth = [child for element in layer for child in element], depth + 1
    return depth


def _end(joint: ET.Element, which: str, urdf: Path) -> str:
    element = joint.find(which)
    link = None if element is None else element.get("link")
    if not link:
        raise ConfigError(f"{urdf}: joint '{joint.get('name')}': <{which} link=…> is missing")
    return link


def _give_limits(element: ET.Element, joint: UrdfJoint) -> None:
    """Write the limits of a joint where the file has none, or others."""
    limit = element.find("limit")
    if limit is None:
        limit = ET.SubElement(element, "limit")
    if joint.kind == "continuous":
        element.set("type", "revolute")
    if joint.reversed:
        axis = element.find("axis")
        axis = ET.SubElement(element, "axis") if axis is None else axis
        turned = -floats(axis.get("xyz", "1 0 0"))
        axis.set("xyz", " ".join(repr(float(x)) for x in turned))
    for key in _SAID:
        value, said = getattr(joint, key), limit.get(key)
        if said is None or float(said) != value:
            limit.set(key, repr(value))


def _is_fixed(element: ET.Element, roots: list[str]) -> bool:
    """Return whether a joint is fixed, or lets the whole arm float: Base is where the cell says."""
    kind, parent = element.get("type"), element.find("parent")
    on_root = parent is not None and parent.get("link") in roots
    return kind == "fixed" or (kind == "floating" and on_root)


def _joint(element: ET.Element, urdf: Path, drive: DriveSection | None) -> UrdfJoint:
    """Read a joint; what its limits leave out, its drive says."""
    name, kind = element.get("name", ""), element.get("type", "")
    where = f"{urdf}: joint '{name}'"
    if kind not in _MOVABLE:
        raise ConfigError(f"{where}: type '{kind}': must be fixed, {', '.join(_MOVABLE)}")
    if element.find("mimic") is not None:
        raise ConfigError(f"{where}: <mimic>: a joint of the chain needs a drive of its own")
    limit = element.find("limit")
    read = (
        {} if limit is None else {key: float(text) for key, text in limit.items() if key in _SAID}
    )
    lower, upper = read.get("lower", 0.0), read.get("upper", 0.0)
    if kind == "continuous" and (lower == upper or "lower" not in read or "upper" not in read):
        # Some exporters write zeros where the standard wants nothing.
        lower, upper = read.get("lower", 0.0), read.get("upper", 0.0)
        lower, upper = (lower or -CONTINUOUS_RANGE), (upper or CONTINUOUS_RANGE)
    lower, upper = _range(where, lower, upper, drive)
    speed, effort = (
        _bound(where, key, read.get(key, 0.0), told)
        for key, told in (
            ("velocity", None if drive is None else drive.max_velocity),
            ("effort", None if drive is None else drive.max_torque),
        )
    )
    return UrdfJoint(name, lower, upper, speed, effort, kind)


def _range(
    where: str, lower: float, upper: float, drive: DriveSection | None
) -> tuple[float, float]:
    """Return least and greatest position: the file's, or the drive's inside of them."""
    low = None if drive is None else drive.lower
    high = None if drive is None else drive.upper
    if not lower < upper:
        if low is None or high is None:
            raise ConfigError(
                f"{where}: <limit>: lower {lower:g} must be below upper {upper:g}; where the file "
                "has no limits, its drive says 'lower' and 'upper'"
            )
        lower, upper = low, high
    for key, value in (("lower", low), ("upper", high)):
        if value is not None and not lower <= value <= upper:
            raise ConfigError(
                f"{where}: value {value:g} of its drive's '{key}': must be within the file's "
                f"limits, {lower:g} to {upper:g}"
            )
    lower, upper = lower if low is None else low, upper if high is None else high
    if not lower < upper:
        raise ConfigError(f"{where}: its drive's lower {lower:g} must be below upper {upper:g}")
    return lower, upper


def _bound(where: str, key: str, value: float, told: float | None) -> float:
    """Return a bound of a joint: the file's, or the drive's where the file has none."""
    if value > 0.0:
        return value
    if told is None:
        raise ConfigError(f"{where}: <limit {key}>: value {value:g}: must be above 0")
    return told


# --- Joints of the URDF's root link beside the arm's chain: wheels before it, a sweep behind it ---


def root_joint(
    where: str, robot: Robot, name: str, drive: DriveSection | None = None
) -> tuple[UrdfJoint, tuple[float, ...]]:
    """Return a joint of the root link or of links held on it, and its axis (3,) in the root link.

    `where` is file and key that name it; what the joint's limits leave out, its drive says. Raises
    `ConfigError`.
    """
    element, axis, _ = _on_root(where, robot, name)
    return _joint(element, robot.urdf, drive), axis


def axle_of(robot: Robot, name: str) -> tuple[float, ...]:
    """Return where a joint of the root link turns, in the root link (3,) [m].

    Raises `ConfigError` for one that is elsewhere.
    """
    return _on_root("axle", robot, name)[2]


def _on_root(
    where: str, robot: Robot, name: str
) -> tuple[ET.Element, tuple[float, ...], tuple[float, ...]]:
    """Return a joint of the root link, or of links held on it, its axis and its place (3,) there.

    Held are links on fixed joints, on joints that carry the chain and are none of it, and on
    prismatic ones, as suspensions are.
    """
    root, urdf = robot.tree(), robot.urdf
    joints, chain = root.findall("joint"), {joint.name for joint in robot.joints}
    carrying = carriers(root, robot.first_link)
    children = {_end(joint, "child", urdf) for joint in joints}
    held = {link.get("name", ""): (np.eye(3), np.zeros(3)) for link in root.findall("link")
            if link.get("name") not in children}  # fmt: skip
    found: dict[str, ET.Element] = {}
    waiting = list(held)
    while waiting:
        link = waiting.pop()
        R, p = held[link]
        for joint in joints:
            if _end(joint, "parent", urdf) != link:
                continue
            child, kind = _end(joint, "child", urdf), joint.get("type", "")
            if kind != "fixed":
                found[joint.get("name", "")] = joint
            carries = child in carrying or kind == "prismatic"
            if kind == "fixed" or (joint.get("name") not in chain and carries):
                turn, shift = origin_of(joint)
                held[child] = R @ turn, p + R @ shift
                waiting.append(child)
    if name not in found:
        raise ConfigError(
            f"{where}: value '{name}': no joint on the root link of {urdf}"
            f"{nearest(name, list(found))}"
        )
    element = found[name]
    axis = element.find("axis")
    along = floats("1 0 0" if axis is None else axis.get("xyz", ""))
    R, p = held[_end(element, "parent", urdf)]
    turn, shift = origin_of(element)
    along = R @ turn @ along
    along = along / max(float(np.linalg.norm(along)), 1e-12)
    return element, tuple(along.round(6).tolist()), tuple((p + R @ shift).tolist())


def beside_chain(
    config: CellConfig,
    robot: Robot,
    before: tuple[UrdfJoint, ...] = (),
    behind: tuple[UrdfJoint, ...] = (),
    angle: float = 0.0,
) -> tuple[CellConfig, Robot]:
    """Return configuration and robot with more joints, at an angle [rad] in each posture.

    A posture that has an angle for them already stays as it is.
    """
    n = len(robot.joints)
    first, last = (angle,) * len(before), (angle,) * len(behind)
    postures = {
        name: (*first, *q, *last) if len(q) == n else q
        for name, q in config.mechanism.postures.items()
    }
    mechanism = config.mechanism.model_copy(update={"postures": postures})
    return (
        config.model_copy(update={"mechanism": mechanism}),
        replace(robot, joints=(*before, *robot.joints, *behind)),
    )


# --- The axis that sweeps: a joint of the URDF beside the chain, after all others -----------------


def with_sweep(
    path: Path, config: CellConfig, robot: Robot, words: Callable[[str], str]
) -> tuple[CellConfig, Robot]:
    """Return configuration and robot with the axis that sweeps as last joint, at its low end.

    Both as they are where nothing sweeps. `words` turns a complaint about a mechanism's cell into
    one that begins with the file's key. Raises `ConfigError`.
    """
    sweep = config.mechanism.sweep
    if sweep is None:
        return config, robot
    where = f"{path}: {words('mechanism.sweep')}"
    joint, _ = root_joint(f"{where}.joint", robot, sweep.joint)
    if joint.kind != "revolute":
        raise ConfigError(f"{where}.joint: value '{sweep.joint}': must be of type revolute")
    drive = next((d for d in config.mechanism.drives if d.joint == sweep.joint), None)
    if drive is not None and drive.following_window is None:
        raise ConfigError(
            f"{where}.joint: value '{sweep.joint}': its drive must tell following_window: a sweep "
            "that sticks is noticed by it alone"
        )
    margin = 0.0 if drive is None else drive.position_margin
    for key, value in (("low", sweep.low), ("high", sweep.high)):
        if not joint.lower + margin < value < joint.upper - margin:
            raise ConfigError(
                f"{where}.{key}: value {value:g}: must be inside of "
                f"{joint.lower + margin:g} to {joint.upper - margin:g} of joint '{sweep.joint}'"
            )
    return beside_chain(config, robot, behind=(joint,), angle=sweep.low)


# --- The wheels of a base: joints of the URDF beside the chain that turn for ever -----------------


def with_wheels(
    path: Path, config: CellConfig, robot: Robot, words: Callable[[str], str]
) -> tuple[CellConfig, Robot]:
    """Return configuration and robot with the wheels as first joints, at angle 0 in each posture.

    Both as they are where nothing rolls. `words` turns a complaint about a mechanism's cell into
    one that begins with the file's key. Raises `ConfigError`.
    """
    base = config.mechanism.base
    if base is None:
        return config, robot
    drives, found = {drive.joint: drive for drive in config.mechanism.drives}, []
    keys = {"left": base.wheels.left, "right": base.wheels.right}
    keys |= {f"followers[{i}]": name for i, name in enumerate(base.wheels.followers)}
    for key, name in keys.items():
        where = f"{path}: {words(f'mechanism.base.wheels.{key}')}"
        element, axis, _ = _on_root(where, robot, name)
        if element.get("type") != "continuous" or abs(axis[1]) < ALONG_AXLE:
            raise ConfigError(
                f"{where}: value '{name}': must be of type continuous, about axis 0 1 0 of Base "
                "or 0 -1 0"
            )
        if name not in base.wheels.followers:
            joint = _joint(element, robot.urdf, drives.get(name))
            joint = replace(joint, lower=-TURNS_FOR_EVER, upper=TURNS_FOR_EVER)
            found.append(replace(joint, reversed=axis[1] < 0.0))
        elif name in drives:
            raise ConfigError(
                f"{where}: value '{name}': must have no drive: its side's driven wheel turns it"
            )
    return beside_chain(config, robot, before=tuple(found))
