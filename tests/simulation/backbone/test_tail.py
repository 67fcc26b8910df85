"""What has left a tunnel at its far end is an ordinary arm, while the joints inside stand."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.server.control.backbone.insertion import Backbone
from telerobot.tools.scripts.script import load_script, script_path


@pytest.fixture(scope="module")
def out():
    """`snake_tail` with its tip out already: 8 of 30 joints are beyond the exit."""
    cell = load_cell("snake_tail")
    backbone = Backbone.from_cell(cell)
    q = tuple(backbone.fits[1].tolist())
    return altered(cell, {"mechanism.postures": {"start": q, "ready": q}})


CIRCLE = load_script(script_path("tail", load_cell("snake_tail").path.parent)).steps[-1].message


def test_the_head_goes_round_a_circle_and_withdraws_as_a_curve(play, out):
    run = play(
        {"at_s": 0.3, "cmd/path": dict(CIRCLE.fields)},
        {"at_s": 5.5, "cmd/cancel": {}},
        {"at_s": 5.6, "cmd/drive": {"rates": [-0.08]}},
        seconds=8.0,
        cell=out,
    )
    assert run.result.ok
    start = run.simulation.player.start_s
    times = np.array([t.time_s for t in run.truths]) - start
    tool = np.array([t.pose_mrf for t in run.truths])
    before = tool[np.searchsorted(times, 0.25)]
    on_way = (times > 0.3) & (times < 5.5)
    spokes = tool[on_way, :2] - (before[:2] + np.array([0.012, -0.0275]))
    assert np.abs(np.hypot(*spokes.T) - 0.03).max() < 0.002
    assert np.ptp(np.unwrap(np.arctan2(spokes[:, 1], spokes[:, 0]))) > 6.0
    assert np.abs(tool[on_way, 5] - before[5]).max() < 0.005

    command = np.array([s.q_command for s in run.states])
    moving = [0.3 < s.time_s - start < 5.5 for s in run.states]
    moved = np.ptp(command[moving], axis=0)
    assert moved[:22].max() < 1e-4
    assert moved[22:].max() > 0.1

    held, end = run.at(5.4).insertion, run.states[-1].insertion
    assert held["free"] == 8
    assert end["depth"] < held["depth"] - 0.1
    assert end["free"] < 7
    assert run.summary["min_clearance_m"] >= 0.008
    assert run.summary["wall_force_n"] == 0.0
