"""What a tool touches is told by gentle presses, and what is proposed for it holds, by physics."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.server.identification.environment import Along, propose
from telerobot.tools.identify.cli import touch
from telerobot.tools.identify.environment import Press
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from tests.conftest import shared

PRESS = Press(Along.of("z"), 0.02, 15.0, "ready")
CONTACT = 2.9e6
"""Stiffness of MuJoCo's own contact between tool and plate, in series with the wall's [N/m]: a wall
of 200 kN/m is one of 187."""
SWING_N = 1.0
"""Swings to either side of the mean that count [N]."""
RINGING = 4.0
"""So many turns of them a second are ringing; joints that stick and slip turn more slowly [1/s]."""
WALLS = [(2e3, 100.0), (2e3, 300.0), (20e3, 300.0), (200e3, 300.0)]
"""Stiffness [N/m] and damping [N·s/m]."""


def before_a_wall(stiffness, damping, free=0.006):
    """Return a cell whose tool stands so far from a wall at `ready` [m]."""
    wall = {"stiffness": stiffness, "damping": damping, "xyz": (0.712 + free, 0.0, 0.5)}
    return altered(load_cell("pa10"), wall, "rig.wall")


@shared
def told(stiffness, damping):
    """Return what is told of a wall, and what is proposed for it."""
    cell = before_a_wall(stiffness, damping)
    found = touch(cell, PRESS, simulate=True)
    return found, propose(cell, found, PRESS.along)


def gain(at_s, gains):
    asked = {"source": "force", "gain": list(gains), "forced": True}
    return {"at_s": at_s, "operator/gain": asked}


def push(at_s, force):
    return {"at_s": at_s, "cmd/force": {"wrench": [0.0, 0.0, force, 0.0, 0.0, 0.0]}}


def held(wall, gains):
    """Touch a wall gently, and hold 10 N with those gains; return mean [N], and ringing."""
    cell = before_a_wall(*wall, free=0.0005)
    gentle = np.minimum(told(*wall)[1].gain, cell.config.sources.force.gain)
    steps = [
        {"at_s": 0.0, "cmd/posture": {"posture": "ready"}},
        gain(4.0, gentle),
        push(4.2, 6.0),
        gain(9.0, gains),
        push(9.5, 10.0),
    ]
    simulation = Simulation(cell, Script.model_validate({"duration_s": 14.0, "step": steps}))
    simulation.run()
    force = np.array([t.arms["arm"].contact_sum for t in simulation.truths[-300:]])
    named = any(e.name == "contact_unstable" for e in simulation.events)
    return float(force.mean()), named or turns(force) > RINGING * 3.0


def turns(force):
    """Return how often a force goes from one side of its mean to the other."""
    sides = np.sign(force - force.mean()) * (np.abs(force - force.mean()) > SWING_N)
    return int(np.count_nonzero(np.diff(sides[sides != 0.0])))


@pytest.mark.parametrize("wall", WALLS)
def test_a_wall_is_told_within_two_percent_of_what_stands_there(wall):
    stiffness, damping = wall
    found, _ = told(*wall)
    assert found.stiffness == pytest.approx(1.0 / (1.0 / stiffness + 1.0 / CONTACT), rel=0.02)
    assert found.repeatability < 0.02 * found.stiffness
    assert found.damping == pytest.approx(damping, rel=0.5)
    assert 1.0 < found.delay_periods < found.model_periods


@pytest.mark.parametrize("wall", WALLS)
def test_the_proposed_gain_holds_ten_newtons_without_ringing(wall):
    force, rings = held(wall, told(*wall)[1].gain)
    assert not rings
    assert force == pytest.approx(10.0, abs=1.5)


@pytest.mark.parametrize("wall", [WALLS[0], *WALLS[2:]])
def test_twice_the_bound_rings(wall):
    found, proposed = told(*wall)
    gains = list(proposed.gain)
    gains[2] = 2.0 * proposed.bound / (found.stiffness * 0.01)
    _, rings = held(wall, gains)
    assert rings
