"""An arm on a base with two driven wheels, by the physics' truth."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.simulation.simulation import simulate

WORLD = {"at_s": 0.2, "operator/frame": {"frame": "crf", "moves_with": "world"}}


@pytest.fixture(scope="module")
def rover():
    return load_cell("rover")


def test_a_base_drives_its_arm_reaches_and_the_base_follows_the_tool():
    """The shipped script: 1.2 m of arc with a stick beside, then the tool 1 m ahead in World."""
    summary = simulate("rover", "drive_and_reach").summary
    assert summary["failure"] is None
    assert summary["refused"] == []
    assert summary["limit_violations"] == 0
    assert summary["mode"] == "enabled"
    assert summary["base_travel_m"] > 2.0
    assert summary["odometry_error_m"] < 0.005
    assert summary["tool_error_m"] < 0.003


def test_the_tool_stands_in_world_while_the_base_drives_past_below():
    result = simulate("rover", "hold_in_world")
    start = next(e for e in result.summary["events"] if e["name"] == "frame_set")["t_s"] + 0.3
    poses = np.array([t.pose_mrf[:3] for t in result.truths if t.time_s > start])
    base = np.array([t.frames["base"] for t in result.truths if t.time_s > start])
    assert np.ptp(base[:, 0]) > 0.25
    assert np.ptp(base[:, 5]) > 0.35
    assert np.linalg.norm(poses - poses[0], axis=1).max() < 0.003
    assert result.summary["limit_violations"] == 0


def test_odometry_is_right_to_three_centimetres_after_five_metres_and_half_a_turn(play, rover):
    """BODIES: 5 m and 3.3 rad, by the place of the true chassis."""
    run = play(
        {"at_s": 0.2, "cmd/drive": {"rates": [0.5, 0.33]}},
        {"at_s": 10.4, "cmd/drive": {"rates": [0.0, 0.0]}},
        seconds=11.5,
        cell=rover,
    )
    assert run.summary["base_travel_m"] > 5.0
    assert np.unwrap([t.frames["base"][5] for t in run.truths])[-1] > 3.3
    assert run.summary["odometry_error_m"] < 0.03


def test_a_stop_keeps_wheels_on_their_arc(play, rover):
    """Released while it drives along an arc, the base comes to rest on that circle."""
    run = play(
        {"at_s": 0.2, "cmd/drive": {"rates": [0.4, 0.8]}},
        {"at_s": 2.5, "operator/mode": {"action": "hold"}},
        seconds=4.0,
        cell=rover,
    )
    places = np.array([t.frames["base"] for t in run.truths])
    heading = np.unwrap(places[:, 5])
    moved = np.flatnonzero(heading > 0.3)
    # The circle's centre is half a metre to the left of the base, all along.
    centre = places[:, :2] + 0.5 * np.stack((-np.sin(heading), np.cos(heading)), axis=1)
    assert run.states[-1].mode == "hold"
    assert np.ptp(places[moved[-40] :, 0]) < 1e-3
    assert np.linalg.norm(centre[moved] - centre[moved[0]], axis=1).max() < 0.004
