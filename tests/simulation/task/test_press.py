"""What a stick or a goal leads into is pressed no harder than the cell's bound; by the physics."""

from dataclasses import replace

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell

READY = {"at_s": 0.0, "cmd/posture": {"posture": "ready"}}
BOUND_N = 100.0
"""`most_press` of a cell that says nothing of it [N]."""
LAST_S = 1.0
"""So long a force has to have settled [s]."""


def stick(*v, at_s=2.6):
    twist = [*v, 0.0, 0.0, 0.0]
    return {"at_s": at_s, "cmd/joystick": {"twist": twist, "expressed_in": "base"}}


def pressed(run):
    """Return the size of the true force in the last second (k,) [N]."""
    last_s = run.truths[-1].time_s - LAST_S
    return np.array([np.linalg.norm(t.contact_force) for t in run.truths if t.time_s > last_s])


def settled(run, force, within=0.03):
    """Say that the arm is enabled, and presses steadily with a force [N]."""
    assert run.summary["failure"] is None
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    found = pressed(run)
    assert found.mean() == pytest.approx(force, rel=within)
    assert np.ptp(found) < 0.05 * force


@pytest.mark.parametrize("v", [0.1, 0.25])
def test_a_fast_stick_presses_a_wall_with_the_bound_and_no_more(play, v):
    """It would press with K_HC u / K_F: 133 and 333 N."""
    run = play(READY, stick(v, 0.0, 0.0), seconds=6.0)
    settled(run, BOUND_N)
    assert "press" in run.states[-1].limits


def test_a_slow_stick_presses_as_it_did(play, pa10):
    run = play(READY, stick(0.05, 0.0, 0.0), seconds=6.0)
    settled(run, 0.05 / pa10.config.sources.force.gain[0])
    assert not any("press" in state.limits for state in run.states)


def test_another_bound_is_the_cells_to_say(play, pa10):
    cell = altered(pa10, {"sources.force.most_press": 40.0})
    settled(play(READY, stick(0.1, 0.0, 0.0), seconds=6.0, cell=cell), 40.0)


def test_a_tool_that_is_led_along_the_wall_as_well_slides_on_and_does_not_chatter(play):
    """Without the bound it went up to 350 N, until the sensor was saturated."""
    run = play(READY, stick(0.1, 0.2, 0.0), seconds=4.4)
    assert run.summary["mode"] == "enabled"
    sizes = np.array([np.linalg.norm(truth.contact_force) for truth in run.truths])
    touched = int(np.argmax(sizes > 0.0))
    found, slid = sizes[touched + 30 : touched + 70], run.states[touched + 30 : touched + 70]
    assert found.max() < 1.1 * BOUND_N
    touching = found[found > 0.0]  # single steps of physics are without contact as it slides
    assert len(touching) > 0.75 * len(found)
    assert touching.std() < 0.2 * touching.mean()
    assert slid[-1].pose_mrf[1] - slid[0].pose_mrf[1] > 0.01


def test_what_an_operator_wants_to_press_with_comes_beside(play):
    wanted = {"wrench": [30.0, 0.0, 0.0, 0.0, 0.0, 0.0], "expressed_in": "world"}
    run = play(READY, stick(0.2, 0.0, 0.0), {"at_s": 4.5, "cmd/force": wanted}, seconds=7.0)
    assert run.summary["refused"] == []
    settled(run, BOUND_N + 30.0)


def test_a_goal_behind_the_wall_presses_no_harder(play):
    goal = {"xyz": [0.4, 0, 0], "rpy": [0, 0, 0], "relative_to": "mrf", "expressed_in": "base",
            "speed": 0.25}  # fmt: skip
    run = play(READY, {"at_s": 2.6, "cmd/position": goal}, seconds=7.0)
    settled(run, BOUND_N)  # without the bound 362 N


def test_a_tool_that_leaves_the_wall_is_led_away_as_fast_as_ever(play):
    free = play(READY, stick(-0.25, 0.0, 0.0, at_s=4.0), seconds=4.6)
    run = play(READY, stick(0.25, 0.0, 0.0), stick(-0.25, 0.0, 0.0, at_s=4.0), seconds=4.6)
    speeds = [each.at(4.5).pose_mrf[0] - each.at(4.4).pose_mrf[0] for each in (free, run)]
    assert speeds[1] == pytest.approx(speeds[0], rel=0.02)


def test_a_beam_is_pressed_into_its_nodes_by_no_stick_as_hard_as_its_speed_would_have_it(play):
    """A page's stick of 50 mm/s: it pressed with 300 N, until a sensor was saturated."""
    at = {"task": "beam", "twist": [0.05, 0, 0, 0, 0, 0], "expressed_in": "world"}
    run = play(
        {"at_s": 0.1, "for_s": 3.0, "cmd/joystick": at}, seconds=3.0, cell=load_cell("pa10_pair")
    )
    assert run.summary["mode"] == "enabled"
    net = np.array([np.linalg.norm(t.beam.push) for t in run.truths])
    assert net.max() < 1.4 * BOUND_N
    assert "press" in run.at(2.9).tasks["beam"].limits


def test_what_speeds_up_a_heavy_payload_is_no_pressing(play):
    """The grasps tell it as contact: 18 kg at 2 m/s² are beyond a quarter of the bound."""
    pair = load_cell("pa10_pair")
    (task,) = pair.joint_tasks
    heavy = task.payload.model_copy(update={"mass": 18.0})
    cell = replace(
        altered(pair, {"rig.beam.mass": 18.0}),
        joint_tasks=(task.model_copy(update={"payload": heavy, "most_internal_at_fault": 400.0}),),
    )
    back = {"task": "beam", "twist": [-0.2, 0, 0, 0, 0, 0], "expressed_in": "world"}
    run = play({"at_s": 0.1, "for_s": 1.0, "cmd/joystick": back}, seconds=1.2, cell=cell)
    assert run.summary["failure"] is None
    contact = [np.linalg.norm(state.tasks["beam"].wrench_mrf[:3]) for state in run.states[5:]]
    assert max(contact) > 0.25 * BOUND_N, "it looks like contact"
    assert not any("press" in state.tasks["beam"].limits for state in run.states)
