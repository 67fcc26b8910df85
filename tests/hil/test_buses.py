"""Thirty joints on two buses, as real processes."""

import numpy as np
import pytest


@pytest.mark.hil
def test_a_bus_that_is_unplugged_in_motion_stops_all_thirty_joints(make_plant):
    plant = make_plant("snake30")
    operator = plant.enabled_operator()
    plant.wait_wall(lambda: operator.description is not None, "no description")
    assert {name: len(on_it) for name, on_it in operator.description.buses.items()} == {
        "tail": 15,
        "head": 16,
    }
    before = np.array(plant.truth.pose_mrf[:3])
    operator.joystick([0.05, 0.0, 0.0, 0.0, 0.0, 0.0], expressed_in="base")
    moved = lambda: np.linalg.norm(np.array(plant.truth.pose_mrf[:3]) - before)  # noqa: E731
    plant.until(lambda: moved() > 0.02, 5.0, "the arm does not move")
    plant.inject("unplug", "head")
    plant.until(lambda: operator.state.mode == "fault", 3.0, "no fault")
    plant.until(lambda: np.abs(plant.truth.dq).max() < 2e-3, 2.0, "the arm goes on")
    fault = next(e for e in operator.events if e.name == "fault")
    assert (fault.values["device"], fault.values["cause"]) == ("bus head", "bus_silent")
    assert "operation_enabled" not in plant.truth.drives
