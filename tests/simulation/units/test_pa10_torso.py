"""Two arms on one torso, by the physics: far goals, a tool that stands, limits, stops, faults."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

SHOULDER, WRIST, ARM = 0.315, 0.201, 0.95
"""Of a PA-10: floor to shoulder, wrist to tool, shoulder to wrist stretched out [m]."""


@pytest.fixture(scope="module")
def cell():
    return load_cell("pa10_torso")


@pytest.fixture(scope="module")
def run(cell):
    simulation = Simulation(cell, load_script(cell.default_script))
    return Run(simulation, simulation.run())


def tool(run, name):
    """Return where a tool truly is (k, 6), tick by tick."""
    return np.array([truth.arms[name].pose_mrf for truth in run.truths])


def torso(run):
    """Return where yaw and lift truly are (k, 2) [rad], [m]."""
    return np.array([truth.q[:2] for truth in run.truths])


def told(run, name):
    """Return the state of a task, tick by tick."""
    states = run.states[-len(run.truths) :]
    return [state.tasks.get(name, state) for state in states]


def arrived(run, name):
    return next(i for i, state in enumerate(told(run, name)) if state.at_goal and state.target_mrf)


def off(run, name, start, end):
    """Return how far a tool came from where it was between two ticks [m]."""
    places = tool(run, name)[start:end, :3]
    return np.linalg.norm(places - places[0], axis=1).max()


def test_it_plays_without_refusal_fault_or_violation(run):
    assert run.result.ok, [str(row) for row in run.result.expected if not row.met]
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    assert [e for e in run.simulation.events if e.severity == "error"] == []


def reach(yaw, lift, side, goal):
    """Return how far an arm's wrist is from its shoulder, with a tool that points ahead [m]."""
    y = 0.3 * side
    shoulder = [-y * np.sin(yaw), y * np.cos(yaw), 0.65 + lift + SHOULDER]
    return np.linalg.norm(np.array(goal) - [WRIST, 0.0, 0.0] - shoulder)


def test_each_goal_is_farther_than_the_arm_reaches_from_where_the_torso_stood(run):
    for name, side in (("left", 1.0), ("right", -1.0)):
        there = max(i for i, s in enumerate(told(run, name)) if s.target_mrf)
        goal = told(run, name)[there].target_mrf[:3]
        yaw, lift = torso(run)[0]
        assert reach(yaw, lift, side, goal) > ARM + 0.01
        when = np.abs(tool(run, name)[:, :3] - goal).max(axis=1).argmin()
        assert np.linalg.norm(tool(run, name)[when, :3] - goal) < 1e-3
        assert reach(*torso(run)[when], side, goal) < ARM + 1e-3


def test_one_tool_stands_while_the_other_takes_the_torso_along(run):
    """The lift goes up by 0.2 m under the right tool, which holds its place."""
    start, there = run_index(run, 3.0), arrived(run, "left")
    assert np.ptp(torso(run)[start:there, 1]) > 0.2
    assert off(run, "right", start, there) < 1e-3


def run_index(run, script_s):
    start = run.simulation.player.start_s
    return next(i for i, t in enumerate(run.truths) if t.time_s - start >= script_s)


def test_a_torso_that_is_driven_goes_below_tools_that_stay(run):
    twists = np.array([s.sources["joystick"] for s in told(run, "torso")])
    driven = np.flatnonzero(np.abs(twists).max(axis=1) > 0.02)
    first, last = int(driven[0]), int(driven[-1])
    way = torso(run)[last] - torso(run)[first]
    assert way[0] == pytest.approx(-0.1 * (last - first) * 0.01, rel=0.15)
    for name in ("left", "right"):
        assert off(run, name, first, last) < 4e-3


STICKS = [
    # opposite demands: one up, one down
    {"at_s": 0.3, "for_s": 1.5, "cmd/joystick": {"task": "left", "twist": [0, 0, 0.1, 0, 0, 0]}},
    {"at_s": 0.3, "for_s": 1.5, "cmd/joystick": {"task": "right", "twist": [0, 0, -0.1, 0, 0, 0]}},
    # and at each other, until a stop
    {"at_s": 2.2, "for_s": 3.5, "cmd/joystick": {"task": "left", "twist": [0, -0.2, 0, 0, 0, 0]}},
    {"at_s": 2.2, "for_s": 3.5, "cmd/joystick": {"task": "right", "twist": [0, 0.2, 0, 0, 0, 0]}},
    {"at_s": 5.0, "operator/protective_stop": {}},
]


def play(cell, steps, seconds):
    made = Script.model_validate({"duration_s": seconds, "step": steps})
    simulation = Simulation(cell, made)
    return Run(simulation, simulation.run())


def test_opposite_demands_leave_the_torso_and_arms_that_meet_keep_clear(cell):
    steps = [dict(step) for step in STICKS]
    for step in steps[:4]:
        step["cmd/joystick"] = {**step["cmd/joystick"], "expressed_in": "world"}
    run = play(cell, steps, 6.0)
    promised = cell.config.avoidance.self_clearance
    between = np.array([truth.between_arms_m for truth in run.truths])
    way = tool(run, "left")[run_index(run, 2.0)] - tool(run, "left")[run_index(run, 0.3)]
    assert way[2] > 0.1
    assert np.abs(np.diff(torso(run)[[run_index(run, 0.3), run_index(run, 2.0)], 1])) < 0.02
    assert run.summary["own_contact_n"] == 0.0
    assert promised < between.min() < promised + 0.05
    assert run.summary["mode"] == "hold"
    assert np.abs(run.speeds(5.8, 6.0)).max() < 1e-3
    assert run.summary["limit_violations"] == 0


@pytest.mark.parametrize("target", ["torso.lift", "torso.yaw"])
def test_a_fault_of_a_drive_of_the_torso_stops_both_arms(cell, target):
    steps = [
        {
            "at_s": 0.2,
            "for_s": 1.6,
            "cmd/joystick": {"task": name, "twist": [0, 0, 0.1, 0, 0, 0], "expressed_in": "world"},
        }
        for name in ("left", "right")
    ]
    run = play(cell, [*steps, {"at_s": 1.2, "rig/fault": {"kind": "fault", "target": target}}], 2.0)
    assert run.summary["mode"] == "fault"
    assert run.events("fault")[0].values["device"] == target
    assert np.abs(run.speeds(1.0, 1.2)).max() > 0.05
    assert np.abs(run.speeds(1.8, 2.0)).max() < 2e-3
    assert not any(s == "operation_enabled" for s in run.truths[-1].drives)


@pytest.mark.parametrize("pushed", ["left", "right"])
def test_a_push_at_an_elbow_is_felt_while_the_torso_turns_both_arms(cell, pushed):
    lead = {"twist": [0.0, 0.08, 0.05, 0.0, 0.0, 0.0], "expressed_in": "world"}
    push = {"kind": "push", "target": f"{pushed}.e1", "vector": [0.0, 0.0, -40.0]}
    steps = [
        {"at_s": 0.3, "cmd/joystick": {**lead, "task": "left"}},
        {"at_s": 0.3, "cmd/joystick": {**lead, "task": "right"}},
        {"at_s": 2.0, "rig/fault": push},
    ]
    script = Script.model_validate({"duration_s": 3.5, "step": steps})
    simulation = Simulation(cell, script)
    run = Run(simulation, simulation.run())
    (felt,) = run.events("touched")
    assert felt.values["joint"].startswith(f"{pushed}.")
    assert 2.0 < felt.time_s - simulation.player.start_s < 3.0
    assert (np.abs(run.speeds(1.9, 2.0)[:, :2]) > 0.02).all()
    assert run.summary["mode"] == "hold"
    assert run.summary["limit_violations"] == 0
