"""The figure of an arm in its tunnels shows the true links of a recorded run."""

from dataclasses import replace

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.backbone.insertion import Backbone
from telerobot.tools.recording.plot.figure import load_recording
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    def record(cell, step):
        path = tmp_path_factory.mktemp("plot") / f"{cell}.mcap"
        script = Script.model_validate({"duration_s": 0.8, "step": [step]})
        Simulation(load_cell(cell), script, path).run()
        return path

    return record


def test_links_and_curve_are_drawn_where_they_were(recorded, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    from laboratory.equipment.figures import main, slithering

    path = recorded("snake", {"at_s": 0.1, "cmd/drive": {"rates": [0.08]}})
    run = load_recording(path)
    figure = slithering(run)
    curve, links = figure.axes[0], figure.axes[1]
    backbone = Backbone.from_cell(run.cell)
    drawn = [line.get_xydata() for line in links.lines if len(line.get_xydata()) == 31]
    truths = backbone.chain.points(np.array([t["q"] for t in run.truths]))[:, :, :2]
    assert np.abs(truths - drawn[0]).max(axis=(1, 2)).min() == 0.0
    free = [line.get_xydata() for line in curve.lines if line.get_color() == "tab:blue"]
    assert np.linalg.norm(free[0][-1] - drawn[0][-1]) < 0.005
    out = tmp_path / "figure.png"
    assert main(["tunnel", str(path), "--out", str(out)]) == 0
    assert out.stat().st_size > 5000


def test_in_space_links_are_drawn_where_they_truly_were(recorded):
    pytest.importorskip("matplotlib")
    from laboratory.equipment.figures import slithering

    run = load_recording(
        recorded("snake_tail_space", {"at_s": 0.1, "cmd/drive": {"rates": [0.08]}})
    )
    links = slithering(run).axes[1]
    truths = Backbone.from_cell(run.cell).chain.points(np.array([t["q"] for t in run.truths]))
    every = [np.column_stack(line.get_data_3d()) for line in links.lines]
    drawn = [points for points in every if len(points) == 31 and np.ptp(points[:, 2]) > 0.01]
    assert np.abs(truths - drawn[0]).max(axis=(1, 2)).min() == 0.0


@pytest.mark.parametrize("cell", ["snake", "snake_space"])
def test_a_run_that_came_by_all_six_free_lengths_of_the_paper_shows_these(recorded, cell):
    pytest.importorskip("matplotlib")
    from laboratory.equipment.figures import slithering

    run = load_recording(recorded(cell, {"at_s": 0.1, "cmd/drive": {"rates": [0.08]}}))
    # As if it had gone in from the entrance to the end.
    depths = np.linspace(0.0, 0.87, len(run.states))
    states = [
        {**state, "insertion": {"depth": depth, "speed": 0.08, "free": 0.0}}
        for state, depth in zip(run.states, depths.tolist(), strict=True)
    ]
    titles = [ax.get_title() for ax in slithering(replace(run, states=states)).axes]
    shares = [float(title.split("=")[1].split()[0]) for title in titles if title]
    assert shares == [1.0, 0.94, 0.83, 0.68, 0.54, 0.44]


def test_an_arm_without_tunnels_is_refused_by_name(recorded, capsys, tmp_path):
    pytest.importorskip("matplotlib")
    from laboratory.equipment.figures import main

    path = recorded("pa10", {"at_s": 0.1, "cmd/joystick": {"twist": [0.0] * 6}})
    assert main(["tunnel", str(path), "--out", str(tmp_path / "figure.png")]) == 2
    assert "mechanism.backbone: missing" in capsys.readouterr().err
