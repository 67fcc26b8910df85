"""Two arms with a task each in one daemon: what each is told, what concerns both, and faults."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

SCREW = """
[[tasks]]
name = "screw"
by = ["right"]
[rig]
tool_radius = 0.0
"""
LEFT, RIGHT = slice(0, 7), slice(7, 13)
UP = {"twist": [0.0, 0.0, 0.05, 0.0, 0.0, 0.0], "expressed_in": "world"}
TOGETHER = [
    {"at_s": 0.2, "cmd/joystick": {"twist": [0, -0.2, 0, 0, 0, 0], "expressed_in": "world"}},
    {"at_s": 0.2, "cmd/joystick": {"task": "screw", "twist": [0, 0.2, 0, 0, 0, 0],
                                   "expressed_in": "world"}},
]  # fmt: skip


@pytest.fixture(scope="module")
def pair(two_arms):
    return load_cell(two_arms(bases=(0.55, -0.45), more=SCREW))


def reached(run, joints):
    """Return how far joints were moved by their command [rad]."""
    q = np.array([s.q_command for s in run.states])[:, joints]
    return np.abs(q[-1] - q[0]).max()


def test_each_stick_leads_the_arm_of_the_task_that_it_names(play, pair):
    run = play({"at_s": 0.2, "cmd/joystick": {"task": "screw", **UP}}, seconds=1.5, cell=pair)
    assert run.summary["limit_violations"] == 0
    assert reached(run, LEFT) < 1e-4
    before, after = run.at(0.1).tasks["screw"], run.at(1.4).tasks["screw"]
    assert after.pose_mrf[2] - before.pose_mrf[2] > 0.03
    run = play({"at_s": 0.2, "cmd/joystick": UP}, seconds=1.5, cell=pair)
    assert reached(run, RIGHT) < 1e-4
    assert run.at(1.4).pose_mrf[2] - run.at(0.1).pose_mrf[2] > 0.03


def test_two_sticks_lead_both_at_once_and_the_arms_never_meet(play, pair):
    run = play(*TOGETHER, seconds=6.0, cell=pair)
    assert (run.summary["failure"], run.summary["limit_violations"]) == (None, 0)
    assert min(reached(run, LEFT), reached(run, RIGHT)) > 0.1
    promised = pair.config.avoidance.self_clearance
    assert promised - 1e-3 < run.summary["min_between_arms_m"] < 0.1
    assert run.states[-1].mode == "enabled"
    between = [
        g for s in run.states for g in s.gaps if g[3] and {g[0][:4], g[1][:4]} == {"left", "righ"}
    ]
    assert between, "no barrier between the arms ever acted: the run shows nothing"


def test_goals_jog_posture_and_settings_are_for_one_arm(play, pair):
    park = list(pair.parts[1].config.mechanism.postures["park"])
    run = play(
        {"at_s": 0.2, "cmd/posture": {"mechanism": "right", "posture": "park"}},
        {"at_s": 0.2, "operator/gain": {"task": "screw", "source": "joystick", "gain": [0.5] * 6}},
        {"at_s": 0.2, "cmd/jog": {"mechanism": "left", "rates": [0.1] + [0.0] * 6}},
        seconds=6.0,
        cell=pair,
    )
    assert run.summary["refused"] == []
    np.testing.assert_allclose(run.states[-1].q_command[RIGHT], park, atol=1e-3)
    assert [e.values["mechanism"] for e in run.events("posture_reached")] == ["right"]
    assert run.states[-1].q_command[0] - run.states[0].q_command[0] > 0.3
    assert run.states[-1].gains["joystick"] != run.states[-1].tasks["screw"].gains["joystick"]


def test_cancel_without_a_name_drops_the_goals_of_all(play, pair):
    goal = {"xyz": [0.0, 0.0, 0.2], "rpy": [0, 0, 0], "relative_to": "mrf"}
    run = play(
        {"at_s": 0.2, "cmd/position": goal},
        {"at_s": 0.2, "cmd/position": {"task": "screw", **goal}},
        {"at_s": 0.6, "cmd/cancel": {}},
        seconds=1.5,
        cell=pair,
    )
    assert None not in (run.at(0.5).target_mrf, run.at(0.5).tasks["screw"].target_mrf)
    assert (run.at(0.7).target_mrf, run.at(0.7).tasks["screw"].target_mrf) == (None, None)


def test_names_that_the_cell_does_not_have_are_refused_with_those_that_it_has(play, pair):
    run = play(
        {"at_s": 0.2, "cmd/joystick": {"task": "right", **UP}},
        {"at_s": 0.2, "operator/tare": {"mechanism": "middle"}},
        {"at_s": 0.3, "silence": ["cmd/joystick"]},
        {"at_s": 1.8, "cmd/jog": {"mechanism": "right", "rates": [0.1] * 7}},
        seconds=2.0,
        cell=pair,
    )
    refused = {e.values["topic"]: e for e in run.events("command_refused")}
    assert refused["cmd/joystick"].values["reason"] == "unknown_task"
    assert "left, screw" in refused["cmd/joystick"].detail
    assert refused["cmd/jog"].values["reason"] == "wrong_joints"
    assert (
        "unknown_mechanism: mechanism 'middle' is none of: left, right" in run.summary["refused"][0]
    )
    assert max(reached(run, LEFT), reached(run, RIGHT)) < 1e-4


FAULTS = {
    "a drive of one arm falls silent": {"kind": "silence", "target": "right.w1"},
    "a drive of one arm faults": {"kind": "fault", "target": "left.e1"},
    "the other arm's bus is unplugged": {"kind": "unplug", "target": "other"},
    "a drive of one arm is reset alone": {"kind": "restart", "target": "right.elbow"},
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_a_fault_of_one_arm_stops_both(play, pair, fault):
    run = play(*TOGETHER, {"at_s": 1.0, "rig/fault": fault}, seconds=2.0, cell=pair)
    assert run.summary["mode"] == "fault"
    told = run.events("fault")[0]
    assert told.values["device"] in (fault["target"], f"bus {fault['target']}")
    assert told.time_s - run.simulation.player.start_s < 1.1
    assert np.abs(run.speeds(1.6, 2.0)).max() < 1e-3
    assert not any(s == "operation_enabled" for s in run.truths[-1].drives)


def test_after_the_fault_of_one_both_are_reset_and_driven_again(play, pair):
    fault = {"kind": "fault", "target": "right.elbow"}
    run = play(
        *TOGETHER,
        {"at_s": 0.6, "rig/fault": fault},
        {"at_s": 1.2, "rig/fault": {**fault, "on": False}},
        {"at_s": 1.5, "operator/mode": {"action": "reset"}},
        {"at_s": 3.5, "operator/mode": {"action": "enable"}},
        seconds=5.5,
        cell=pair,
    )
    assert (run.summary["failure"], run.summary["refused"]) == (None, [])
    assert run.events("fault")
    assert run.summary["mode"] == "enabled"
    assert np.abs(run.states[-1].dq_command).max() > 0.01, "both sticks are still held"


@pytest.mark.parametrize("essential", [True, False])
def test_a_stale_sensor_of_one_arm_holds_both_where_that_arm_needs_it(play, pair, essential):
    silent = {"kind": "silence", "target": "left.force_torque"}
    run = play(
        *TOGETHER,
        {"at_s": 0.8, "rig/fault": silent},
        seconds=2.0,
        cell=altered(pair, {"mechanism.force_torque.essential": essential}),
    )
    assert run.summary["failure"] is None
    assert [e.values["mechanism"] for e in run.events("sensor_stale")] == ["left"]
    assert run.states[-1].mode == ("hold" if essential else "enabled")
    for joints in (LEFT, RIGHT):
        stands = np.abs(run.speeds(1.7, 2.0)[:, joints]).max() < 1e-3
        assert stands == essential


def test_the_description_names_every_task_and_its_joints(pair):
    from telerobot.server.telemetry import describe

    told = describe(pair)
    assert [(x.task, x.mechanism, len(x.joints)) for x in told.each] == [
        ("left", "left", 7), ("screw", "right", 6),
    ]  # fmt: skip
    assert told.of("screw").joints[0].startswith("right.")
    with pytest.raises(ValueError, match="is none of left, screw"):
        told.of("right")


def test_the_same_run_gives_the_same_frames_again(pair):
    made = Script.model_validate({"duration_s": 1.0, "step": TOGETHER})
    first, again = (Simulation(pair, made).run().summary["command_hash"] for _ in range(2))
    assert first == again
