"""Cells of hostile and wild runs: bare, with a gripper, on moving ground."""

import numpy as np
from telerobot.config.load import Cell, altered
from telerobot.config.schema.mechanism import GripperSection, PayloadSection
from telerobot.config.schema.rig import RigGripperSection
from telerobot.config.schema.section import PoseSection
from telerobot.config.schema.surroundings import MovingFrameSection
from telerobot.tools.soak.segments import Draw

GRIPPER_NODE = 120
EMPTY, LOADED = "campaign_empty", "campaign_loaded"
"""Names of the payloads that the gripper switches."""
NOISE = (2e-5, 2e-5)
"""Standard deviation of each axis of a told pose [m], [rad]: an encoder's, for noise that is worse
would show in goals, which are judged to a millimetre."""


def opened(cell: Cell) -> Cell:
    """Return the cell with nothing around the arm."""
    return cell if cell.config.rig is None else altered(cell, {"wall": None, "boxes": ()}, "rig")


def with_gripper(draw: Draw, cell: Cell) -> Cell:
    """Return the cell with a gripper and something to pick up; as it is without a sensor or rig."""
    mechanism = cell.config.mechanism
    sensor = mechanism.force_torque
    if cell.config.rig is None or sensor is None or mechanism.gripper is not None:
        return cell
    mass, com = float(draw.uniform(0.2, 1.2)), draw.uniform(-0.03, 0.03, 3)
    com[2] += 0.1
    empty = sensor.payload
    whole = empty.mass + mass
    x, y, z = ((empty.mass * np.array(empty.com) + mass * com) / whole).tolist()
    hx, hy, hz = com.tolist()
    return altered(
        cell,
        {
            "mechanism.gripper": GripperSection(
                node=GRIPPER_NODE, open_payload=EMPTY, closed_payload=LOADED
            ),
            f"mechanism.payloads.{EMPTY}": empty,
            f"mechanism.payloads.{LOADED}": PayloadSection(mass=whole, com=(x, y, z)),
            "rig.gripper": RigGripperSection(mass=mass, com=(hx, hy, hz)),
        },
    )


def with_moving(draw: Draw, cell: Cell) -> Cell:
    """Return the cell with a Base or a Carrier that may move, or both; as it is without a rig."""
    if cell.config.rig is None:
        return cell
    which = int(draw.integers(3))
    x, y, z = draw.uniform(-0.5, 0.5, 3).tolist()
    return altered(
        cell,
        {
            "frames.base": MovingFrameSection() if which != 1 else None,
            "frames.carrier": MovingFrameSection() if which != 0 else None,
            "frames.T_world_carrier": PoseSection(xyz=(x, y, z)),
            "rig.frames.noise": NOISE,
            "rig.frames.twists": bool(draw.random() < 0.5),
        },
    )
