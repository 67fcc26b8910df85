"""What hangs on the arm's last link, by the URDF: the load of a sensor there."""

import xml.etree.ElementTree as ET

import numpy as np

from .robot import Arm
from .shapes import Array, placement


def beyond(arm: Arm) -> tuple[float, tuple[float, ...]]:
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
