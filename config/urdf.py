"""The robot description: the serial chain of a URDF from its root link to the tip link.

Only what the cell's drives are held against is read here; kinematics, inertias and shapes are for
the libraries that compute with them.
"""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from .errors import ConfigError, nearest
from .urdf_elements import check_bodies, check_elements, normalise, unshaped_links

CONTINUOUS_RANGE: Final = 2 * math.pi
"""A continuous joint is bounded to one turn either way: cables and counts are finite [rad]."""

LARGEST_FILE: Final = 1 << 24
"""A URDF of more bytes holds meshes, or is none [1]."""
DEEPEST: Final = 32
"""Elements are not nested more deeply than this [1]."""
_MOVABLE: Final = ("revolute", "continuous", "prismatic")


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


@dataclass(frozen=True)
class Robot:
    """A serial chain: the file that it stands in, and its movable joints from base to tip.

    Movable joints outside of the chain (a gripper's) do not appear: they are held at zero.
    """

    urdf: Path
    joints: tuple[UrdfJoint, ...]

    def links(self) -> list[str]:
        """Return the names of all links in the file."""
        return [link.get("name", "") for link in _parse(self.urdf).findall("link")]

    def unshaped_links(self) -> list[str]:
        """Return the names of links that have mass but no shape to keep clear by."""
        return list(unshaped_links(_parse(self.urdf)))

    def description(self) -> str:
        """Return the URDF's text, each continuous joint of the chain as a bounded revolute one.

        Numbers are written in one way.

        Libraries give a continuous joint two coordinates; a drive has one.
        """
        root = _parse(self.urdf)
        normalise(root)
        bounded = {j.name: j for j in self.joints if j.kind == "continuous"}
        for element in root.findall("joint"):
            joint = bounded.get(element.get("name", ""))
            limit = element.find("limit")
            if joint is not None and limit is not None:
                element.set("type", "revolute")
                limit.set("lower", repr(joint.lower))
                limit.set("upper", repr(joint.upper))
        return ET.tostring(root, encoding="unicode")


def joints_of_root(urdf: Path) -> dict[str, UrdfJoint]:
    """Return the joints by name, fixed ones left out, that the root link carries.

    Raises `ConfigError`.
    """
    root = _parse(urdf)
    joints = root.findall("joint")
    children = {_end(joint, "child", urdf) for joint in joints}
    moving = [joint for joint in joints if joint.get("type") != "fixed"]
    found = [_joint(joint, urdf) for joint in moving if _end(joint, "parent", urdf) not in children]
    return {joint.name: joint for joint in found}


def read_robot(urdf: Path, tip_link: str, asked_by: str) -> Robot:
    """Read the chain that ends in `tip_link`.

    `asked_by` is the file and key that names the tip link, for the error. Raises `ConfigError` if
    the file cannot be read, is not a URDF, or holds no such chain of joints that we can drive.
    """
    root = _parse(urdf)
    links = [link.get("name", "") for link in root.findall("link")]
    if tip_link not in links:
        hint = nearest(tip_link, links)
        raise ConfigError(f"{asked_by}: value '{tip_link}': no such link in {urdf}{hint}")
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
    visited = {tip_link}
    link = tip_link
    while link in parent_joint:
        element = parent_joint[link]
        if element.get("type") != "fixed":
            joints.append(_joint(element, urdf))
        link = _end(element, "parent", urdf)
        if link in visited:
            raise ConfigError(f"{urdf}: link '{link}': the chain runs in a circle")
        if link not in links:
            raise ConfigError(f"{urdf}: joint '{element.get('name')}': no link '{link}'")
        visited.add(link)
    if not joints:
        raise ConfigError(f"{asked_by}: value '{tip_link}': no movable joint leads to it in {urdf}")
    check_bodies(root, urdf, [joint.name for joint in joints], parent_joint)
    return Robot(urdf, tuple(reversed(joints)))


def axis_of(urdf: Path, joint: str) -> tuple[float, ...]:
    """Return the axis of a joint in its own frame. Raises `ConfigError`."""
    found = _parse(urdf).find(f"joint[@name='{joint}']/axis")
    return tuple(map(float, ("1 0 0" if found is None else found.get("xyz", "")).split()))


def _parse(urdf: Path) -> ET.Element:
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


def _joint(element: ET.Element, urdf: Path) -> UrdfJoint:
    name, kind = element.get("name", ""), element.get("type", "")
    where = f"{urdf}: joint '{name}'"
    if kind not in _MOVABLE:
        raise ConfigError(f"{where}: type '{kind}': must be fixed, {', '.join(_MOVABLE)}")
    if element.find("mimic") is not None:
        raise ConfigError(f"{where}: <mimic>: a joint of the chain needs a drive of its own")
    limit = element.find("limit")
    if limit is None:
        raise ConfigError(f"{where}: <limit> is missing: velocity and effort bounds are needed")

    def number(attribute: str, default: float | None = None) -> float:
        text = limit.get(attribute)
        if text is None and default is None:
            raise ConfigError(f"{where}: <limit {attribute}>: value None: must be a number")
        return float(text) if text is not None else default or 0.0

    if kind == "continuous":
        lower, upper = number("lower", -CONTINUOUS_RANGE), number("upper", CONTINUOUS_RANGE)
        if lower == upper == 0.0:  # some exporters write zeros where the standard wants nothing
            lower, upper = -CONTINUOUS_RANGE, CONTINUOUS_RANGE
    else:
        lower, upper = number("lower", 0.0), number("upper", 0.0)
    if not lower < upper:
        raise ConfigError(f"{where}: <limit>: lower {lower:g} must be below upper {upper:g}")
    joint = UrdfJoint(name, lower, upper, number("velocity"), number("effort"), kind)
    for what, bound in (("velocity", joint.velocity), ("effort", joint.effort)):
        if bound <= 0.0:
            raise ConfigError(f"{where}: <limit {what}>: value {bound:g}: must be above 0")
    return joint
