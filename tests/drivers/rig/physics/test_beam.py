"""The payload that arms hold in the rig: sprung grasps, pegs, and the truth about both."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.rig.physics.world import World

STIFFNESS, WEIGHT = 50_000.0, 5.0 * 9.81


@pytest.fixture(scope="module")
def cell():
    return load_cell("pa10_pair")


def settled(cell, seconds=0.4, change=None):
    """Return a world whose brakes are closed, after a while; `change` is made to it first."""
    world = World(cell)
    if change is not None:
        change(world)
    for _ in range(round(seconds / world.dt)):
        world.step(np.zeros(world.n))
    return world


def test_arms_carry_half_of_the_beam_each_and_the_pads_yield_by_it(cell):
    world = settled(cell)
    np.testing.assert_allclose(world.beam.wrenches[:, 2], WEIGHT / 2, rtol=2e-3)
    (_, _, z), _ = world.beam.pose()
    assert z == pytest.approx(0.40 - WEIGHT / 2 / STIFFNESS, abs=2e-5)
    assert world.beam.internal_force() < 0.01
    assert world.beam.stretch() < 1e-6


def test_sensors_feel_the_beam_beside_the_hand(cell):
    alone, world = settled(load_cell("pa10")), settled(cell)
    hand = np.linalg.norm(alone.sensor_wrench()[:3])
    for arm in (0, 1):
        load = world.sensor_wrench(arm)[:3]
        assert np.linalg.norm(load) == pytest.approx(hand + WEIGHT / 2, rel=5e-3)


def test_a_misfit_along_the_beam_is_internal_force(cell):
    world = settled(cell, change=lambda w: w.beam.shift(1, np.array([0.0, 1e-3, 0.0])))
    # two pads in series, between arms that their brakes hold
    assert world.beam.internal_force() == pytest.approx(STIFFNESS / 2 * 1e-3, rel=0.02)
    assert world.beam.stretch() == pytest.approx(1e-3, rel=0.02)
    assert abs(world.beam.wrenches[:, 1].sum()) < 0.1


def test_a_payload_slips_out_of_a_grasp_and_hangs_on_the_other(cell):
    world, lifted = settled(cell, change=lambda w: w.beam.let_go(1)), []
    assert not world.beam.wrenches[1].any()
    for _ in range(2000):  # it swings
        world.step(np.zeros(world.n))
        lifted.append(world.beam.wrenches[0, 2:4].copy())
    assert np.mean(lifted, axis=0) == pytest.approx([WEIGHT, -WEIGHT * 0.55], rel=0.05)


def test_pegs_know_how_deep_they_are(cell):
    world = World(cell)
    left, right = world.beam.peg_depths()
    assert (left, right) == pytest.approx((-0.010, -0.012), abs=1e-4)
