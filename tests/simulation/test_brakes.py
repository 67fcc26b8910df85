"""Enabling moves nothing: drives hold their joints before they open the brakes."""

import dataclasses

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

CELLS = {
    "pa10": ("csp", "csv", "cst"),
    "ur5e": ("csp", "csv", "cst"),
    "ranger": ("csp", "csv", "cst"),
    "pa10_hand_torque": ("cst",),
}


@pytest.mark.parametrize(
    ("name", "mode"), [(n, mode) for n, all_ in CELLS.items() for mode in all_]
)
def test_no_joint_of_a_shipped_arm_moves_by_a_milliradian_when_it_is_enabled(name, mode):
    cell = load_cell(name)
    mechanism = cell.config.mechanism.model_copy(update={"operation_mode": mode})
    config = cell.config.model_copy(update={"mechanism": mechanism})
    simulation = Simulation(
        dataclasses.replace(cell, config=config),
        Script.model_validate({"duration_s": 0.5, "step": []}),
    )
    way = []
    simulation.on_physics = lambda s: way.append(s.rig.world.q.copy())
    result = simulation.run()
    assert result.ok, result.summary
    assert result.summary["mode"] == "enabled"
    assert np.abs(np.array(way) - way[0]).max() < 1e-3
