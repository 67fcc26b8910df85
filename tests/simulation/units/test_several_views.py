"""A camera of the second of two arms: its view is found, stored, kept and judged on that arm."""

import numpy as np
import pytest
from telerobot.config.load import load_cell

pytestmark = pytest.mark.usefixtures("rendering")

LOOK = """
[[tasks]]
name = "look"
by = ["right"]
[[tasks.cameras]]
name = "wrist"
T_wrist_lens = { xyz = [-0.075, 0.0, 0.03], rpy = [0.0, 0.0, -1.5707963] }
size = [480, 360]
focal = [420.0, 420.0]
rate_hz = 20.0
latency_s = 0.06
tag = 7
tag_size = 0.1
[[rig.tags]]
name = "panel"
T_world_tag = { xyz = [1.16, 0.0, 0.48], rpy = [1.5707963, 0.0, -1.5707963] }
tag = 7
size = 0.1
"""
AWAY = {"task": "look", "twist": [0.0, 0.06, 0.04, 0.0, 0.0, 0.1], "expressed_in": "base"}


@pytest.fixture
def cell(two_arms):
    return load_cell(two_arms(like=("pa10", "pa10_vision"), bases=(1.6, ""), more=LOOK))


def test_the_view_of_one_arms_camera_is_kept_by_that_arm(play, cell):
    run = play(
        {"at_s": 0.3, "cmd/posture": {"mechanism": "right", "posture": "ready"}},
        {"at_s": 2.4, "operator/store_view": {"camera": "wrist"}},
        {"at_s": 2.6, "operator/switch": {"task": "look", "source": "vision", "on": True}},
        {"at_s": 2.8, "cmd/joystick": AWAY},
        {"at_s": 4.0, "cmd/joystick": {**AWAY, "twist": [0.0] * 6}},
        seconds=8.0,
        cell=cell,
    )
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    assert run.events("view_found")[0].values["mechanism"] == "right"
    start = run.simulation.player.start_s
    pushed = [t for t in run.truths if 3.5 < t.time_s - start < 4.0]
    assert max(run.simulation.view.error(t)[0] for t in pushed) > 0.02
    assert run.summary["view_error_m"] < 3e-3
    assert run.summary["view_error_rad"] < np.radians(0.6)
    left = np.array([t.q[:7] for t in run.truths if t.time_s - start > 0.5])
    assert np.ptp(left, axis=0).max() < 1e-3


def test_a_camera_that_nobody_has_is_refused_by_those_of_all_tasks(play, cell):
    run = play(
        {"at_s": 0.3, "operator/store_view": {"camera": "wirst"}},
        {"at_s": 0.3, "operator/store_view": {"task": "left", "camera": "wrist"}},
        seconds=0.6,
        cell=cell,
    )
    first, second = run.summary["refused"]
    assert "unknown_camera: 'wirst' is none of wrist" in first
    assert "unknown_camera: 'wrist' is none of none" in second
