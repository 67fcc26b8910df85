"""Facts of a URDF that a cell needs: which chain is the arm, which links lack what."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from ...config.errors import ConfigError, nearest
from ...config.urdf.elements import FRAME_MASS, NO_INERTIA, inertial_fault
from ...config.urdf.robot import read_tree
from .shape.capsules import Fit, Tube, extreme, fit
from .shape.shapes import Array, hull_of, link_shape, placement
from .tip import end_of, movable, tip_of

DENSITY: Final = 1000.0
"""Of links whose masses nobody knows, by their hulls; and of those that have no shape [kg/m³]."""
ROUGH_MASS: Final = 0.1
"""Of a link that has no shape either [kg]."""
LIGHT: Final = 1e-9
"""Bodies have more inertia than this [kg·m²]."""


@dataclass(frozen=True)
class Inertial:
    """Mass and inertia of a link, estimated."""

    link: str
    mass: float
    com: Array
    inertia: Array
    why: str


@dataclass
class UrdfArm:
    """A URDF's file and tree, and which chain of it is the arm."""

    urdf: Path
    root: ET.Element
    tip: str
    chain: list[ET.Element]
    """Movable joints from Base to tip."""
    fits: list[Fit] = field(default_factory=list)
    inertials: list[Inertial] = field(default_factory=list)
    held: list[str] = field(default_factory=list)
    """Movable joints outside of the chain."""


def read_arm(urdf: Path, tip: str | None, packages: Mapping[str, Path]) -> UrdfArm:
    """Read a URDF; `tip` is the arm's last link, found where it is not said.

    Raises `ConfigError`.
    """
    root = read_tree(urdf)
    carried = {end_of(j, "child"): j for j in root.findall("joint")}
    links = [link.get("name", "") for link in root.findall("link")]
    if not links:
        raise ConfigError(f"{urdf}: holds no links")
    if tip is None:
        tip = tip_of(urdf, root)
    elif tip not in links:
        raise ConfigError(f"--tip: value '{tip}': no such link in {urdf}{nearest(tip, links)}")
    chain, at, seen = [], tip, {tip}
    while at in carried:
        joint = carried[at]
        if movable(joint):
            chain.append(joint)
        at = end_of(joint, "parent")
        if at in seen:
            raise ConfigError(f"{urdf}: link '{at}': the chain runs in a circle")
        seen.add(at)
    chain.reverse()
    if not chain:
        raise ConfigError(f"{urdf}: no movable joint leads to link '{tip}'")
    arm = UrdfArm(urdf, root, tip, chain)
    arm.held = [j.get("name", "") for j in root.findall("joint") if movable(j) and j not in chain]
    wrong: list[str] = []
    for link in root.findall("link"):
        try:
            _look_at(arm, link, packages, carried)
        except ConfigError as error:
            wrong += error.messages
    if wrong:
        raise ConfigError(*wrong)
    return arm


def carried_mass(arm: UrdfArm) -> float:
    """Return the mass of all links that the arm's joints move [kg]."""
    estimated = {given.link: given.mass for given in arm.inertials}
    moved, waiting = 0.0, [end_of(arm.chain[0], "child")]
    masses = {link.get("name", ""): link.find("inertial/mass") for link in arm.root.findall("link")}
    while waiting:
        name = waiting.pop()
        told = masses.get(name)
        own = 0.0 if told is None else _number(told.get("value"))
        moved += estimated.get(name, own)
        waiting += [
            end_of(joint, "child")
            for joint in arm.root.findall("joint")
            if end_of(joint, "parent") == name
        ]
    return moved


def beyond(arm: UrdfArm) -> tuple[float, tuple[float, ...]]:
    """Return mass [kg] and centre of mass (3,) [m] of the tip link and what it carries.

    In the tip link's frame, all joints beyond it at zero.
    """
    below: dict[str, list[ET.Element]] = {}
    for joint in arm.root.findall("joint"):
        parent = joint.find("parent")
        below.setdefault("" if parent is None else parent.get("link", ""), []).append(joint)
    links = {link.get("name", ""): link for link in arm.root.findall("link")}
    estimated = {given.link: given for given in arm.inertials}
    mass, moment = 0.0, np.zeros(3)
    waiting: list[tuple[str, Array, Array]] = [(arm.tip, np.eye(3), np.zeros(3))]
    while waiting:
        name, R, p = waiting.pop()
        if name in estimated:
            own, com = estimated[name].mass, estimated[name].com
        else:
            inertial = links[name].find("inertial")
            told = None if inertial is None else inertial.find("mass")
            own = 0.0 if told is None else float(told.get("value", "0"))
            com = placement(inertial)[1]
        mass += own
        moment = moment + own * (p + R @ com)
        for joint in below.get(name, []):
            child = joint.find("child")
            turn, shift = placement(joint)
            if child is not None:
                waiting.append((child.get("link", ""), R @ turn, p + R @ shift))
    com = moment / mass if mass > 0.0 else moment
    return round(mass, 4), tuple(com.round(4).tolist())


def _look_at(
    arm: UrdfArm, link: ET.Element, packages: Mapping[str, Path], carried: Mapping[str, ET.Element]
) -> None:
    """Fit capsules where the daemon reads no shape, and estimate what has no inertia."""
    name = link.get("name", "")
    shape = link_shape(link, arm.urdf, packages, meshes_only=True)
    told = link.find("inertial/mass")
    mass = 0.0 if told is None else _number(told.get("value"))
    if shape is not None:
        arm.fits.append(fit(shape))
    elif mass >= FRAME_MASS and link.find("collision") is None:
        arm.fits.append(_ball(name, mass, placement(link.find("inertial"))[1]))
    why = inertial_fault(link)
    if why in (None, NO_INERTIA) and mass < FRAME_MASS and not _alone(arm, name, carried):
        return  # a frame, which something else carries
    if why is None and mass == 0.0:
        why = "the URDF has none, or one without mass"
    if why is None:
        return
    whole = link_shape(link, arm.urdf, packages)
    hull = None if whole is None else hull_of(extreme(whole.triangles.reshape(-1, 3), 1000))
    if hull is None:
        mass = mass or ROUGH_MASS
        arm.inertials.append(Inertial(name, mass, np.zeros(3), np.eye(3) * 1e-3 * mass, why))
        return
    mass = mass or max(DENSITY * hull.volume, 1e-3)
    inertia = hull.moments * (mass / hull.volume) + np.eye(3) * 1e-6 * mass
    arm.inertials.append(Inertial(name, mass, hull.centre, inertia, why))


def _ball(name: str, mass: float, com: Array) -> Fit:
    """Return a ball of a link's mass: it has no shape, and something has to keep it clear."""
    radius = (0.75 * mass / (math.pi * DENSITY)) ** (1.0 / 3.0)
    return Fit(name, (Tube(com.round(4), com.round(4), radius),), 1.0, "the mass of no shape")


def _alone(arm: UrdfArm, name: str, carried: Mapping[str, ET.Element]) -> bool:
    """Return whether a link's joint is of the arm, and moves a link that has no mass of its own.

    What is fixed to such a link may have all the mass.
    """
    if carried.get(name) not in arm.chain:
        return False
    below: dict[str, list[str]] = {}
    for child, joint in carried.items():
        if joint not in arm.chain:
            below.setdefault(end_of(joint, "parent"), []).append(child)
    masses = {
        link.get("name", ""): _number(m.get("value"))
        for link in arm.root.findall("link")
        if (m := link.find("inertial/mass")) is not None
    }
    waiting, mass = [name], 0.0
    while waiting:
        link = waiting.pop()
        mass += masses.get(link, 0.0)
        waiting += below.get(link, [])
    return mass <= 0.0


def _number(text: str | None) -> float:
    try:
        value = float(text or "0")
    except ValueError:
        return 0.0
    return value if math.isfinite(value) and value > 0.0 else 0.0
