"""Three arms hold a plate: they share its weight, and neither press nor stretch it."""

import dataclasses

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.inputs import Intent

from .carrying import Carrying

WEIGHT = 9.0 * 9.81
TILT = [0.0, 0.03, 0.05, 0.05, 0.0, 0.06]


@pytest.fixture
def trio():
    return load_cell("pa10_trio")


def test_three_arms_carry_tilt_and_stop_a_plate(trio):
    run = Carrying(trio)
    force, stretch, place = run.run(1.0, TILT)
    assert place[-1][2] - place[0][2] > 0.03
    stopping, more, _ = run.run(0.5, intent=Intent.STOP)
    assert max(force.max(), stopping.max()) < 5.0
    assert max(stretch.max(), more.max()) < 0.5e-3
    assert run.world.beam.wrenches[:, 2].sum() == pytest.approx(WEIGHT, rel=0.02)


def test_what_an_arm_carries_is_what_its_shares_say(trio):
    dear = ((1.0,) * 6, (1.0,) * 6, (4.0,) * 6)
    task = trio.joint_tasks[0].model_copy(update={"shares": dear})
    equal, less = Carrying(trio), Carrying(dataclasses.replace(trio, joint_tasks=(task,)))
    equal.run(1.0)
    less.run(1.0)
    carried = [run.world.beam.wrenches[2, 2] for run in (equal, less)]
    assert carried[1] < 0.75 * carried[0]
    # That is meant, and no strain.
    assert less.outputs[0].holding.internal_force < 1.0


def test_a_misfit_of_one_grasp_is_melted(trio):
    run = Carrying(trio)
    run.run(0.1)
    run.world.beam.shift(2, np.array([2e-3, 0.0, 0.0]))
    force, _, _ = run.run(1.0)
    assert force[0] > 15.0
    assert force[-1] < 2.0
