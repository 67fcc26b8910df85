"""The shipped cell of two arms under its own script: both work at once, and never meet."""

import numpy as np
import pytest
from laboratory.oracle.several import Arms
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import load_script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run


@pytest.fixture(scope="module")
def run():
    cell = load_cell("pa10_two")
    simulation = Simulation(cell, load_script(cell.default_script))
    return Run(simulation, simulation.run())


def test_it_plays_without_refusal_fault_or_violation(run):
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    assert run.summary["mode"] == "enabled"
    assert [e for e in run.simulation.events if e.severity == "error"] == []
    reached = [e.values["mechanism"] for e in run.events("posture_reached")]
    assert sorted(reached) == ["left", "right"]


def test_arms_that_two_sticks_lead_together_keep_the_promise(run):
    promised = run.simulation.cell.config.avoidance.self_clearance
    true = np.array([truth.between_arms_m for truth in run.truths])
    assert promised < true.min() < promised + 0.02
    arms = Arms.of(run.simulation.cell)
    judged = [arms.between(np.array(truth.q)).distance for truth in run.truths[::20]]
    assert min(judged) > promised


def test_each_arm_ends_at_the_pose_of_its_own_task(run):
    truth = run.truths[-1]
    for part, xyz in zip(
        run.simulation.cell.parts, ((0.62, 0.10, 0.45), (0.62, -0.10, 0.45)), strict=True
    ):
        base = part.config.mechanism.T_world_base
        yaw = base.rpy[2]
        R = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        expected = R @ xyz + base.xyz
        pose = truth.arms[part.config.mechanism.name].pose_mrf
        np.testing.assert_allclose(pose[:3], expected, atol=2e-3)
