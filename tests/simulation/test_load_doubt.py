"""At torque level a declared payload that is not there does not make the arm swing."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from .conftest import Run

OFF_S, LATER_S, END_S = 1.65, 2.7, 3.0
WITHIN = 0.02
"""Of a motor's torque: what friction, noise and encoders leave of it at rest [1]."""


def held(mass: float, height: float) -> Run:
    """Return a run with a payload declared, and a knock in HOLD: 50 ms of 15 N."""
    steps = [
        {"at_s": 0.4, "operator/payload": {"mass": mass, "com": [0.0, 0.0, height]}},
        {"at_s": 1.2, "operator/mode": {"action": "hold"}},
        {
            "at_s": OFF_S - 0.05,
            "rig/fault": {"kind": "hand", "target": "force_torque", "vector": [15.0, 0.0, 0.0]},
        },
        {"at_s": OFF_S, "rig/fault": {"kind": "hand", "target": "force_torque", "on": False}},
    ]
    script = Script.model_validate({"duration_s": END_S, "step": steps})
    simulation = Simulation(load_cell("pa10_hand_torque"), script)
    return Run(simulation, simulation.run())


@pytest.mark.parametrize("mass", [0.98, 3.9, 5.0])
def test_a_payload_that_is_not_there_leaves_the_arm_at_rest_after_a_knock(mass):
    run = held(mass, 0.1)
    torques = np.array([s.tau for s in run.states if LATER_S <= s.time_s < END_S])
    drives = run.simulation.cell.config.mechanism.drives
    assert run.summary["mode"] == "hold"
    assert np.all(np.ptp(torques, axis=0) < WITHIN * np.array([d.max_torque for d in drives]))
