"""A URDF made plain: one chain of joints, no meshes, inertias where the file lacks them."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Final

import numpy as np

from ..errors import ConfigError, nearest
from ..schema.mechanism.mechanism import LinkInertialSection
from .elements import MOMENTS

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
    above = {_end(joint, "child"): joint for joint in root.findall("joint")}
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
    above = {_end(joint, "child"): _end(joint, "parent") for joint in root.findall("joint")}
    found = [link]
    while found[-1] in above and len(found) <= len(above):
        found.append(above[found[-1]])
    return found


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


def _end(joint: ET.Element, which: str) -> str:
    element = joint.find(which)
    return "" if element is None else element.get("link", "")


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(x) for x in numbers)
