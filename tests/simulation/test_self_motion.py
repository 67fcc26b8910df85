"""Self-motion by hand: the arm angle is told, and moved while the tool stays."""

import math

import pytest
from telerobot.config.load import load_cell


@pytest.mark.parametrize("cell", ["ur5e", "planar3", "snake"])
def test_an_arm_without_an_elbow_on_a_circle_tells_no_angle(play, cell):
    assert play(seconds=0.05, cell=load_cell(cell)).states[-1].arm_angle is None


def test_each_arm_tells_its_own_angle_and_a_payload_in_their_hands_none(play):
    state = play(seconds=0.05, cell=load_cell("pa10_pair")).states[-1]
    assert state.arm_angle is not None
    other, beam = (name for name in state.tasks)
    assert state.tasks[other].arm_angle is not None
    assert state.tasks[beam].arm_angle is None
    assert math.isfinite(state.arm_angle)
