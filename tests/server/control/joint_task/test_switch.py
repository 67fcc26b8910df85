"""Joint and separate tasks, changed at rest; grasps that do not fit."""

import numpy as np
import pytest
from telerobot.config.errors import ConfigError
from telerobot.server.control.inputs import Intent
from telerobot.server.control.joint_task.joint_task import HoldRefused, held_together, let_go
from telerobot.server.control.tick import Control

from .carrying import Carrying, pair

SIDEWAYS = [0, 0.05, 0, 0, 0, 0]


@pytest.fixture
def run(tmp_path):
    return Carrying(pair(tmp_path))


def each(run):
    return [run.world.q[part].copy() for part in run.control.parts]


def test_arms_let_go_of_each_other_at_rest_and_hold_together_again(run):
    task = run.control.joint.tasks[0]
    run.run(0.2, intent=Intent.HOLD)
    run.memory = let_go(task, run.memory)
    assert not task.on(run.memory.arms)
    assert run.tick(intent=Intent.HOLD)[0].held is None
    run.run(0.2, intent=Intent.HOLD)
    run.memory = held_together(task, run.memory, each(run))
    force, _, place = run.run(0.5, SIDEWAYS)
    assert all(output.holding.task == "beam" for output in run.outputs)
    assert place[-1][1] - place[0][1] > 0.01
    assert force.max() < 5.0


def test_nothing_jumps_when_arms_hold_together(run):
    task = run.control.joint.tasks[0]
    run.run(0.2, intent=Intent.HOLD)
    run.memory = let_go(task, run.memory)
    run.run(0.05, intent=Intent.HOLD)
    before = run.tick(intent=Intent.HOLD)
    run.memory = held_together(task, run.memory, each(run))
    after = run.tick(intent=Intent.HOLD)
    for b, a in zip(before, after, strict=True):
        np.testing.assert_allclose(a.q, b.q, atol=1e-9)


def test_arms_in_motion_neither_take_hold_nor_let_go(run):
    run.run(0.3, SIDEWAYS)
    task = run.control.joint.tasks[0]
    with pytest.raises(HoldRefused, match="left moves"):
        let_go(task, run.memory)
    with pytest.raises(HoldRefused, match="left moves"):
        held_together(task, run.memory, each(run))


def test_grasps_that_do_not_fit_hold_nothing_together(run):
    task, q = run.control.joint.tasks[0], each(run)
    run.memory = let_go(task, run.memory)
    q[1] = q[1] + [0.05, 0, 0, 0, 0, 0, 0]
    with pytest.raises(HoldRefused, match=r"\d+ mm from fitting each other: at most 20 mm"):
        held_together(task, run.memory, q)


def test_a_cell_whose_grasps_do_not_fit_at_the_start_is_one_line(tmp_path):
    far = ("{ xyz = [0.0, 0.55, 0.121]", "{ xyz = [0.0, 0.60, 0.121]")
    with pytest.raises(ConfigError) as refusal:
        Control.of(pair(tmp_path, far))
    assert "task 'beam': T_wrist_mrf: " in str(refusal.value)
    assert "25 mm from fitting each other: at most 20 mm" in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_grasps_are_taken_where_arms_are_while_drives_are_off(run):
    q = each(run)
    run.tick(intent=Intent.SEED)
    views = [memory.held.T_wrist_payload for memory in run.memory.arms]
    places = [
        arm.mechanism.pose_wrist(own) @ view
        for arm, own, view in zip(run.control.arms, q, views, strict=True)
    ]
    np.testing.assert_allclose(places[0].p, places[1].p, atol=1e-9)
    np.testing.assert_allclose(places[0].R, places[1].R, atol=1e-9)
