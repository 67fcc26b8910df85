"""An arm on a base with wheels, as real processes: it is driven, and its tool moves beside."""

import math

import pytest


@pytest.mark.hil
def test_the_rover_drives_an_arc_with_the_stick_beside_and_stops_on_it(make_plant):
    plant = make_plant("rover")
    operator = plant.enabled_operator()
    plant.wait_wall(lambda: operator.description is not None, "no description")
    assert operator.description.base == {"speed": 0.5, "angular_speed": 1.0}
    height = plant.truth.pose_mrf[2]
    operator.drive(0.2, 0.4)
    operator.joystick((0.0, 0.0, -0.05, 0.0, 0.0, 0.0))
    plant.until(lambda: plant.truth.frames["base"][5] > 0.5, 6.0, "it does not turn")
    plant.until(lambda: plant.truth.pose_mrf[2] < height - 0.05, 4.0, "the tool does not move")
    operator.protective_stop()
    plant.until(lambda: operator.state.mode == "hold", 2.0, "no stop")
    plant.until(lambda: max(map(abs, plant.truth.dq)) < 1e-2, 2.0, "it does not stand")
    x, y, _, _, _, yaw = plant.truth.frames["base"]
    # A circle of half a metre to the left of where it began, and odometry knows it.
    assert math.hypot(x - 0.5 * math.sin(yaw), y - 0.5 + 0.5 * math.cos(yaw)) < 0.02
    told = operator.state.frames["base"]
    assert math.dist(told[:2], (x, y)) < 0.01
