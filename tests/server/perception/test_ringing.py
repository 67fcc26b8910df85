"""What is ringing, and what is a hand: by frequency, decay and stiffness."""

from types import SimpleNamespace

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.commands.commands import Commands
from telerobot.server.control.spatial import Pose
from telerobot.server.events import Events
from telerobot.server.mode import Mode
from telerobot.server.perception.contact import ContactStability

T = 0.01


def heard(force, stiffness, seconds=3.0):
    """Return the events of a force(t) [N] along x on something of a stiffness [N/m]."""
    commands, events = Commands.from_cell(load_cell("pa10")), Events()
    monitor = ContactStability(commands.settings.bounds.force_loop, commands, 30.0, T, events)
    gains = {"force": commands.settings.gains["force"]}
    for k in range(round(seconds / T)):
        f = force(k * T)
        output = SimpleNamespace(
            wrench=np.array([f, 0, 0, 0, 0, 0]),
            twists={}, task=SimpleNamespace(gains=gains),
            T_world_mrf_measured=Pose(np.eye(3), np.array([0.8 + f / stiffness, 0.0, 0.0])),
        )  # fmt: skip
        monitor.update(output, Mode.ENABLED)
    return [e for e in events.take() if e.name == "contact_unstable"], monitor.share


def ringing(hertz, decay_s=np.inf):
    return lambda t: 40.0 + 38.0 * np.exp(-t / decay_s) * np.sin(2 * np.pi * hertz * t)


@pytest.mark.parametrize("hertz", [6.0, 8.0, 12.0])
def test_what_swings_at_the_loops_frequency_on_something_stiff_rings(hertz):
    (said, *_), share = heard(ringing(hertz), 6e4)
    assert said.values["stiffness"] == pytest.approx(6e4, rel=0.05)
    assert share <= 0.5


@pytest.mark.parametrize(
    ("force", "stiffness"),
    [
        (ringing(6.0), 500.0),
        (ringing(6.0), 15e3),
        (ringing(1.5), 6e4),
        (ringing(6.0, decay_s=0.1), 2.5e4),
        (lambda t: 60.0 * (t > 1.0), 6e4),
        (lambda t: 50.0 * min(t, 1.0), 6e4),
    ],
    ids=["a hand shakes it", "as declared", "slow", "it dies away", "a step", "a ramp"],
)
def test_what_does_not_ring_is_left_alone(force, stiffness):
    said, share = heard(force, stiffness)
    assert said == []
    assert share == 1.0
