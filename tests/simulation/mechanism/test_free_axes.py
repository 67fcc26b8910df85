"""Axes that a task leaves free, by a script: told, faded, a goal reached; refused; replayed."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.tick import Control
from telerobot.tools.cli import main
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

TARGET = {"xyz": [0.02, 0.03, 0], "rpy": [0, 0, 1.0], "relative_to": "mrf", "expressed_in": "mrf"}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return tmp_path_factory.mktemp("run") / "run.mcap"


@pytest.fixture(scope="module")
def run(file):
    steps = [
        {"at_s": 0.2, "operator/free_axes": {"axes": ["rz", "rx"]}},
        {"at_s": 1.2, "operator/free_axes": {"axes": ["rz"]}},
        {"at_s": 1.3, "cmd/position": TARGET},
        {"at_s": 5.0, "operator/free_axes": {"axes": []}},
    ]
    script = Script.model_validate({"duration_s": 5.8, "step": steps})
    simulation = Simulation(load_cell("pa10"), script, file)
    return Run(simulation, simulation.run())


def test_the_state_tells_how_far_each_axis_is_held(run):
    assert run.summary["refused"] == []
    assert run.at(0.1).axes_held == (1.0,) * 6
    assert run.at(1.1).axes_held == (1.0, 1.0, 1.0, 0.0, 1.0, 0.0)
    assert run.at(2.4).axes_held == (1.0, 1.0, 1.0, 1.0, 1.0, 0.0)
    assert run.at(5.7).axes_held == (1.0,) * 6
    fading = np.array([s.axes_held for s in run.states])
    assert np.abs(np.diff(fading, axis=0)).max() == pytest.approx(0.02, abs=1e-9)
    assert [e.detail for e in run.events("axes_freed")] == ["rz, rx", "rz"]
    assert len(run.events("axes_held")) == 1


def test_a_goal_is_reached_without_the_turn_that_is_free(run):
    reached, target = run.at(4.9), run.at(4.9).target_mrf
    assert reached.at_goal
    assert reached.pose_mrf[:3] == pytest.approx(target[:3], abs=6e-4)
    assert np.abs(np.subtract(reached.pose_mrf[3:], target[3:])).max() > 0.2
    assert not run.at(5.3).at_goal


def test_the_run_replays_to_the_last_bit(run, file, capsys):
    assert run.summary["failure"] is None
    assert main(["replay", str(file)]) == 0
    assert "to the last bit" in capsys.readouterr().out


def test_arms_that_hold_a_payload_hold_all_axes_of_their_grasps(play):
    cell = altered(load_cell("pa10_pair"), {"resolve.free_axes": ["rz"]})
    run = play(seconds=0.3, cell=cell)
    assert run.summary["failure"] is None
    assert run.states[-1].held_by == "beam"
    each = [run.states[-1], *run.states[-1].tasks.values()]
    assert [state.axes_held for state in each] == [(1.0,) * 6] * len(each)


def test_no_rank_is_computed_inside_a_tick(play, monkeypatch):
    """Of an arm that does not reach all axes, with axes and MRF that are new while it runs."""
    inside, of_rows, tick = [False], Mechanism._of_rows, Control.tick

    def ranks(*arguments):
        assert not inside[0]
        return of_rows(*arguments)

    def ticks(*arguments):
        inside[0] = True
        try:
            return tick(*arguments)
        finally:
            inside[0] = False

    monkeypatch.setattr(Mechanism, "_of_rows", ranks)
    monkeypatch.setattr(Control, "tick", ticks)
    turned = {"frame": "mrf", "xyz": [0.0, 0.1, 0.0], "rpy": [0.5, 0.0, 0.3]}
    steps = [
        {"at_s": 0.2, "operator/free_axes": {"axes": ["x"]}},
        {"at_s": 0.3, "operator/free_axes": {"axes": ["rz", "ry"]}},
        {"at_s": 0.4, "operator/frame": turned},
        {"at_s": 1.2, "operator/free_axes": {"axes": []}},
    ]
    run = play(*steps, seconds=1.8, cell=load_cell("planar3"))
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []


@pytest.mark.parametrize(
    ("cell", "reason"),
    [("snake", "follows a curve"), ("pa10_pair", "hold 'beam' together")],
)
def test_what_has_no_axes_of_its_own_to_leave_says_so(play, cell, reason):
    step = {"at_s": 0.2, "operator/free_axes": {"axes": ["rz"]}}
    (refused,) = play(step, seconds=0.3, cell=load_cell(cell)).summary["refused"]
    assert reason in refused
