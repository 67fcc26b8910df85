"""The robot description that `init` starts from: tip, links, masses, capsules."""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from ...config.errors import ConfigError, nearest
from ...config.urdf.elements import FRAME_MASS, NO_INERTIA, end_of, inertial_fault, origin_of
from ...config.urdf.links import LinkTree, movable
from ...config.urdf.robot import read_tree
from ...config.urdf.shapes import Array, Tube, extreme, hull_of, link_shape
from .capsules import MOST_OF_CELL, Fit, Place, fit, merged

# --- End of the arm in a URDF's tree: fingers, wheels and heads are no part of it -----------------
FINGERS: Final = 2
"""A branch of so many movable joints, or fewer, is a finger, a wheel or a head [1]."""
OF_A_FINGER: Final = 4
"""Two branches of an arm's end that have so many joints, or fewer, are fingers; three are [1]."""
OF_AN_ARM: Final = 3  # before so many joints there is no arm yet that could end [1]
_OF_A_HAND: Final = re.compile(r"grip|finger|jaw|knuckle|thumb|claw|hand_joint", re.IGNORECASE)
_OF_A_WRIST: Final = re.compile(r"wrist|forearm|elbow|shoulder|roll|pitch|yaw|flex", re.IGNORECASE)
_OF_A_WHEEL: Final = re.compile(r"wheel|caster|castor|tyre|tire", re.IGNORECASE)
_TOOLS: Final = ("tool0", "tcp", "ee_link", "flange", "tool", "tool_frame", "hand_tcp", "grasp")


def tip_of(urdf: Path, root: ET.Element) -> str:
    """Return the last link of the only arm in a tree. Raises `ConfigError` where there are more."""
    tree = ArmTree(root)
    if len(tree.roots) != 1:
        raise ConfigError(
            f"{urdf}: {len(tree.roots)} links are no joint's child: must be 1, the root"
        )
    at, arms = tree.end_from(tree.roots[0])
    if not arms:
        return at
    tips = ", ".join(sorted(tree.end_from(end_of(joint, "child"), 1)[0] for joint in arms))
    raise ConfigError(
        f"{urdf}: link '{at}' carries {len(arms)} chains of joints: say which is the arm, "
        f"with --tip LINK: one of {tips}, or a link before"
    )


class ArmTree(LinkTree):
    """Links of a URDF, and where among them arms end."""

    def end_from(self, at: str, moved: int = 0) -> tuple[str, list[ET.Element]]:
        """Return where the arm ends that goes on from a link, `moved` joints after its root.

        And, where it divides into several, the joints that these begin with.
        """
        while True:
            branches = [joint for joint in self.below(at) if self._depth(joint) > 0]
            arms = [joint for joint in branches if self._depth(joint) > FINGERS]
            if len(arms) > 1:
                short = all(self._depth(j) <= OF_A_FINGER for j in arms)
                if moved > OF_AN_ARM and (short or len(arms) > 2):
                    break
                return at, arms
            if len(arms) == 1:
                following = arms[0]
            elif len(branches) == 1 and not (moved >= OF_AN_ARM and self._hand(branches[0])):
                following = branches[0]
            elif branches and moved == 0:
                following = max(branches, key=self._depth)
            else:
                break
            moved += int(movable(following))
            at = end_of(following, "child")
        return self._tool(at), []

    def _depth(self, joint: ET.Element) -> int:
        """Return the most movable joints on a way from a joint, itself among them."""
        deeper = [self._depth(j) for j in self.below(end_of(joint, "child"))]
        return int(movable(joint)) + max(deeper, default=0)

    def _hand(self, joint: ET.Element) -> bool:
        """Return whether a branch's first movable joint is a hand's, by its name or its link's.

        A link's name counts where nothing moves beyond it: fingers hang on a link that is called
        gripper, and the joint that turns it is the arm's.
        """
        while not movable(joint):
            following = [j for j in self.below(end_of(joint, "child")) if self._depth(j) > 0]
            if len(following) != 1:
                return True
            joint = following[0]
        if joint.find("mimic") is not None:
            return True
        name, child = joint.get("name", ""), end_of(joint, "child")
        beyond = [j for j in self.below(child) if self._depth(j) > 0]
        if beyond and (_OF_A_WRIST.search(name) or not _OF_A_HAND.search(name)):
            return False
        named = _OF_A_HAND.search(name) or _OF_A_HAND.search(child)
        return bool(named) and all(self._hand(j) for j in beyond)

    def _tool(self, at: str) -> str:
        """Return the tool's frame among the links that are fixed to the last one, if there is."""
        fixed = [link for link, _, _ in self.walk(at, lambda joint: not movable(joint))]
        for word in _TOOLS:
            for link in fixed[1:]:
                if link.lower() == word or link.lower().endswith(f"_{word}"):
                    return link
        hands = [link for link in fixed if any(movable(j) for j in self.below(link))]
        return hands[0] if hands else at


def moves(joint: ET.Element) -> bool:
    return joint.get("type") not in ("fixed", None)


def is_wheel(joint: ET.Element) -> bool:
    """Return whether a joint is a wheel's or a caster's, by its name or its link's."""
    return _OF_A_WHEEL.search(f"{joint.get('name')} {end_of(joint, 'child')}") is not None


def is_upright(joint: ET.Element) -> bool:
    """Return whether a joint turns about the vertical of its frame, or slides along it."""
    axis = joint.find("axis")
    x, y, z = (float(v) for v in ("1 0 0" if axis is None else axis.get("xyz", "")).split())
    return abs(z) > 0.9 * max(abs(x), abs(y), 1e-9)


def side_of(text: str) -> str:
    """Return `left` or `right` where names say so, else nothing."""
    words = {w.lower() for w in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", text)}
    found = {side for side in ("left", "right") if words & {side, side[0]}}
    return found.pop() if len(found) == 1 else ""


# --- Facts of a URDF that a cell needs: which chain is the arm, which links lack what -------------
DENSITY: Final = 1000.0
"""Of links whose masses nobody knows, by their hulls; and of those that have no shape [kg/m³]."""
ROUGH_MASS: Final = 0.1  # of a link that has no shape either [kg]


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
    chain: list[ET.Element]  # movable joints from Base to tip
    fits: list[Fit] = field(default_factory=list)
    inertials: list[Inertial] = field(default_factory=list)
    name: str = "arm"  # name of the mechanism that it becomes
    first_joint: str | None = None  # joint that it begins with, where others on the way to it stand
    without: tuple[str, ...] = ()
    """Links that other arms of the file have, with all that they carry."""
    held: list[str] = field(default_factory=list)  # movable joints that are no arm's
    standing: list[str] = field(default_factory=list)
    """Joints of these that carry the arm, each with what it is."""
    fingers: list[str] = field(default_factory=list)
    """Joints of these that its last link carries: a gripper's."""
    own: frozenset[str] = frozenset()  # the links that its first joint carries

    @cached_property
    def tree(self) -> ArmTree:
        return ArmTree(self.root)


def read_arms(urdf: Path, tips: Sequence[str], packages: Mapping[str, Path]) -> list[UrdfArm]:
    """Read a URDF; `tips` are the arms' last links, one arm's is found where none is said.

    What several arms have in common, torso and base, stands, and is the first one's. Raises
    `ConfigError`.
    """
    root = read_tree(urdf)
    tree = ArmTree(root)
    carried, links = tree.above, list(tree.links)
    if not links:
        raise ConfigError(f"{urdf}: holds no links")
    for tip in tips:
        if tip not in links:
            raise ConfigError(f"--tip: value '{tip}': no such link in {urdf}{nearest(tip, links)}")
    ways = {tip: _way_to(urdf, tip, carried) for tip in tips or (tip_of(urdf, root),)}
    arms = []
    for tip, way in ways.items():
        shared = [j for other, theirs in ways.items() if other != tip for j in theirs]
        chain, before = _own_part([j for j in way if j not in shared])
        if not any(map(movable, chain)):
            raise ConfigError(
                f"{urdf}: no movable joint leads to link '{tip}'"
                + (" alone: give one --tip for each arm" if len(ways) > 1 else "")
            )
        stand = [j for j in way if moves(j) and (j in shared or j in before)]
        on_the_root = bool(stand) and stand[0].get("type") == "floating"
        arm = UrdfArm(urdf, root, tip, [j for j in chain if movable(j)])
        arm.standing = [f"{j.get('name')} ({j.get('type')})" for j in stand]
        if len(stand) > int(on_the_root):
            arm.first_joint = arm.chain[0].get("name")
        arms.append(arm)
    _part(arms)
    moved = [joint for arm in arms for joint in arm.chain]
    held = [j.get("name", "") for j in root.findall("joint") if movable(j) and j not in moved]
    for arm in arms:
        arm.own, hand = (
            frozenset(name for name, _, _ in tree.walk(end_of(arm.chain[at], "child")))
            for at in (0, -1)
        )
        arm.fingers = [
            j.get("name", "")
            for j in root.findall("joint")
            if j.get("name") in held and end_of(j, "parent") in hand
        ]
        arm.held = held
    wrong: list[str] = []
    for link in root.findall("link"):
        try:
            _look_at(arms, link, packages)
        except ConfigError as error:
            wrong += error.messages
    if wrong:
        raise ConfigError(*wrong)
    _make_room(arms, carried)
    return arms


def _make_room(arms: list[UrdfArm], carried: Mapping[str, ET.Element]) -> None:
    """Merge capsules where a cell has no room for all of them; one each is a tool's."""
    fits = {fit.link: fit for arm in arms for fit in arm.fits}
    most = MOST_OF_CELL - len(arms)
    if sum(len(fit.tubes) for fit in fits.values()) <= most:
        return
    moved = [joint for arm in arms for joint in arm.chain]
    places = {}
    for link in fits:
        R, p, at = np.eye(3), np.zeros(3), link
        while at in carried and carried[at] not in moved:
            turn, shift = origin_of(carried[at])
            R, p, at = turn @ R, turn @ p + shift, end_of(carried[at], "parent")
        places[link] = Place(carried[at].get("name", "") if at in carried else "", R, p)
    kept = merged(list(fits.values()), places, most)
    if sum(len(fit.tubes) for fit in kept) > most:
        raise ConfigError(f"{arms[0].urdf}: moves more than {most} bodies: too many for a cell")
    for arm in arms:
        its = {fit.link for fit in arm.fits}
        arm.fits = [fit for fit in kept if fit.link in its]


def _way_to(urdf: Path, tip: str, carried: Mapping[str, ET.Element]) -> list[ET.Element]:
    way, at, seen = [], tip, {tip}
    while at in carried:
        way.append(carried[at])
        at = end_of(carried[at], "parent")
        if at in seen:
            raise ConfigError(f"{urdf}: link '{at}': the chain runs in a circle")
        seen.add(at)
    return way[::-1]


def _own_part(way: list[ET.Element]) -> tuple[list[ET.Element], list[ET.Element]]:
    """Return the joints of the arm alone on the way to its tip, and those of a base before it.

    A base has wheels, or joints that move it over the floor: planar or floating ones, or two that
    slide across and one that turns.
    """
    last = 0
    for i, joint in enumerate(way, start=1):
        wheel = joint.get("type") == "continuous" and is_wheel(joint)
        if wheel or joint.get("type") in ("planar", "floating"):
            last = i
    sliding = [joint for joint in way[last:] if movable(joint)][:3]
    kinds = sorted(str(joint.get("type")).replace("continuous", "revolute") for joint in sliding)
    level = [is_upright(joint) == (joint.get("type") != "prismatic") for joint in sliding]
    if kinds == ["prismatic", "prismatic", "revolute"] and all(level):
        last = way.index(sliding[-1]) + 1
    return way[last:], way[:last]


def _part(arms: list[UrdfArm]) -> None:
    """Give several arms names, and leave to each what is its own."""
    if len(arms) == 1:
        return
    for i, arm in enumerate(arms):
        arm.without = tuple(end_of(other.chain[0], "child") for other in arms if other is not arm)
        sides = {side_of(f"{arm.chain[0].get('name')} {arm.tip}") for arm in arms}
        side = side_of(f"{arm.chain[0].get('name')} {arm.tip}")
        arm.name = side if side and len(sides) == len(arms) else f"arm_{i + 1}"
        arm.first_joint = arm.chain[0].get("name")


def carried_mass(arm: UrdfArm, link: str = "") -> float:
    """Return the mass of a link and all that it carries, or of what the arm's joints move [kg]."""
    estimated = {given.link: given.mass for given in arm.inertials}
    moved = arm.tree.walk(link or end_of(arm.chain[0], "child"))
    return sum(estimated.get(name, arm.tree.mass(name)) for name, _, _ in moved)


def beyond(arm: UrdfArm) -> tuple[float, tuple[float, ...]]:
    """Return mass [kg] and centre of mass (3,) [m] of the tip link and what it carries.

    In the tip link's frame, all joints beyond it at zero.
    """
    estimated = {given.link: given for given in arm.inertials}
    mass, moment = 0.0, np.zeros(3)
    for name, R, p in arm.tree.walk(arm.tip):
        if name in estimated:
            own, com = estimated[name].mass, estimated[name].com
        else:
            own, com = arm.tree.mass(name), origin_of(arm.tree.links[name].find("inertial"))[1]
        mass += own
        moment = moment + own * (p + R @ com)
    com = moment / mass if mass > 0.0 else moment
    return round(mass, 4), tuple(com.round(4).tolist())


def _look_at(arms: Sequence[UrdfArm], link: ET.Element, packages: Mapping[str, Path]) -> None:
    """Fit capsules where the daemon reads no shape, and estimate what has no inertia.

    For the arm whose link it is; for all of them where it is none's.
    """
    name, urdf = link.get("name", ""), arms[0].urdf
    its = [arm for arm in arms if name in arm.own] or list(arms)
    shape = link_shape(link, urdf, packages, meshes_only=True)
    mass = its[0].tree.mass(name)
    around: Fit | None = None
    if shape is not None:
        around = fit(shape)
    elif mass >= FRAME_MASS and link.find("collision") is None:
        # A ball of its mass: it has no shape, and something has to keep it clear.
        com = origin_of(link.find("inertial"))[1].round(4)
        radius = (0.75 * mass / (math.pi * DENSITY)) ** (1.0 / 3.0)
        around = Fit(name, (Tube(com, com, radius),), 1.0, "the mass of no shape")
    for arm in its:
        arm.fits += [] if around is None else [around]
    why = inertial_fault(link)
    if why in (None, NO_INERTIA) and mass < FRAME_MASS and not _alone(its[0], name):
        return  # a frame, which something else carries
    if why is None and mass == 0.0:
        why = "the URDF has none, or one without mass"
    if why is None:
        return
    whole = link_shape(link, urdf, packages)
    hull = None if whole is None else hull_of(extreme(whole.triangles.reshape(-1, 3), 1000))
    if hull is None:
        mass = mass or ROUGH_MASS
        given = Inertial(name, mass, np.zeros(3), np.eye(3) * 1e-3 * mass, why)
    else:
        mass = mass or max(DENSITY * hull.volume, 1e-3)
        inertia = hull.moments * (mass / hull.volume) + np.eye(3) * 1e-6 * mass
        given = Inertial(name, mass, hull.centre, inertia, why)
    for arm in its:
        arm.inertials.append(given)


def _alone(arm: UrdfArm, name: str) -> bool:
    """Return whether a link's joint is of the arm, and moves a link that has no mass of its own.

    What is fixed to such a link may have all the mass.
    """
    if arm.tree.above.get(name) not in arm.chain:
        return False
    one_body = arm.tree.walk(name, lambda joint: joint not in arm.chain)
    return sum(arm.tree.mass(link) for link, _, _ in one_body) <= 0.0
