"""Noise of a sensor shakes no arm beside a singularity, where slow commands are damped least."""

import numpy as np
from telerobot.config.load import altered, load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

NEARLY = 0.02
"""Angle of the wrist's middle joint, which loses an axis at zero [rad]."""


def test_force_control_on_a_sensor_four_times_as_noisy_shakes_no_wrist_that_is_nearly_straight():
    cell = load_cell("ur5e")
    stands = [*cell.config.mechanism.postures["start"]]
    stands[4] = NEARLY
    noise = [4.0 * n for n in cell.config.rig.force_torque.noise]
    cell = altered(cell, {"mechanism.postures.start": stands, "rig.force_torque.noise": noise})
    simulation = Simulation(cell, Script.model_validate({"duration_s": 4.0}))
    run = Run(simulation, simulation.run())
    enabled_s = simulation.player.start_s
    rates = np.array([t.dq for t in run.truths if t.time_s > enabled_s])
    assert run.summary["mode"] == "enabled"
    assert abs(run.truths[-1].q[4] - NEARLY) < 0.01
    assert np.abs(rates).max() < 0.05
    # Between: of an arm without force control it would be nothing at all.
    assert 0.003 < np.sqrt((rates**2).mean(axis=0)).max() < 0.015
