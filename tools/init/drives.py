"""Drives by their joints' limits in the URDF, and which of these cannot be meant."""

import re
import xml.etree.ElementTree as ET
from typing import Final

from ...config.urdf.robot import CONTINUOUS_RANGE
from .draft import DriveDraft
from .shape.shapes import Array

UNKNOWN_SPEED: Final = (0.5, 0.1)
"""Of a joint whose URDF says none."""
FASTEST: Final = (1.5, 0.25)
"""No joint is told to be faster, a prismatic one in metres [rad/s], [m/s]."""
QUICKEST: Final = 8.0
"""No joint accelerates more [rad/s²]."""
STRONGEST: Final = 1e4
"""Greater torques in a URDF stand for none [N·m]."""
MEANT: Final = 20.0
"""A torque beyond so many times what holds all of the arm, stretched out, is doubted [1]."""
HOLDS: Final = 0.7
"""Part of a torque that gravity may take in postures that are used [1]."""
OFTEN: Final = 0.3
"""A torque that holds the arm in fewer of all postures cannot be meant [1]."""
STOPS_S: Final = 0.4
"""Time in which the acceleration ends the greatest speed [s]."""


def cell_name(stem: str) -> str:
    """Return the name of a cell, by its file's."""
    name = re.sub(r"[^a-z0-9_]+", "_", stem.lower()).strip("_")
    return (name if name[:1].isalpha() else f"arm_{name}")[:32]


def limit_of(joint: ET.Element, key: str) -> float:
    """Return a joint's limit of that name, 0 where the URDF has none."""
    limit = joint.find("limit")
    return float(limit.get(key, "0")) if limit is not None else 0.0


def drive_of(joint: ET.Element) -> DriveDraft:
    """Return the drive of a joint, with a note at each limit that is missing or absurd."""
    kind, name = joint.get("type"), joint.get("name", "")
    prismatic = kind == "prismatic"
    speed = limit_of(joint, "velocity")
    notes = []
    if speed <= 0.0:
        notes.append(f"the URDF has no speed limit of {name}")
        velocity = UNKNOWN_SPEED[prismatic]
    else:
        velocity = min(0.5 * speed, FASTEST[prismatic])
    drive = DriveDraft(name, prismatic, max(velocity, 2e-3), 1.0, 1e5, notes=notes)
    if kind != "continuous":
        told = limits_of(limit_of(joint, "lower"), limit_of(joint, "upper"), prismatic=prismatic)
        if told is not None:
            drive.lower, drive.upper = told
            notes.append(f"the URDF's limits of {name} are missing, or wider than cables go")
    return drive


def range_of(joint: ET.Element, drive: DriveDraft) -> tuple[float, float]:
    """Return least and greatest position of a joint: its drive's, or else the URDF's."""
    if drive.lower is not None and drive.upper is not None:
        return drive.lower, drive.upper
    return limit_of(joint, "lower"), limit_of(joint, "upper")


def set_strength(
    drive: DriveDraft, joint: ET.Element, gravity: Array, inertia: float, stretched: float
) -> None:
    """Set torque, acceleration and speed of a drive.

    `stretched` is the torque [N·m], or force [N], that holds all of the arm at its reach. By the
    torques `gravity` (p,) that hold the arm in many postures, and the greatest inertia that
    the joint moves. A URDF's torque that holds the arm in some of them is kept.
    """
    effort, weight = limit_of(joint, "effort"), float(gravity.max(initial=0.0))
    drive.notes = [note for note in drive.notes if "torque limit" not in note]
    drive.torque = effort
    held = float((gravity <= HOLDS * effort).mean())
    if not 0.0 < effort <= STRONGEST or held < OFTEN:
        drive.torque = float(f"{3.0 * weight + 6.0 * inertia + 0.5:.2g}")
        why = "is missing, or absurd"
        if 0.0 < effort <= STRONGEST:
            why = f"is {effort:g}, and would not hold the arm, which takes {weight:.3g}"
        drive.notes.append(f"the URDF's torque limit of {drive.joint} {why}")
    elif weight > effort:
        drive.notes.append(
            f"the torque limit of {drive.joint}, {effort:g}, does not hold the arm everywhere: "
            f"stretched out it takes {weight:.3g}"
        )
    if drive.torque > MEANT * stretched:
        drive.notes.append(
            f"the torque limit of {drive.joint}, {effort:g}, is {effort / stretched:.0f} times "
            "what holds the whole arm stretched out: is it meant?"
        )
    taken = min(weight, HOLDS * drive.torque)
    spare = drive.torque - taken
    drive.acceleration = max(0.05, min(QUICKEST, 0.33 * spare / (1.3 * inertia + 5e-3)))
    drive.velocity = min(drive.velocity, max(2e-3, STOPS_S * drive.acceleration))


def limits_of(lower: float, upper: float, *, prismatic: bool) -> tuple[float, float] | None:
    """Return the limits to say where those of a URDF are missing or absurd, else None."""
    if prismatic:
        if lower >= upper:
            return 0.0, 0.3
        return (max(lower, -5.0), min(upper, 5.0)) if upper - lower > 10.0 else None
    if lower >= upper:
        return -3.0, 3.0
    if max(abs(lower), abs(upper)) > 2.0 * CONTINUOUS_RANGE:
        return max(lower, -CONTINUOUS_RANGE), min(upper, CONTINUOUS_RANGE)
    return None
