"""In space, too, what has left a tunnel is an ordinary arm: its head goes round a circle."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.server.control.backbone.insertion import Backbone
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.model import tunnel
from telerobot.tools.scripts.script import load_script, script_path

INSIDE = 21
"""Joints that stand inside the tunnel, of 30."""
CIRCLE = load_script(script_path("tail_space", load_cell("snake_tail_space").path.parent)).steps[-1]


@pytest.fixture(scope="module")
def out():
    """`snake_tail_space` with its tip out already: 9 of 30 joints are beyond the exit."""
    cell = load_cell("snake_tail_space")
    assert {finding.status for finding in tunnel(cell)} == {Severity.OK}
    q = tuple(Backbone.from_cell(cell).fits[1].tolist())
    return altered(cell, {"mechanism.postures": {"start": q, "ready": q}})


def test_the_head_goes_round_a_circle_with_its_attitude_held_while_the_rest_stands(play, out):
    run = play({"at_s": 0.3, "cmd/path": dict(CIRCLE.message.fields)}, seconds=5.3, cell=out)
    assert run.result.ok
    times = np.array([t.time_s for t in run.truths]) - run.simulation.player.start_s
    tool = np.array([t.pose_mrf for t in run.truths])
    before, on_way = tool[np.searchsorted(times, 0.25)], times > 0.3
    spokes = tool[on_way, :2] - (before[:2] - np.array([0.03, 0.0]))
    assert np.abs(np.hypot(*spokes.T) - 0.03).max() < 0.002
    assert np.ptp(np.unwrap(np.arctan2(spokes[:, 1], spokes[:, 0]))) > 6.0
    assert np.abs(tool[on_way, 2] - before[2]).max() < 0.001
    assert np.abs(tool[on_way, 3:] - before[3:]).max() < 0.005

    q = np.array([t.q for t in run.truths])[on_way]
    assert np.ptp(q[:, :INSIDE], axis=0).max() < 1e-3
    command = np.array([s.q_command for s in run.states])
    assert np.ptp(command[-400:, :INSIDE], axis=0).max() < 1e-4
    assert np.ptp(command[-400:, INSIDE:], axis=0).max() > 0.1
    assert run.states[-1].insertion["free"] == 9
    assert run.summary["min_clearance_m"] >= 0.005
    assert run.summary["wall_force_n"] == 0.0


def test_a_joint_of_the_tail_at_its_limit_is_made_up_for_by_none_inside(play, out):
    up = {"twist": [0.0, 0.0, 0.05, 0.0, 0.0, 0.0], "expressed_in": "world"}
    run = play({"at_s": 0.3, "for_s": 2.2, "cmd/joystick": up}, seconds=2.7, cell=out)
    assert run.result.ok
    told = {limit for state in run.states for limit in state.limits}
    assert any(limit.startswith("joint_limit:") for limit in told)
    command = np.array([s.q_command for s in run.states])
    assert np.ptp(command[:, :INSIDE], axis=0).max() < 1e-4
    assert run.summary["wall_force_n"] == 0.0
