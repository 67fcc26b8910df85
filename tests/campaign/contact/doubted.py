"""Contact of an arm whose payload was told wrong, and which nobody acknowledged: it lets go, too.

Force control waits (`load_unexplained`), so nothing bleeds contact off. An operator drives the tool
or the wrist onto a plate by stick or jog, faster and slower; judged as in `letting_go.py`.
"""

from itertools import product

import numpy as np
from telerobot.config.load import Cell, altered, load_cell
from telerobot.drivers.rig.physics.world import World

from .letting_go import (
    HIT_S,
    LOAD_AT,
    MODES,
    STIFFNESSES,
    ContactPlan,
    met,
    plate,
    prepared,
    surrounded,
)

CELLS = ("pa10", "pa10_hand_torque")
"""With collision detection by torques, and without, where the tool alone is felt."""
LOADS = (5.0, -5.0)
"""Heavier than was told, or as much lighter [kg]."""
MOTIONS = (("stick", 0.1), ("stick", 0.02), ("jog", 0.1))
"""The stick moves the tool down [m/s], or s2 the wrist [rad/s]."""
BEGUN_S = 2.0
"""The load has been said to be unexplained by then [s]."""
NEAREST = 0.03
"""The tool begins at least so far from the plate [m]."""
WIDE, AHEAD = 0.1, np.array([0.05, 0.0, 0.0])
"""Half the side of a plate that the tool meets [m], and where its middle is from the MRF (3,) [m]:
the tool does not meet its edge, nor the wrist the plate."""
FAR = 0.3
"""Where nothing is met [m]."""

TABLE = tuple(
    row
    for row in product(CELLS, MODES, STIFFNESSES, LOADS, MOTIONS)
    if row[0] == "pa10" or row[-1][0] == "stick"
)
"""Cell, operation mode, wall [N/m], load [kg], motion."""


def doubted(number: int) -> ContactPlan:
    """Return a contact of the table."""
    name, mode, stiffness, load, (how, speed) = TABLE[number]
    cell = load_cell(name)
    start = np.array(cell.config.mechanism.postures["ready"])
    cell = _mistaken(prepared(cell, start, mode, sensed=True), load)
    title = f"{name} {load:+g} kg {how} {speed:g} {stiffness / 1e3:g} kN/m {mode}"
    if how == "jog":
        rates = np.zeros(len(start))
        rates[1] = speed
        cell = met(cell, start, rates, "wrist", stiffness)
        return ContactPlan(title, cell, tuple(rates.tolist()), None, BEGUN_S, "load_unexplained")
    down = np.array([0.0, 0.0, -1.0])
    tool = World(cell).data.site("mrf").xpos + AHEAD
    far = World(
        surrounded(cell, wall=plate(tool + FAR * down, down, stiffness, WIDE))
    ).distances.clearance()
    if far is None:
        raise ValueError(f"cell {name}: the plate is nowhere")
    at = tool + (FAR - far + max(NEAREST, speed * HIT_S)) * down
    cell = surrounded(cell, wall=plate(at, down, stiffness, WIDE))
    twist = (0.0, 0.0, -speed, 0.0, 0.0, 0.0)
    return ContactPlan(title, cell, None, twist, BEGUN_S, "load_unexplained")


def _mistaken(cell: Cell, load: float) -> Cell:
    """Return the cell whose arm carries `load` more than the daemon is told [kg]."""
    if load > 0.0:
        return surrounded(cell, payload_mass=load, payload_com=LOAD_AT)
    sensor = cell.config.mechanism.force_torque
    if sensor is None:
        raise ValueError(f"cell {cell.config.name}: needs a force/torque sensor")
    return altered(cell, {"mechanism.force_torque.payload.mass": sensor.payload.mass - load})
