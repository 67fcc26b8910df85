"""The figure of a rover before a bridge shows the scans, contour and arm of a recorded run."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.recording.plot.figure import load_recording
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    def record(cell, seconds):
        path = tmp_path_factory.mktemp("plot") / f"{cell}.mcap"
        script = Script.model_validate({"duration_s": seconds, "step": []})
        Simulation(load_cell(cell), script, path).run()
        return path

    return record


def test_scans_contour_and_arm_are_drawn_where_they_were(recorded, tmp_path):
    pytest.importorskip("matplotlib")
    from laboratory.equipment.figures import ducking, main

    path = recorded("rover_bridge", 0.9)
    run = load_recording(path)
    assert len(run.scans) == len(run.contours) > 5
    figure = ducking(run, at_s=float(run.contours[-1]["time_s"]))
    side, contour, *_, passage = figure.axes
    # The beam's near face is 2.5 m ahead of World at a height of 0.95 m, the foot 0.2 m at 0.5.
    points = side.lines[0].get_xydata()
    beam = points[(points[:, 1] > 0.40) & (points[:, 1] < 0.60)]
    assert np.median(beam[:, 0]) == pytest.approx(2.3, abs=0.03)
    depth = contour.images[0].get_array().filled(np.nan)
    rows, _ = np.nonzero(np.isfinite(depth))
    assert np.nanmin(depth) > 2.2
    assert rows.max() * 0.05 + 0.5 == pytest.approx(1.05, abs=0.06)  # its upper edge
    tool = next(line for line in passage.lines if line.get_label() == "tool")
    assert tool.get_ydata()[-1] == pytest.approx(run.truths[-1]["pose_mrf"][2], abs=2e-3)
    out = tmp_path / "figure.png"
    assert main(["contour", str(path), "--out", str(out)]) == 0
    assert out.stat().st_size > 5000


def test_a_cell_without_a_contour_is_refused_by_name(recorded, capsys, tmp_path):
    pytest.importorskip("matplotlib")
    from laboratory.equipment.figures import main

    path = recorded("pa10", 0.2)
    assert main(["contour", str(path), "--out", str(tmp_path / "figure.png")]) == 2
    assert "contour: missing: nobody looks ahead" in capsys.readouterr().err
