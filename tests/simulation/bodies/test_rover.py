"""An arm on a base with two driven wheels, by the physics' truth."""

import numpy as np
import pytest
from pydantic import TypeAdapter
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.surroundings import MovingFrameSection, ObstacleSection
from telerobot.tools.simulation.simulation import simulate


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


def with_frames(cell, rig=None, **frames):
    """Return the rover with news of where it is."""
    told = MovingFrameSection(
        speed=1.0, angular_speed=2.0, acceleration=3.0, angular_acceleration=6.0
    )
    cell = altered(cell, {"base": told, **frames}, "frames")
    return altered(cell, rig or {}, "rig.frames")


def test_wheels_that_slip_are_told_and_news_brings_the_odometry_back(play, rover):
    ice = [
        {"at_s": 0.3, "rig/fault": {"kind": "slip", "target": f"wheel_{side}", "value": 0.01}}
        for side in ("left", "right")
    ]
    grip = [
        {"at_s": 2.0, "rig/fault": {"kind": "slip", "target": f"wheel_{side}", "on": False}}
        for side in ("left", "right")
    ]
    drive = {"at_s": 0.4, "cmd/drive": {"rates": [0.4, 0.0]}}
    stand = {"at_s": 2.0, "cmd/drive": {"rates": [0.0, 0.0]}}
    blind = play(*ice, drive, *grip, stand, seconds=4.0, cell=rover)
    assert blind.summary["odometry_error_m"] > 0.2
    assert blind.events("wheels_slip") == []
    run = play(*ice, drive, *grip, stand, seconds=12.0, cell=with_frames(rover))
    (slip,) = run.events("wheels_slip")
    assert slip.values["distance_m"] > 0.05
    assert "not held in World" in slip.detail
    assert len(run.events("wheels_grip")) == 1
    assert run.summary["odometry_error_m"] < 0.01
    assert run.summary["limit_violations"] == 0


def test_a_gyroscope_corrects_the_heading_that_one_slipping_wheel_spoils(play, rover):
    steps = [
        {"at_s": 0.3, "rig/fault": {"kind": "slip", "target": "wheel_left", "value": 0.005}},
        {"at_s": 0.4, "cmd/drive": {"rates": [0.2, 0.0]}},
        {"at_s": 2.0, "cmd/drive": {"rates": [0.0, 0.0]}},
    ]
    blind = play(*steps, seconds=4.0, cell=rover)
    gyroscope = {"gyroscope": True, "gyroscope_bias": 0.001}
    cell = altered(rover, {"mechanism.base.correction": (0.05, 0.5)})
    run = play(*steps, seconds=4.0, cell=with_frames(cell, gyroscope))
    assert blind.summary["odometry_error_rad"] > 0.05
    assert run.summary["odometry_error_rad"] < 0.012


def test_a_wheel_that_is_blocked_ends_in_a_fault_and_the_base_stands(play, rover):
    run = play(
        {"at_s": 0.3, "cmd/drive": {"rates": [0.3, 0.0]}},
        {"at_s": 1.5, "rig/fault": {"kind": "block", "target": "wheel_left"}},
        seconds=3.5,
        cell=rover,
    )
    (fault,) = run.events("fault")
    assert run.summary["mode"] == "fault"
    assert "wheel_left" in fault.detail
    assert "leash:wheel_left" in {limit for state in run.states for limit in state.limits}
    places = np.array([t.frames["base"][:2] for t in run.truths[-50:]])
    assert np.ptp(places, axis=0).max() < 1e-3


def test_counts_of_wheels_wrap_and_nobody_notices(play, rover):
    """2e8 counts per radian: 32 bits are 10.7 rad, 1.3 m, which are driven twice over."""
    drives = tuple(
        d.model_copy(update={"counts_per_radian": 2e8}) if d.joint.startswith("wheel") else d
        for d in rover.config.mechanism.drives
    )
    cell = altered(rover, {"mechanism.drives": drives})
    run = play(
        {"at_s": 0.2, "cmd/drive": {"rates": [0.5, 0.0]}},
        {"at_s": 6.0, "cmd/drive": {"rates": [0.0, 0.0]}},
        seconds=7.0,
        cell=cell,
    )
    assert run.truths[-1].q[0] > 2 * 10.7
    assert run.states[-1].q[0] == pytest.approx(run.truths[-1].q[0], abs=1e-3)
    assert run.summary["mode"] == "enabled"
    assert run.summary["base_travel_m"] == pytest.approx(0.5 * 5.8, abs=0.1)
    assert run.summary["odometry_error_m"] < 0.005
    assert run.summary["limit_violations"] == 0


def test_a_base_that_drives_at_a_box_stops_short_of_it(play, rover):
    """The verified stop rolls out the base: at full speed the promised clearance is kept."""
    box = {
        "name": "crate", "shape": "box", "xyz": [2.0, 0.1, 0.3], "half_size": [0.2, 0.4, 0.3],
        "clearance": 0.05,
    }  # fmt: skip
    obstacle = TypeAdapter(ObstacleSection).validate_python(box)
    cell = altered(rover, {"obstacles": (obstacle,), "avoidance.enabled": True})
    run = play(
        {"at_s": 0.3, "cmd/drive": {"rates": [0.5, 0.05]}},
        seconds=7.0,
        cell=cell,
    )
    assert run.summary["base_travel_m"] > 0.8
    assert 0.045 < run.summary["min_clearance_m"] < 0.12
    assert run.summary["mode"] == "enabled"
    # It is slowed on its arc, not turned off it.
    base = np.array([t.frames["base"] for t in run.truths])
    moves = np.diff(base[:, 0]) > 1e-3
    curvature = np.diff(base[:, 5])[moves] / np.diff(base[:, 0])[moves]
    assert np.abs(curvature - 0.1).max() < 0.03


def test_news_of_base_is_refused_by_name_where_the_cell_does_not_ask_for_it(play, rover):
    """A pose wants the cell's word on how far it is believed; a heading alone does not."""
    pose = {"name": "base", "xyz": [0.1, 0.0, 0.0], "rpy": [0.0, 0.0, 0.02]}
    run = play(
        {"at_s": 0.1, "sensor/frame": pose},
        {"at_s": 0.2, "sensor/frame": pose | {"heading": True}},
        seconds=0.5,
        cell=rover,
    )
    (refused,) = run.events("command_refused")
    assert "takes poses where the cell has [frames.base]" in refused.detail
    assert run.states[-1].frames["base"][5] > 0.001  # a heading corrects the odometry
