"""Arms that hold a beam turn their elbows by hand (Williams 1997, eq. 7): the beam goes its way."""

import dataclasses

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

MOVES = {
    "at_s": 0.3,
    "for_s": 2.0,
    "cmd/joystick": {"task": "beam", "twist": [-0.02, 0, 0.03, 0, 0, 0], "expressed_in": "world"},
}


def turn(mechanism, rate, for_s=1.5):
    fields = {"mechanism": mechanism, "rate": rate}
    return {"at_s": 0.4, "for_s": for_s, "cmd/self_motion": fields}


def played(*steps, seconds, at_fault=None):
    """Play steps; `at_fault` is another force that a fault may leave [N]."""
    cell = load_cell("pa10_pair")
    if at_fault is not None:
        (task,) = cell.joint_tasks
        task = task.model_copy(update={"most_internal_at_fault": at_fault})
        cell = dataclasses.replace(cell, joint_tasks=(task,))
    script = Script.model_validate({"duration_s": seconds, "step": list(steps)})
    simulation = Simulation(cell, script)
    return Run(simulation, simulation.run())


def path(run):
    return np.array([truth.beam.pose for truth in run.truths])


def angles(run, name):
    told = (state if name == "left" else state.tasks[name] for state in run.states)
    return np.array([t.arm_angle for t in told if t.arm_angle is not None])


def judged(run, beside):
    """Look that the beam is where it is without, and that nothing presses it."""
    assert run.summary["mode"] == "enabled"
    assert run.summary["refused"] == []
    off = np.abs(path(run) - beside)
    assert np.linalg.norm(off[:, :3], axis=1).max() < 1.5e-3
    assert off[:, 3:].max() < 1.5e-3
    assert max(truth.beam.internal_force for truth in run.truths) < 15.0
    assert max(truth.beam.stretch for truth in run.truths) < 0.5e-3


def test_both_elbows_turn_far_and_the_beam_stays():
    """As quickly as without the bound of a fault."""
    run = played(turn("left", -0.4, 2.5), turn("right", 0.4, 2.5), seconds=3.4, at_fault=1e5)
    judged(run, path(run)[0])
    for name in ("left", "right"):
        assert np.ptp(angles(run, name)) > 0.2


def test_what_a_fault_may_leave_slows_the_self_motion_and_not_the_beam():
    plain = played(MOVES, seconds=2.8)
    run = played(MOVES, turn("left", 0.4), turn("right", 0.4), seconds=2.8)
    judged(run, path(plain))
    assert np.ptp(path(run)[:, 2]) > 0.05
    assert 0.01 < np.ptp(angles(run, "right")) < 0.1
    assert any(n.startswith("internal_at_fault") for s in run.states for n in s.limits)


@pytest.mark.parametrize("mechanism", ["left", "right"])
def test_one_elbow_is_led_to_an_angle_and_the_other_arm_stands(mechanism):
    goal = {"at_s": 0.3, "cmd/arm_angle": {"mechanism": mechanism, "angle": 0.03}}
    run = played(goal, seconds=3.5)
    judged(run, path(run)[0])
    assert len(run.events("arm_angle_reached")) == 1
    other = {"left": "right", "right": "left"}[mechanism]
    assert angles(run, mechanism)[-1] == pytest.approx(0.03, abs=2e-3)
    assert np.ptp(angles(run, other)) < 1e-3
