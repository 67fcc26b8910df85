"""The elements of a URDF, judged one by one before any library reads them, and made plain."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigError, nearest
from ..schema.mechanism import LinkInertialSection
from ..schema.section import PoseSection

# --- The elements of a URDF, judged one by one before any library reads them ----------------------
#
# Parsers drop an inertia or a shape that they cannot read, and say so on stderr at best: a link
# would lose its weight or its clearance. So every number that they would read is read here
# first.

FARTHEST: Final = 1e4
"""No part of a robot is longer, or farther from its joint, than this [m]."""
LEAST: Final = 1e-300
"""Numbers are not nearer to zero than this."""
HEAVIEST: Final = 1e6
"""No link has more mass [kg], or more inertia [kg·m²]."""


NO_INERTIA: Final = "mass without inertia"
"""Fault of a link that MuJoCo would refuse where it moves."""
FRAME_MASS: Final = 1e-3
"""A link of less mass is a frame, and needs no shape: some tools want a mass of every link [kg]."""


class _Rule(NamedTuple):
    """How many numbers an attribute holds, whether it may be absent, and their bounds."""

    numbers: int
    needed: bool
    low: float
    high: float
    positive: bool = False
    """True where the lower bound itself is too little."""


_PLACE: Final = _Rule(3, False, -FARTHEST, FARTHEST)
_ANGLES: Final = _Rule(3, False, -100.0, 100.0)
_LENGTH: Final = _Rule(1, True, 0.0, FARTHEST, positive=True)
IMPOSSIBLE: Final = 0.02
"""Part by which an inertia may miss what bodies can have: models are rounded [1]."""
_ANY: Final = _Rule(1, False, -1e12, 1e12)
_MOMENT: Final = _Rule(1, True, -HEAVIEST, HEAVIEST)
MOMENTS: Final = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
"""Entries of an inertia tensor, row by row."""
_RULES: Final[Mapping[str, Mapping[str, _Rule]]] = {
    "origin": {"xyz": _PLACE, "rpy": _ANGLES},
    "axis": {"xyz": _Rule(3, True, -FARTHEST, FARTHEST)},
    "mass": {"value": _Rule(1, True, 0.0, HEAVIEST)},
    "inertia": dict.fromkeys(MOMENTS, _MOMENT),
    "sphere": {"radius": _LENGTH},
    "cylinder": {"radius": _LENGTH, "length": _LENGTH},
    "capsule": {"radius": _LENGTH, "length": _LENGTH},
    "box": {"size": _Rule(3, True, 0.0, FARTHEST, positive=True)},
    "mesh": {"scale": _Rule(3, False, -FARTHEST, FARTHEST)},
    "color": {"rgba": _Rule(4, False, 0.0, 1e3)},
    "limit": dict.fromkeys(("lower", "upper", "velocity", "effort"), _ANY),
    "dynamics": dict.fromkeys(("damping", "friction"), _ANY),
    "mimic": dict.fromkeys(("multiplier", "offset"), _ANY),
    "calibration": dict.fromkeys(("rising", "falling"), _ANY),
    "safety_controller": dict.fromkeys(
        ("soft_lower_limit", "soft_upper_limit", "k_position", "k_velocity"), _ANY
    ),
}
_ONCE: Final = frozenset((*_RULES, "inertial", "geometry", "parent", "child"))
"""Elements that stand at most once in what they are part of."""
_READ: Final = frozenset((*_RULES, "inertial", "collision", "parent", "child"))
"""Parts of a link or joint that are read; what else stands there is for other programs."""
SHAPES: Final = ("box", "cylinder", "sphere", "capsule", "mesh")


def check_elements(
    root: ET.Element, urdf: Path, kinds: tuple[str, ...] = ("link", "joint")
) -> None:
    """Raise `ConfigError`, with file, link or joint, and value, for what a parser would drop."""
    wrong: list[str] = []
    for kind in kinds:
        names: set[str | None] = set()
        for part in root.findall(kind):
            name = part.get("name")
            if name in names:
                wrong.append(f"{urdf}: {kind} '{name}': is there twice")
            names.add(name)
            try:
                _check_part(part, f"{urdf}: {kind} '{name}'")
            except ConfigError as error:
                wrong += error.messages
    if wrong:
        raise ConfigError(*wrong)


def check_bodies(
    root: ET.Element, urdf: Path, moved: Collection[str], parents: Mapping[str, ET.Element]
) -> None:
    """Raise `ConfigError` for a joint in `moved` that moves nothing of any mass.

    `parents` are the joints of which a link is the child. What hangs on a joint by others that do
    not move is one body with it.
    """
    mass = dict.fromkeys(moved, 0.0)
    for link in root.findall("link"):
        weight = link.find("inertial/mass")
        joint = parents.get(link.get("name", ""))
        while joint is not None and joint.get("name") not in mass:
            above = joint.find("parent")
            joint = None if above is None else parents.get(above.get("link", ""))
        if joint is not None and weight is not None:
            mass[joint.get("name", "")] += float(weight.get("value", "0"))
    wrong = []
    for element in parents.values():
        name, child = element.get("name", ""), element.find("child")
        if mass.get(name, 1.0) <= 0.0 and child is not None:
            wrong.append(
                f"{urdf}: link '{child.get('link')}': <inertial> is missing or of mass 0: "
                f"joint '{name}' would move nothing; give mass and inertia"
            )
    if wrong:
        raise ConfigError(*wrong)


def normalise(root: ET.Element) -> None:
    """Write all numbers of checked elements in one way: readers differ on blanks and signs."""
    for part in (*root.findall("link"), *root.findall("joint")):
        for element in part.iter():
            for attribute in _RULES.get(element.tag, {}):
                text = element.get(attribute)
                if text is not None:
                    element.set(attribute, " ".join(repr(x) for x in _numbers(text)))


def unshaped_links(root: ET.Element) -> Iterator[str]:
    """Yield the names of links that have mass and no `<collision>`: nothing keeps them clear.

    Frames, of less than `FRAME_MASS`, are left out.
    """
    for link in root.findall("link"):
        mass = link.find("inertial/mass")
        heavy = mass is not None and float(mass.get("value", "0")) >= FRAME_MASS
        if heavy and link.find("collision") is None:
            yield link.get("name", "")


def _check_part(part: ET.Element, where: str) -> None:
    read = [e for top in part if top.tag in _READ for e in top.iter()]
    for element in (part, *read):
        children = [child.tag for child in element]
        for tag in sorted(_ONCE & set(children)):
            if children.count(tag) > 1:
                raise ConfigError(f"{where}: <{tag}>: is there {children.count(tag)} times")
    for element in read:
        for attribute, rule in _RULES.get(element.tag, {}).items():
            _check_numbers(element, attribute, rule, where)
    for shape in part.findall("collision"):
        check_shape(shape, where)
    inertial = part.find("inertial")
    if inertial is not None:
        _check_inertial(inertial, where)
    axis = part.find("axis")
    if axis is not None and part.get("type") != "fixed":
        length = math.hypot(*(float(x) for x in axis.get("xyz", "").split()))
        if length < 1e-6:
            raise ConfigError(
                f"{where}: <axis xyz>: value {axis.get('xyz')!r}: must not be of length 0"
            )


def check_shape(shape: ET.Element, where: str) -> None:
    """Raise `ConfigError` for a `<collision>` or `<visual>` whose shape cannot be read."""
    geometry = shape.find("geometry")
    found = [] if geometry is None else [e.tag for e in geometry]
    if len(found) != 1 or found[0] not in SHAPES:
        shown = ", ".join(found) or "nothing"
        raise ConfigError(
            f"{where}: <{shape.tag}>: <geometry> holds {shown}: must be one of {', '.join(SHAPES)}"
        )
    for element in shape.iter():
        for attribute, rule in _RULES.get(element.tag, {}).items():
            _check_numbers(element, attribute, rule, where)
    mesh = shape.find("geometry/mesh")
    if mesh is not None and not mesh.get("filename"):
        raise ConfigError(f"{where}: <{shape.tag}>: <mesh filename=…> is missing")


def inertial_fault(link: ET.Element) -> str | None:
    """Return why a link's `<inertial>` is none of a body, or None: for one that has none, too."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    try:
        for element in inertial.iter():
            for attribute, rule in _RULES.get(element.tag, {}).items():
                _check_numbers(element, attribute, rule, "")
        _check_inertial(inertial, "")
    except ConfigError as error:
        return str(error).removeprefix(": ")
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None or float(mass.get("value", "0")) <= 0.0:
        return None
    if all(float(inertia.get(name, "0")) < 1e-12 for name in ("ixx", "iyy", "izz")):
        return NO_INERTIA
    return None


def _check_inertial(inertial: ET.Element, where: str) -> None:
    for needed in ("mass", "inertia"):
        if inertial.find(needed) is None:
            raise ConfigError(f"{where}: <inertial>: <{needed}> is missing")
    inertia = inertial.find("inertia")
    if inertia is None:
        return
    xx, xy, xz, yy, yz, zz = (float(inertia.get(name, "")) for name in MOMENTS)
    a, b, c = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
    if a < -1e-9 * max(c, 0.0) - 1e-300:
        raise ConfigError(
            f"{where}: <inertia>: least principal moment {a:g} kg·m²: must not be negative"
        )
    if a + b < (1.0 - IMPOSSIBLE) * c:
        raise ConfigError(
            f"{where}: <inertia>: greatest principal moment {c:g} kg·m²: must be at most "
            f"{a + b:g}, the sum of the others, as of any body"
        )


def _check_numbers(element: ET.Element, attribute: str, rule: _Rule, where: str) -> None:
    text = element.get(attribute)
    place = f"{where}: <{element.tag} {attribute}>"
    if text is None:
        if rule.needed:
            raise ConfigError(f"{place}: is missing")
        return
    expected = "a number" if rule.numbers == 1 else f"{rule.numbers} numbers"
    values = _numbers(text)
    if len(values) != rule.numbers or not all(map(math.isfinite, values)):
        raise ConfigError(f"{place}: value {_shown(text)}: must be {expected}")
    for value in values:
        if value < rule.low or value > rule.high or (rule.positive and value == rule.low):
            least = f"above {rule.low:g}" if rule.positive else f"at least {rule.low:g}"
            raise ConfigError(
                f"{place}: value {_shown(text)}: must be {least} and at most {rule.high:g}"
            )


def _numbers(text: str) -> list[float]:
    """Return the numbers of an attribute, none if one word is no number to XML's readers."""
    if not text.isascii() or "_" in text:
        return []
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return []
    # Some readers take a number that is next to nothing for none at all.
    return values if all(x == 0.0 or abs(x) >= LEAST for x in values) else []


def _shown(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:59] + "…")


# --- A URDF made plain: one chain of joints, no meshes, inertias where the file lacks them --------

_LOOKED_AT: Final = ("gazebo", "material", "transmission", "mujoco", "ros2_control", "sensor")
"""Elements that say nothing about a chain's motion."""
LEAST_MOMENT: Final = 1e-9
"""Least principal moment of inertia, by the greatest [1]."""
_ENTRIES: Final = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Rows and columns of `MOMENTS`."""


def refuse_xacro(root: ET.Element, urdf: Path) -> None:
    """Raise `ConfigError` for a file of macros: it has to be expanded first."""
    macros = [e.tag for e in root.iter() if isinstance(e.tag, str) and "xacro}" in e.tag]
    if macros or urdf.suffix == ".xacro":
        out = urdf.name.removesuffix(".xacro").removesuffix(".urdf") + ".urdf"
        raise ConfigError(
            f"{urdf}: holds xacro macros: expand them first, with `xacro {urdf.name} > {out}` "
            "(from ROS, or `pip install xacro`), and take that file"
        )


def leave_out(root: ET.Element, links: Collection[str], own: str) -> None:
    """Take other mechanisms' links out of a tree: each of `links`, with all that it carries.

    What the link `own` carries stays; links on the way to it stay as frames, without mass or shape.
    """
    above = {end_of(joint, "child"): joint for joint in root.findall("joint")}
    kept = set(carriers(root, own))
    ways = [(link, carriers(root, link.get("name", ""))) for link in root.findall("link")]
    for link, way in ways:
        name = way[0]
        if own in way or not set(way) & set(links):
            continue
        if name not in kept:
            root.remove(link)
            if name in above:
                root.remove(above[name])
            continue
        for tag in ("inertial", "visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)


def carriers(root: ET.Element, link: str) -> list[str]:
    """Return a link and those that carry it, up to the root."""
    above = {end_of(joint, "child"): end_of(joint, "parent") for joint in root.findall("joint")}
    found = [link]
    while found[-1] in above and len(found) <= len(above):
        found.append(above[found[-1]])
    return found


def origin_of(element: ET.Element | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rotation (3, 3) and translation (3,) of an element's `<origin>`."""
    origin = None if element is None else element.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    roll, pitch, yaw = floats(origin.get("rpy", "0 0 0")).tolist()
    x, y, z = np.eye(3)
    return rotation(z, yaw) @ rotation(y, pitch) @ rotation(x, roll), floats(
        origin.get("xyz", "0 0 0")
    )


def place_at(
    root: ET.Element, link: str, q: Mapping[str, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rotation (3, 3) and translation (3,) of a link in the root, joints at q [rad or m].

    Joints without a name there are at zero.
    """
    above = {end_of(joint, "child"): joint for joint in root.findall("joint")}
    R, p = np.eye(3), np.zeros(3)
    for name in carriers(root, link)[:-1]:
        joint = above[name]
        R_joint, p_joint = origin_of(joint)
        axis, way = joint.find("axis"), q.get(joint.get("name", ""), 0.0)
        along = floats("1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
        along = along / np.linalg.norm(along)
        if joint.get("type") == "prismatic":
            p_joint = p_joint + R_joint @ (way * along)
        else:
            R_joint = R_joint @ rotation(along, way)
        R, p = R_joint @ R, p_joint + R_joint @ p
    return R, p


def pose_of(pose: PoseSection) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return rotation (3, 3) and translation (3,) of a pose."""
    roll, pitch, yaw = pose.rpy
    x, y, z = np.eye(3)
    R = rotation(z, yaw) @ rotation(y, pitch) @ rotation(x, roll)
    return R, np.array(pose.xyz)


def rpy_of(R: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return fixed-axis roll, pitch, yaw [rad] of a rotation (3, 3)."""
    pitch = math.asin(min(1.0, max(-1.0, -float(R[2, 0]))))
    if abs(R[2, 0]) < 1.0 - 1e-12:
        return math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0])
    return 0.0, pitch, math.atan2(-R[0, 1], R[1, 1])


def rotation(axis: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Return the rotation matrix (3, 3) about a unit axis: Rodrigues' formula."""
    x, y, z = axis.tolist()
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K))


def floats(text: str) -> NDArray[np.float64]:
    """Return the numbers of a text."""
    return np.array([float(word) for word in text.split()])


def mesh_links(root: ET.Element) -> list[str]:
    """Return the names of links with a mesh among their shapes: those looked at, without others."""
    kinds = {link: "visual" if link.find("collision") is None else "collision"
             for link in root.findall("link")}  # fmt: skip
    return [
        link.get("name", "")
        for link, kind in kinds.items()
        if link.find(f"{kind}/geometry/mesh") is not None
    ]


def give_inertials(root: ET.Element, urdf: Path, inertials: Iterable[LinkInertialSection]) -> None:
    """Write inertials into their links, in place of what is there. Raises `ConfigError`."""
    links = {link.get("name", ""): link for link in root.findall("link")}
    for given in inertials:
        link = links.get(given.link)
        if link is None:
            hint = nearest(given.link, links)
            raise ConfigError(
                f"mechanism.inertials: value '{given.link}': no such link in {urdf}{hint}"
            )
        for old in link.findall("inertial"):
            link.remove(old)
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=_text(given.com), rpy="0 0 0")
        ET.SubElement(inertial, "mass", value=repr(given.mass))
        names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        ET.SubElement(inertial, "inertia", dict(zip(names, map(repr, given.inertia), strict=True)))


def balance(root: ET.Element) -> None:
    """Amend principal moments that miss those of a body by rounding.

    These satisfy 0 < A ≤ B ≤ C ≤ A + B, which MuJoCo holds a model to exactly: a rod's A is raised,
    and C is lowered. What misses it by more than rounding has been refused.
    """
    for inertia in root.findall("link/inertial/inertia"):
        xx, xy, xz, yy, yz, zz = (float(inertia.get(name, "0")) for name in MOMENTS)
        moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        least = LEAST_MOMENT * moments[2]
        if moments[0] >= least and moments[0] + moments[1] >= moments[2]:
            continue
        moments[:2] = np.maximum(moments[:2], least)
        moments[2] = min(moments[2], (moments[0] + moments[1]) * (1.0 - 1e-9))
        I = (axes * moments) @ axes.T  # noqa: E741  the field's symbol
        for name, (i, j) in zip(MOMENTS, _ENTRIES, strict=True):
            inertia.set(name, repr(float(I[i, j])))


def simplify(
    root: ET.Element, moved: Collection[str], root_link: str | None, *, looks: bool
) -> None:
    """Leave the joints in `moved` movable, fix all others at zero, and drop meshes and looks.

    With `looks` what is to be looked at stays, meshes among it.
    """
    for element in list(root):
        if element.tag in _LOOKED_AT and not looks:
            root.remove(element)
    for link in root.findall("link"):
        for shape in () if looks else (*link.findall("visual"), *link.findall("collision")):
            if shape.tag == "visual" or shape.find("geometry/mesh") is not None:
                link.remove(shape)
    children = set()
    for joint in root.findall("joint"):
        children |= {child.get("link") for child in joint.findall("child")}
        if joint.get("name") in moved:
            continue
        joint.set("type", "fixed")
        for element in list(joint):
            if element.tag not in ("origin", "parent", "child"):
                joint.remove(element)
    if root_link is not None:
        for link in root.findall("link"):
            if link.get("name") not in children:
                _rename(root, link, root_link)


def _rename(root: ET.Element, link: ET.Element, name: str) -> None:
    was = link.get("name")
    link.set("name", name)
    for parent in root.findall("joint/parent"):
        if parent.get("link") == was:
            parent.set("link", name)


def end_of(joint: ET.Element, which: str) -> str:
    """Return the name of a joint's `parent` or `child`, empty where it has none."""
    element = joint.find(which)
    return "" if element is None else element.get("link", "")


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(x) for x in numbers)
