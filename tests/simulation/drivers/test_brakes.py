"""Enabling moves nothing: drives hold their joints, and know the load, before brakes open."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

MODES = ("csp", "csv", "cst")
CELLS = {
    "pa10": MODES,
    "pa10_hand": MODES,
    "pa10_hand_pole": ("csp",),
    "pa10_hand_torque": ("cst",),
    "pa10_peg": ("csp",),
    "pa10_platform": MODES,
    "pa10_reflect": ("csv",),
    "ranger": MODES,
    "rover": ("csp", "csv"),
    # The other cells are one of these with something around the arm.
    "snake": ("csp",),
    "snake30": ("csp", "csv"),
    "snake_tail": ("csp",),
    "ur5e": MODES,
    # Its tool is told to nobody: a torque law would let it sink, and the cell has none.
    "ur5e_scene": ("csp", "csv"),
}


def moved(name, mode):
    """Return how far any joint goes from where it stood [rad]."""
    cell = altered(load_cell(name), {"mechanism.operation_mode": mode})
    if cell.config.rig.frames is not None:
        # The tool keeps its place beside a platform that seems to sway: that is asked for.
        cell = altered(cell, {"rig.frames.noise": (0.0, 0.0)})
    simulation = Simulation(
        cell,
        Script.model_validate({"duration_s": 0.35, "step": []}),
    )
    way = []
    simulation.on_physics = lambda s: way.append(s.rig.world.q.copy())
    result = simulation.run()
    assert result.ok, result.summary
    assert result.summary["mode"] == "enabled"
    return np.abs(np.array(way) - way[0]).max()


@pytest.mark.parametrize(
    ("name", "mode"), [(n, mode) for n, all_ in CELLS.items() for mode in all_]
)
def test_no_joint_of_a_shipped_arm_moves_by_a_milliradian_when_it_is_enabled(name, mode):
    assert moved(name, mode) < 1e-3
