"""Thirty drives on two buses, as real processes: an arm goes into its tunnel and out of it."""

import pytest


@pytest.mark.hil
def test_the_snake_is_inserted_to_a_depth_driven_out_and_touches_no_wall(make_plant):
    plant = make_plant("snake")
    operator = plant.enabled_operator()
    plant.wait_wall(lambda: operator.description is not None, "no description")
    assert operator.description.insertion["speed"] == pytest.approx(0.08)
    assert {name: len(on_it) for name, on_it in operator.description.buses.items()} == {
        "tail": 15,
        "head": 16,
    }
    depth = lambda: (operator.state.insertion or {}).get("depth", 0.0)  # noqa: E731
    operator.insert(0.25, speed=0.05)
    plant.until(lambda: depth() > 0.249, 6.0, "it is not inserted")
    plant.until(lambda: operator.state.at_goal, 2.0, "it does not arrive")
    operator.drive(-0.05)
    plant.until(lambda: depth() < 0.22, 3.0, "it does not withdraw")
    operator.protective_stop()
    plant.until(lambda: operator.state.mode == "hold", 2.0, "no stop")
    assert plant.truth.clearance_m > 0.008
    assert plant.truth.contact_force == (0.0, 0.0, 0.0)
