"""End of the arm in a URDF's tree: fingers, wheels and heads are no part of it."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Final

from ...config.errors import ConfigError

FINGERS: Final = 2
"""A branch of so many movable joints, or fewer, is a finger, a wheel or a head [1]."""
OF_A_FINGER: Final = 4
"""Two branches of an arm's end that have so many joints, or fewer, are fingers; three are [1]."""
OF_AN_ARM: Final = 3
"""Before so many joints there is no arm yet that could end [1]."""
_OF_A_HAND: Final = re.compile(r"grip|finger|jaw|knuckle|thumb|claw|hand_joint", re.IGNORECASE)
_OF_A_WRIST: Final = re.compile(r"wrist|forearm|elbow|shoulder|roll|pitch|yaw|flex", re.IGNORECASE)
_OF_A_WHEEL: Final = re.compile(r"wheel|caster|castor|tyre|tire", re.IGNORECASE)
_TOOLS: Final = ("tool0", "tcp", "ee_link", "flange", "tool", "tool_frame", "hand_tcp", "grasp")


def tip_of(urdf: Path, root: ET.Element) -> str:
    """Return the last link of the only arm in a tree. Raises `ConfigError` where there are more."""
    tree = LinkTree(root)
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


class LinkTree:
    """Links of a URDF, and the joints that each carries."""

    def __init__(self, root: ET.Element) -> None:
        """Read them."""
        self._below: dict[str, list[ET.Element]] = {}
        carried = set()
        for joint in root.findall("joint"):
            self._below.setdefault(end_of(joint, "parent"), []).append(joint)
            carried.add(end_of(joint, "child"))
        links = [link.get("name", "") for link in root.findall("link")]
        self.roots = [link for link in links if link not in carried]
        """Names of the links that no joint carries."""

    def end_from(self, at: str, moved: int = 0) -> tuple[str, list[ET.Element]]:
        """Return where the arm ends that goes on from a link, `moved` joints after its root.

        And, where it divides into several, the joints that these begin with.
        """
        while True:
            branches = [joint for joint in self._at(at) if self._depth(joint) > 0]
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

    def _at(self, link: str) -> list[ET.Element]:
        return self._below.get(link, [])

    def _depth(self, joint: ET.Element) -> int:
        """Return the most movable joints on a way from a joint, itself among them."""
        deeper = [self._depth(j) for j in self._at(end_of(joint, "child"))]
        return int(movable(joint)) + max(deeper, default=0)

    def _hand(self, joint: ET.Element) -> bool:
        """Return whether a branch's first movable joint is a hand's, by its name or its link's.

        A link's name counts where nothing moves beyond it: fingers hang on a link that is called
        gripper, and the joint that turns it is the arm's.
        """
        while not movable(joint):
            following = [j for j in self._at(end_of(joint, "child")) if self._depth(j) > 0]
            if len(following) != 1:
                return True
            joint = following[0]
        if joint.find("mimic") is not None:
            return True
        name, child = joint.get("name", ""), end_of(joint, "child")
        beyond = [j for j in self._at(child) if self._depth(j) > 0]
        if beyond and (_OF_A_WRIST.search(name) or not _OF_A_HAND.search(name)):
            return False
        named = _OF_A_HAND.search(name) or _OF_A_HAND.search(child)
        return bool(named) and all(self._hand(j) for j in beyond)

    def _tool(self, at: str) -> str:
        """Return the tool's frame among the links that are fixed to the last one, if there is."""
        fixed, waiting = [], [at]
        while waiting:
            link = waiting.pop(0)
            fixed.append(link)
            waiting += [end_of(j, "child") for j in self._at(link) if not movable(j)]
        for word in _TOOLS:
            for link in fixed[1:]:
                if link.lower() == word or link.lower().endswith(f"_{word}"):
                    return link
        hands = [link for link in fixed if any(movable(j) for j in self._at(link))]
        return hands[0] if hands else at


def moves(joint: ET.Element) -> bool:
    """Return whether a joint moves at all."""
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


def movable(joint: ET.Element) -> bool:
    """Return whether a joint moves along or about one axis."""
    return joint.get("type") in ("revolute", "continuous", "prismatic")


def end_of(joint: ET.Element, which: str) -> str:
    """Return the name of a joint's `parent` or `child`, empty where it has none."""
    element = joint.find(which)
    return "" if element is None else element.get("link", "")
