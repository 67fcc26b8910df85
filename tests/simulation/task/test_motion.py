"""Null space, schedules, paths and a clutched master, through the whole line and its physics."""

import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.config.schema.sources import ScheduleSection

AT_REST = 1e-3
"""A tool is at rest below this speed of any joint [rad/s]."""


def clean(run):
    assert run.summary["failure"] is None
    assert run.summary["limit_violations"] == 0
    assert [e.detail for e in run.simulation.events if e.severity == "error"] == []
    return run


def open_space(cell, **sections):
    return altered(cell, {"rig.wall": None, "rig.boxes": (), **sections})


def moved(run, from_s, to_s):
    return np.array(run.at(to_s).pose_mrf) - run.at(from_s).pose_mrf


def joint_speed(run, at_s):
    return np.abs(run.at(at_s).dq_command).max()


# --- the null space -------------------------------------------------------------------------------


def test_objectives_are_switched_while_running_and_the_tool_does_not_notice(play, pa10):
    run = clean(
        play(
            {"at_s": 0.2, "operator/redundancy": {"objective": "mid_range", "gain": 0.0}},
            {
                "at_s": 1.0,
                "operator/redundancy": {"objective": "posture", "gain": 2.0, "posture": "park"},
            },
            {"at_s": 3.0, "operator/redundancy": {"objective": "manipulability", "gain": 5.0}},
            {"at_s": 5.0, "operator/redundancy": {"objective": "posture", "gain": 0.0}},
            {"at_s": 5.0, "operator/redundancy": {"objective": "manipulability", "gain": 0.0}},
            seconds=7.0,
            cell=open_space(pa10),
        )
    )
    assert run.summary["refused"] == []
    assert len(run.events("objective_set")) == 5
    start = np.array(run.at(0.1).pose_mrf)
    for state in run.states[-600:]:
        assert np.linalg.norm(np.array(state.pose_mrf)[:3] - start[:3]) < 2e-3
    gain, size = run.at(4.5).objectives["posture"]
    assert gain == pytest.approx(2.0, rel=1e-3)
    assert size > 0.0
    assert np.abs(run.at(4.5).self_motion).max() > 0.0
    assert run.at(6.9).objectives["posture"] == pytest.approx((0.0, 0.0), abs=1e-4)
    assert joint_speed(run, 6.9) < AT_REST


def test_a_posture_that_the_cell_lacks_is_refused_by_name(play):
    run = play(
        {
            "at_s": 0.1,
            "operator/redundancy": {"objective": "posture", "gain": 1.0, "posture": "bed"},
        },
        seconds=0.4,
    )
    assert len(run.summary["refused"]) == 1
    assert "unknown_posture" in run.summary["refused"][0]


# --- schedules ------------------------------------------------------------------------------------


def test_a_stick_pushes_the_wall_with_the_force_that_its_schedule_leaves(play, pa10):
    soft = ScheduleSection(source="joystick", by="contact_force", at=(0.0, 10.0), factor=(1.0, 0.0))
    cell = altered(pa10, {"schedules": (soft,)})
    rate, gain = 0.0075, pa10.config.sources.force.gain[0]
    run = clean(
        play(
            {"at_s": 0.2, "cmd/joystick": {"twist": [0.05, 0, 0, 0, 0, 0], "expressed_in": "base"}},
            {"at_s": 2.6, "cmd/joystick": {"twist": [rate, 0, 0, 0, 0, 0], "expressed_in": "base"}},
            seconds=12.0,
            cell=cell,
        )
    )
    # K_F F = (1 − F/10) u: the force at which accommodation and the softened stick agree.
    expected = rate / (gain + rate / 10.0)
    assert run.summary["contact_force_n"] == pytest.approx(expected, rel=0.1)
    told = run.states[-1].gains["joystick"][0]
    assert told == pytest.approx(1.0 - expected / 10.0, abs=0.05)


# --- paths ----------------------------------------------------------------------------------------

SQUARE = [
    [0.0, 0.1, 0.0, 0.0, 0.0, 0.0],
    [-0.05, 0.1, 0.1, 0.0, 0.0, 0.2],
    [-0.05, 0.0, 0.1, 0.0, 0.0, 0.0],
]
PATH = {"waypoints": SQUARE, "relative_to": "mrf", "expressed_in": "base"}


@pytest.mark.parametrize("blend", [0.0, 0.03])
def test_a_route_ends_within_a_millimetre_of_its_last_waypoint(play, blend):
    run = clean(play({"at_s": 0.3, "cmd/path": {**PATH, "blend": blend}}, seconds=7.0))
    assert run.summary["tool_error_m"] < 1e-3
    assert run.summary["tool_error_rad"] < 2e-3
    assert run.states[-1].at_goal
    legs = [s.path["leg"] for s in run.states if s.path is not None]
    assert sorted(set(legs)) == [0, 1, 2]
    assert run.states[-1].path == {"leg": 2.0, "legs": 3.0, "part": 1.0, "pace": 1.0}


def test_a_path_is_paused_nudged_resumed_and_still_reaches_its_end(play):
    stick = {"twist": [-0.05, 0.0, 0.05, 0.0, 0.0, 0.0], "expressed_in": "base"}
    run = clean(
        play(
            {"at_s": 0.3, "cmd/path": PATH},
            {"at_s": 0.9, "operator/path": {"action": "pause"}},
            {"at_s": 2.0, "cmd/joystick": stick},
            {"at_s": 2.6, "cmd/joystick": {"twist": [0.0] * 6}},
            {"at_s": 5.0, "operator/path": {"action": "resume"}},
            {"at_s": 5.6, "cmd/joystick": stick},
            {"at_s": 6.0, "cmd/joystick": {"twist": [0.0] * 6}},
            seconds=13.0,
        )
    )
    assert run.summary["refused"] == []
    assert run.at(1.9).path["pace"] == pytest.approx(0.0, abs=5e-3)
    assert joint_speed(run, 1.9) < 0.02
    assert np.linalg.norm(moved(run, 1.9, 2.6)[:3]) > 0.02
    assert np.linalg.norm(moved(run, 1.9, 4.9)[:3]) < 2e-3
    assert run.summary["tool_error_m"] < 1e-3
    assert run.states[-1].at_goal


def test_an_aborted_path_is_gone_and_the_tool_stands(play):
    run = clean(
        play(
            {"at_s": 0.3, "cmd/path": PATH},
            {"at_s": 0.9, "operator/path": {"action": "abort"}},
            {"at_s": 1.5, "operator/path": {"action": "resume"}},
            seconds=2.5,
        )
    )
    assert len(run.summary["refused"]) == 1
    assert "no path" in run.summary["refused"][0]
    assert run.at(1.0).path is None
    assert np.linalg.norm(moved(run, 1.5, 2.4)[:3]) < 2e-3


def test_twists_bring_the_tool_as_far_as_their_times_say(play):
    path = {
        "twists": [[-0.05, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.05, 0.05, 0.0, 0.0, 0.1]],
        "durations_s": [1.0, 2.0],
        "expressed_in": "base",
    }
    run = clean(play({"at_s": 0.3, "cmd/path": path}, seconds=5.0))
    np.testing.assert_allclose(moved(run, 0.2, 4.9)[:3], [-0.05, 0.1, 0.1], atol=2e-3)
    assert run.states[-1].at_goal


def test_hold_ends_a_path(play):
    run = clean(
        play(
            {"at_s": 0.3, "cmd/path": PATH},
            {"at_s": 0.9, "operator/mode": {"action": "hold"}},
            {"at_s": 2.0, "operator/mode": {"action": "resume"}},
            seconds=3.0,
        )
    )
    assert run.states[-1].mode == "enabled"
    assert run.states[-1].path is None
    assert np.linalg.norm(moved(run, 1.9, 2.9)[:3]) < 2e-3


# --- the master -----------------------------------------------------------------------------------

HAND = {"twist": [0.0, 0.06, 0.0, 0.0, 0.0, 0.0], "expressed_in": "base"}
STILL = {"twist": [0.0] * 6, "expressed_in": "base"}
ENGAGE, FREE = {"engaged": True}, {"engaged": False}


def accelerations(run):
    return run.summary["max_acceleration_ratio"]


def test_the_tool_follows_the_hand_by_the_scale(play):
    run = clean(
        play(
            {"at_s": 0.2, "operator/clutch": ENGAGE},
            {"at_s": 0.2, "master": STILL},
            {"at_s": 0.5, "master": HAND},
            {"at_s": 1.5, "master": STILL},
            {"at_s": 2.5, "operator/clutch": {"translation": 0.25, "task": "arm"}},
            {"at_s": 3.0, "master": HAND},
            {"at_s": 4.0, "master": STILL},
            seconds=6.0,
        )
    )
    assert run.summary["refused"] == []
    np.testing.assert_allclose(moved(run, 0.4, 2.4)[:3], [0.0, 0.06, 0.0], atol=2e-3)
    # The scale changed at rest: nothing moved.
    assert np.linalg.norm(moved(run, 2.4, 2.9)[:3]) < 1e-3
    np.testing.assert_allclose(moved(run, 2.9, 5.9)[:3], [0.0, 0.015, 0.0], atol=2e-3)
    assert run.at(1.0).master["leading"] == 1.0


def test_what_the_hand_does_with_the_clutch_open_does_not_count(play):
    run = clean(
        play(
            {"at_s": 0.2, "operator/clutch": ENGAGE},
            {"at_s": 0.2, "master": HAND},
            {"at_s": 1.0, "operator/clutch": FREE},
            {"at_s": 2.5, "operator/clutch": ENGAGE},
            {"at_s": 3.5, "master": STILL},
            seconds=5.0,
        )
    )
    before, open_, after = moved(run, 0.1, 1.0), moved(run, 1.4, 2.4), moved(run, 2.4, 4.9)
    assert before[1] == pytest.approx(0.048, abs=0.015)
    assert np.linalg.norm(open_[:3]) < 1e-3
    assert after[1] == pytest.approx(0.06, abs=5e-3)
    assert run.at(1.2).master["engaged"] == 0.0


def test_scale_and_clutch_change_in_full_motion_without_a_jump(play):
    steps = [{"at_s": 0.2, "operator/clutch": ENGAGE}, {"at_s": 0.2, "master": HAND}]
    for i, scale in enumerate((2.0, 0.1, 3.0, 0.5)):
        steps.append(
            {"at_s": 0.8 + 0.3 * i, "operator/clutch": {"translation": scale, "rotation": scale}}
        )
        steps.append({"at_s": 0.9 + 0.3 * i, "operator/clutch": FREE})
        steps.append({"at_s": 1.0 + 0.3 * i, "operator/clutch": ENGAGE})
    steps.append({"at_s": 2.2, "master": STILL})
    run = clean(play(*steps, seconds=4.0))
    v = np.array([np.linalg.norm(s.sources["position"][:3]) for s in run.states])
    bound = np.sqrt(3.0) * run.simulation.cell.config.limits.acceleration
    assert (np.abs(np.diff(v)) <= 1.3 * bound * 0.01).all()
    assert accelerations(run) <= 1.0
    assert joint_speed(run, 3.9) < 5e-3


def test_a_master_that_falls_silent_lets_the_tool_stop_where_it_is(play):
    run = clean(
        play(
            {"at_s": 0.2, "operator/clutch": ENGAGE},
            {"at_s": 0.2, "master": HAND},
            {"at_s": 1.2, "silence": ["cmd/master_pose"]},
            {"at_s": 2.5, "master": HAND},
            {"at_s": 3.5, "master": STILL},
            seconds=5.0,
        )
    )
    assert [e.detail for e in run.events("stream_expired")] == ["master_pose"]
    silent = moved(run, 1.8, 2.4)
    assert np.linalg.norm(silent[:3]) < 1e-3
    # What it did meanwhile does not count: it is taken up from where it is.
    assert moved(run, 2.4, 4.9)[1] == pytest.approx(0.06, abs=5e-3)


def test_a_stick_is_clutched_and_scaled_too(play):
    stick = {"twist": [0.0, 0.05, 0.0, 0.0, 0.0, 0.2], "expressed_in": "base"}
    run = clean(
        play(
            {"at_s": 0.2, "cmd/joystick": stick},
            {"at_s": 1.0, "operator/clutch": {"translation": 0.5, "rotation": 0.0}},
            {"at_s": 2.0, "operator/clutch": FREE},
            {
                "at_s": 3.0,
                "operator/clutch": {"engaged": True, "translation": 1.0, "rotation": 1.0},
            },
            {"at_s": 4.0, "cmd/joystick": {"twist": [0.0] * 6}},
            seconds=4.5,
        )
    )
    speeds = {t: run.at(t).sources["joystick"] for t in (0.9, 1.9, 2.9, 3.9)}
    expected = {0.9: (0.05, 0.2), 1.9: (0.025, 0.0), 2.9: (0.0, 0.0), 3.9: (0.05, 0.2)}
    for t, (linear, angular) in expected.items():
        assert speeds[t][1] == pytest.approx(linear, abs=1e-6)
        assert speeds[t][5] == pytest.approx(angular, abs=1e-6)
    v = np.array([s.sources["joystick"][1] for s in run.states])
    config = run.simulation.cell.config
    bound = config.sources.joystick.braking * config.limits.acceleration
    assert (np.abs(np.diff(v)) <= 1.01 * bound * 0.01).all()


def test_another_goal_takes_over_and_the_master_waits_to_be_engaged_anew(play):
    target = {"xyz": [0.0, 0.05, 0.05], "rpy": [0, 0, 0], "relative_to": "mrf"}
    run = clean(
        play(
            {"at_s": 0.2, "operator/clutch": ENGAGE},
            {"at_s": 0.2, "master": HAND},
            {"at_s": 1.0, "cmd/position": {**target, "expressed_in": "base"}},
            {"at_s": 4.0, "operator/clutch": ENGAGE},
            {"at_s": 4.5, "master": STILL},
            seconds=6.0,
        )
    )
    assert run.at(3.9).at_goal
    assert run.at(3.9).master["leading"] == 0.0
    assert run.at(4.3).master["leading"] == 1.0
    assert moved(run, 3.9, 5.9)[1] == pytest.approx(0.03, abs=5e-3)
