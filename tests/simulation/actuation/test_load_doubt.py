"""At torque level a declared payload that is not there does not make the arm swing."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

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


# The last one is refused.
@pytest.mark.parametrize("mass", [0.98, 3.9, 4.5, 5.0])
def test_a_payload_that_is_not_there_leaves_the_arm_at_rest_after_a_knock(mass):
    run = held(mass, 0.1)
    torques = np.array([s.tau for s in run.states if LATER_S <= s.time_s < END_S])
    drives = run.simulation.cell.config.mechanism.drives
    assert run.summary["mode"] == "hold"
    assert np.all(np.ptp(torques, axis=0) < WITHIN * np.array([d.max_torque for d in drives]))


FAR = {
    "fuzzed": (0.14, (1.5, 1.5, 1.0)),
    "below": (0.3, (0.0, 0.0, 1.5)),
    "beside": (1.0, (0.5, 0.0, 0.0)),
    "heavy": (10.0, (0.1, 0.0, 0.15)),
}
"""Payloads [kg, m] whose inertia the arm has not without them."""
TURN = {"twist": [0.05, 0.05, 0.05, 0.3, 0.3, 0.3], "expressed_in": "base"}


def moved(told, **rig):
    """Return a run in which a payload is told, acknowledged, and the tool turned by the stick."""
    mass, com = told
    steps = [
        {"at_s": 1.0, "operator/payload": {"mass": mass, "com": list(com)}},
        {"at_s": 1.8, "operator/acknowledge_load": {}},
        {"at_s": 2.0, "cmd/joystick": TURN, "for_s": 0.5},
    ]
    cell = altered(load_cell("pa10_hand_torque"), rig, "rig")
    script = Script.model_validate({"duration_s": END_S, "step": steps})
    simulation = Simulation(cell, script)
    return Run(simulation, simulation.run())


@pytest.mark.parametrize("told", FAR.values(), ids=FAR.keys())
def test_a_payload_that_would_swing_the_arm_without_it_is_refused_unless_it_hangs_there(told):
    run = moved(told)
    (refused,) = run.summary["refused"]
    assert "unstable_payload" in refused
    assert "of the inertia that the torque law would move" in refused
    assert run.summary["mode"] == "enabled"


def test_a_heavy_payload_that_hangs_there_is_taken():
    mass, com = 9.0, (0.0, 0.0, 0.1)
    run = moved((mass, com), payload_mass=mass - 0.98, payload_com=(0.0, 0.0, 0.1053))
    assert run.summary["refused"] == []
    assert len(run.events("payload_set")) == 1
    assert run.summary["mode"] == "enabled"
