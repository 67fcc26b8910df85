"""Targets that cannot be reached: slowly up to the edge, in bounds, and back at once."""

import numpy as np
import pytest

OUT_OF_REACH = {"xyz": [0.0, 0.0, 2.0], "rpy": [0.0, 0.0, 0.0], "relative_to": "mrf",
                "expressed_in": "base"}  # fmt: skip


def test_a_target_out_of_reach_is_approached_and_left_for_one_within(play):
    start = {"at_s": 0.2, "cmd/posture": {"q": [1.5, 0.25, 0.0, 2.1, 0.0, -0.78, 0.0]}}
    away = {"at_s": 3.5, "cmd/position": OUT_OF_REACH}
    run = play(start, away, {"at_s": 14.0, "cmd/position": {
        "xyz": [0.0, 0.0, -0.15], "rpy": [0.0, 0.0, 0.0], "relative_to": "mrf",
        "expressed_in": "base"}}, seconds=18.0)  # fmt: skip
    before, at_edge, leaving = run.at(3.4), run.at(13.9), run.at(15.5)
    assert at_edge.pose_mrf[2] - before.pose_mrf[2] > 0.3
    assert not at_edge.at_goal
    assert np.abs(run.speeds(13.0, 13.9)).max() < 0.5
    # One and a half seconds after the new target the tool is most of the way down.
    assert at_edge.pose_mrf[2] - leaving.pose_mrf[2] > 0.1
    assert run.states[-1].at_goal
    assert run.summary["tool_error_m"] < 1e-3
    assert run.summary["limit_violations"] == 0
    assert run.events("fault") == []


def test_a_target_beyond_a_joint_limit_keeps_the_tool_on_its_path_while_it_can(play, ur5e):
    """Six joints have no spare one: the tool slows on the straight line before it leaves it."""
    lower = ur5e.robot.joints[2].lower
    assert lower < -3.0
    run = play(
        {"at_s": 0.2, "cmd/posture": {"posture": "ready"}},
        {"at_s": 4.0, "cmd/joystick": {"twist": [-0.15, 0, 0, 0, 0, 0], "expressed_in": "base"}},
        {"at_s": 9.0, "cmd/joystick": {"twist": [0.15, 0, 0, 0, 0, 0], "expressed_in": "base"}},
        seconds=10.0,
        cell=ur5e,
    )
    assert run.summary["limit_violations"] == 0
    stuck, freed = run.at(8.9), run.at(9.9)
    assert freed.pose_mrf[0] - stuck.pose_mrf[0] > 0.05


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_pushing_against_the_edge_of_reach_never_locks_the_way_back(play, axis):
    out = [0.0, 0.0, 0.0]
    out[axis] = 0.3 if axis != 0 else -0.3  # away from the wall in front
    back = [-0.5 * v for v in out]
    run = play(
        {"at_s": 0.2, "cmd/posture": {"q": [1.5, 0.25, 0.0, 2.1, 0.0, -0.78, 0.0]}},
        {"at_s": 3.5, "cmd/joystick": {"twist": [*out, 0, 0, 0], "expressed_in": "base"}},
        {"at_s": 11.0, "cmd/joystick": {"twist": [*back, 0, 0, 0], "expressed_in": "base"}},
        seconds=13.0,
    )
    edge, home = run.at(10.9), run.at(12.9)
    sign = np.sign(back[axis])
    assert sign * (home.pose_mrf[axis] - edge.pose_mrf[axis]) > 0.1
    assert run.summary["limit_violations"] == 0
    assert run.events("fault") == []
