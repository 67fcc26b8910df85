"""Two arms on a bus each, as real processes."""

import numpy as np
import pytest

LEFT, RIGHT = slice(0, 7), slice(7, 14)


@pytest.mark.hil
def test_two_arms_move_at_once_and_the_bus_of_one_stops_both(make_plant):
    plant = make_plant("pa10_two")
    operator = plant.enabled_operator()
    plant.wait_wall(lambda: operator.description is not None, "no description")
    assert {name: len(on_it) for name, on_it in operator.description.buses.items()} == {
        "left": 8,
        "right": 8,
    }
    up = [0.0, 0.0, 0.04, 0.0, 0.0, 0.0]
    before = {name: arm.pose_mrf[2] for name, arm in plant.truth.arms.items()}
    operator.joystick(up, expressed_in="world")
    operator.task("right").joystick(up, expressed_in="world")
    risen = lambda name: plant.truth.arms[name].pose_mrf[2] - before[name]  # noqa: E731
    plant.until(lambda: min(risen("left"), risen("right")) > 0.02, 5.0, "an arm does not move")
    plant.inject("unplug", "right")
    plant.until(lambda: operator.state.mode == "fault", 3.0, "no fault")
    plant.until(lambda: np.abs(plant.truth.dq).max() < 2e-3, 2.0, "an arm goes on")
    fault = next(e for e in operator.events if e.name == "fault")
    assert (fault.values["device"], fault.values["cause"]) == ("bus right", "bus_silent")
    # Those that hear nothing any more stop by themselves, and then switch off.
    off = lambda: "operation_enabled" not in plant.truth.drives  # noqa: E731
    plant.until(off, 2.0, "a drive stays on")
