"""Links and joints of a cell's mechanisms, parents before children, for the page's kinematics."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any

import numpy as np

from .....config.load import Cell, ConfigError
from .....server.control.proximity.capsules import Forest, fitted
from .meshes import Meshes
from .poses import along, of_origin, of_pose, three
from .shapes import colours_of, shapes_of


def described_links(cell: Cell, meshes: Meshes) -> list[dict[str, Any]]:
    """Return the links of all mechanisms; `parent` is an index among them, −1 for a Base.

    A link whose meshes cannot be drawn has its collision shapes, or its capsules, in their place. A
    link's `pose` is its joint's in the parent at zero (in World, of a Base), `axis` the joint's
    in the link itself, and `joint` its index in State's joint vectors, −1 where nothing moves it.
    """
    links: list[dict[str, Any]] = []
    first = 0
    for part in cell.parts:
        links += _tree(part, len(links), first, meshes)
        first += len(part.robot.joints)
    _add_capsules(cell, links)
    _add_lost_shapes(links, {row.link for row in meshes.missing})
    return links


def _tree(part: Cell, before: int, first: int, meshes: Meshes) -> list[dict[str, Any]]:
    root = ET.fromstring(part.robot.description(looks=True))
    colours = colours_of(root)
    index = {joint.name: first + i for i, joint in enumerate(part.robot.joints)}
    by_name = {link.get("name", ""): link for link in root.findall("link")}
    waiting = {_end(joint, "child"): joint for joint in root.findall("joint")}
    base = next(name for name in by_name if name not in waiting)
    number: dict[str, int] = {}
    links: list[dict[str, Any]] = []

    def add(name: str, told: dict[str, Any]) -> None:
        number[name] = before + len(links)
        shapes = shapes_of(by_name[name], part.prefix + name, part.robot.urdf, meshes, colours)
        links.append({"name": part.prefix + name, **told, "shapes": shapes, "capsules": []})

    place = of_pose(part.config.mechanism.T_world_base)
    add(base, {"parent": -1, "pose": place, **_FIXED})
    while waiting:
        name = next(n for n, joint in waiting.items() if _end(joint, "parent") in number)
        joint = waiting.pop(name)
        told = {"parent": number[_end(joint, "parent")], "pose": of_origin(joint)}
        add(name, {**told, **_joint(joint, index)})
    return links


_FIXED: dict[str, Any] = {"kind": "fixed", "joint": -1, "axis": [0.0, 0.0, 1.0]}


def _joint(element: ET.Element, index: Mapping[str, int]) -> dict[str, Any]:
    """Return how a link moves in its parent; joints outside of the chain stand at zero."""
    joint = index.get(element.get("name", ""), -1)
    if joint < 0:
        return _FIXED
    axis = element.find("axis")
    direction = [1.0, 0.0, 0.0] if axis is None else three(axis, "xyz")
    length = math.sqrt(sum(x * x for x in direction))
    kind = "prismatic" if element.get("type") == "prismatic" else "revolute"
    return {"kind": kind, "joint": joint, "axis": [x / length for x in direction]}


def _add_capsules(cell: Cell, links: list[dict[str, Any]]) -> None:
    """Add the capsules that clearances are kept by, each to the link that its joint moves."""
    try:
        capsules = fitted(cell, Forest(cell))
    except ConfigError:
        return  # a mesh without capsules: this cell keeps no clearances
    moved = {link["joint"]: link for link in links if link["joint"] >= 0}
    roots = [link for link in links if link["parent"] < 0]
    for capsule in capsules:
        carrier = moved[capsule.body - 1] if capsule.body > 0 else roots[-capsule.body]
        carrier["capsules"].append(
            {
                "of": capsule.link,
                "start": capsule.start.tolist(),
                "end": capsule.end.tolist(),
                "radius": capsule.radius,
            }
        )


def _add_lost_shapes(links: list[dict[str, Any]], lost: set[str]) -> None:
    """Draw the capsules of links that lost all their meshes."""
    bare = {link["name"] for link in links if not link["shapes"]} & lost
    for link in links:
        link["shapes"] += [_drawn(c) for c in link["capsules"] if c["of"] in bare]


def _drawn(capsule: dict[str, Any]) -> dict[str, Any]:
    """Return a capsule as a shape of the link that it is fixed to."""
    start, end = np.array(capsule["start"]), np.array(capsule["end"])
    length = float(np.linalg.norm(end - start))
    turn = along(end - start) if length > 0.0 else [0.0, 0.0, 0.0, 1.0]
    pose = [*(0.5 * (start + end)).tolist(), *turn]
    return {"kind": "capsule", "pose": pose, "radius": capsule["radius"], "length": length}


def _end(joint: ET.Element, which: str) -> str:
    element = joint.find(which)
    return "" if element is None else element.get("link", "")
