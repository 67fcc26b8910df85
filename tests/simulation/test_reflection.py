"""Force reflection over emulated networks, judged by the rig's and the device's own truth.

A sample of `make campaign ARGS="--only reflection"`, with a seed of its own.
"""

import numpy as np
import pytest
from laboratory.campaign.contact.reflection_trial import trial
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

SEED = 7


@pytest.fixture(scope="module")
def cell():
    return load_cell("pa10_reflect")


@pytest.mark.parametrize(("mode", "rtt_s"), [("rate", 0.05), ("rate", 0.5), ("pose", 0.3)])
def test_a_stiff_wall_far_away_is_pushed_without_bouncing(cell, mode, rtt_s):
    found = trial(cell, mode, rtt_s, stiffness=150.0, seed=SEED)
    assert found.faults == ()
    assert found.drift_m < 0.02


def test_without_protection_a_reflecting_stick_bounces_at_a_tenth_of_a_second(cell):
    found = trial(cell, "rate", 0.1, protected=False, seed=SEED)
    assert found.ripple > 0.4  # 0.497 with drives that hold the arm's weight


def test_without_protection_a_reflecting_master_bounces_and_gives_out_energy(cell):
    found = trial(cell, "pose", 0.1, protected=False, stiffness=150.0, seed=SEED)
    assert found.ripple > 0.3  # 0.44 to 1.3 by the seed; protected 0.07 at most
    assert found.least_energy_j < -0.05


def test_a_network_that_dies_in_contact_ends_the_force_the_motion_and_the_contact(cell):
    """The arm's own force loop needs no network: it lets the wall go before HOLD comes."""
    steps = [
        {"at_s": 0.3, "device": {"hand": [0.03, 0, 0], "seconds": 0.3, "expressed_in": "base"}},
        {"at_s": 3.0, "link": {"cut": True}},
    ]
    script = Script.model_validate({"duration_s": 5.0, "network": {"rtt_s": 0.1}, "step": steps})
    simulation = Simulation(cell, script)
    simulation.run()
    forces = np.array([truth.contact_force[0] for truth in simulation.truths])
    times = np.array([truth.time_s for truth in simulation.truths]) - simulation.player.start_s
    assert forces[(times > 2.5) & (times < 3.0)].mean() > 5.0
    assert forces[times > 3.0 + cell.config.timing.stream_timeout_s + 0.6].max() < 1.0
    assert str(simulation.cycle.mode) == "hold"
    client = simulation.player.operators.handles["operator"]
    assert client.silent
    np.testing.assert_array_equal(client.device.force, 0.0)
