"""Links of a URDF: which carries which, and where they are."""

import math
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from .elements import end_of, origin_of

Array = NDArray[np.float64]


class LinkTree:
    """Links of a URDF, and the joints that each carries."""

    def __init__(self, root: ET.Element) -> None:
        self.links = {link.get("name", ""): link for link in root.findall("link")}
        self.above = {end_of(joint, "child"): joint for joint in root.findall("joint")}
        """The joint that carries each link, but the roots."""
        self._below: dict[str, list[ET.Element]] = {}
        for joint in root.findall("joint"):
            self._below.setdefault(end_of(joint, "parent"), []).append(joint)
        self.roots = [link for link in self.links if link not in self.above]
        """Names of the links that no joint carries."""

    def below(self, link: str) -> list[ET.Element]:
        """Return the joints that a link carries."""
        return self._below.get(link, [])

    def walk(
        self, link: str, through: Callable[[ET.Element], bool] = lambda _joint: True
    ) -> Iterator[tuple[str, Array, Array]]:
        """Yield a link and all that it carries, those nearer to it first, all joints at zero.

        Each with its attitude (3, 3) and place (3,) in the first; `through` says beyond which
        joints.
        """
        seen, waiting = {link}, deque([(link, np.eye(3), np.zeros(3))])
        while waiting:
            name, R, p = waiting.popleft()
            yield name, R, p
            for joint in filter(through, self.below(name)):
                if (child := end_of(joint, "child")) not in seen:
                    seen.add(child)
                    turn, shift = origin_of(joint)
                    waiting.append((child, R @ turn, p + R @ shift))

    def mass(self, link: str) -> float:
        """Return the mass that the URDF says of a link, 0 where it says none [kg]."""
        told = self.links[link].find("inertial/mass") if link in self.links else None
        return 0.0 if told is None else _number(told.get("value"))


def movable(joint: ET.Element) -> bool:
    """Return whether a joint moves along or about one axis."""
    return joint.get("type") in ("revolute", "continuous", "prismatic")


def _number(text: str | None) -> float:
    try:
        value = float(text or "0")
    except ValueError:
        return 0.0
    return value if math.isfinite(value) and value > 0.0 else 0.0
