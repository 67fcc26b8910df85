"""Two arms that hold a beam, as real processes."""

import numpy as np
import pytest


@pytest.mark.hil
def test_two_arms_carry_a_beam_and_the_fault_of_one_stops_both(make_plant):
    plant = make_plant("pa10_pair")
    operator = plant.enabled_operator()
    beam = operator.task("beam")
    before = np.array(plant.truth.beam.pose[:3])
    beam.joystick([-0.04, 0.0, 0.04, 0.0, 0.0, 0.0], expressed_in="world")
    risen = lambda: plant.truth.beam.pose[2] - before[2]  # noqa: E731
    plant.until(lambda: risen() > 0.02, 5.0, "the beam does not rise")
    assert operator.state.held_by == operator.state.tasks["right"].held_by == "beam"
    assert plant.truth.beam.internal_force < 10.0
    plant.inject("fault", "right.e1")
    plant.until(lambda: operator.state.mode == "fault", 3.0, "no fault")
    plant.until(lambda: np.abs(plant.truth.dq).max() < 2e-3, 2.0, "an arm goes on")
    assert "operation_enabled" not in plant.truth.drives
