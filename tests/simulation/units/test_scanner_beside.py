"""A rover with a scanner, beside an arm at work: it stops before what it sees, not before that."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

CELL = """
name = "looking"
default_script = "drive_past"
[[buses]]
name = "rover"
channel = "239.74.163.30"
[[buses]]
name = "arm"
channel = "239.74.163.31"
[frames]
crf_on = "base"
[[mechanisms]]
name = "rover"
like = "rover_bridge"
bus = "rover"
[[mechanisms]]
name = "arm"
like = "pa10"
bus = "arm"
T_world_base = { xyz = [1.4, 1.15, 0.0], rpy = [0.0, 0.0, -1.5707963267948966] }
[rig]
seed = 1
[rig.bridge]
height = 0.45
width = 1.4
thickness = 0.1
distance = 3.0
"""
AHEAD_M = 3.0
"""Where the bridge begins in World: too low for the rover's own body [m]."""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The rover is driven at a bridge that it cannot pass, by an arm that moves to and fro."""
    path = tmp_path_factory.mktemp("looking") / "looking.toml"
    path.write_text(CELL)
    steps = [{"at_s": 0.3, "cmd/drive": {"mechanism": "rover", "rates": [0.25, 0.0]}}]
    steps += [
        {"at_s": at_s, "cmd/position": {"task": "arm", "xyz": [0.6, y, 0.6], "relative_to": "base",
                                        "rpy": [0.0, 1.5708, 0.0], "speed": 0.2}}
        for at_s, y in ((0.4, -0.25), (5.0, 0.25), (10.0, -0.25))
    ]  # fmt: skip
    script = Script.model_validate({"duration_s": 15.0, "step": steps})
    simulation = Simulation(load_cell(path), script)
    contours = []
    simulation.scans.on_look = lambda looked: contours.append(
        (simulation.rig.frames["base"], looked)
    )
    return Run(simulation, simulation.run()), contours


def test_the_rover_waits_before_the_bridge_while_the_arm_goes_on_working(run):
    run, _ = run
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    assert run.events("passage_refused")
    # By the physics: nothing is touched, and it stands.
    assert run.summary["contact_peak_n"] == run.summary["own_contact_n"] == 0.0
    assert run.summary["min_clearance_m"] > 0.5
    start = run.simulation.player.start_s
    base = [t.frames["base"][0] for t in run.truths if t.time_s - start > 12.0]
    assert np.ptp(base) < 1e-3
    assert 1.5 < base[-1] < 2.4
    tool = {
        s: min(run.truths, key=lambda t, s=s: abs(t.time_s - start - s)).arms["arm"].pose_mrf[:3]
        for s in (4.8, 9.8, 14.9)
    }
    for s, x in ((4.8, 1.15), (9.8, 1.65), (14.9, 1.15)):
        assert tool[s] == pytest.approx([x, 0.55, 0.6], abs=1e-3)


def test_the_arm_in_its_view_is_no_obstacle(run):
    """Its rays are dropped wherever it is, so that the nearest thing told is the bridge."""
    run, contours = run
    foot = run.simulation.cell.config.contour.foot[0]
    on_arm = sum(int((looked.own & (looked.scan.distances > 0.9)).sum()) for _, looked in contours)
    assert on_arm > 1000
    told = [
        base[0] + foot + np.nanmin(looked.contour.nearest)
        for base, looked in contours
        if looked.contour is not None and np.isfinite(looked.contour.nearest).any()
    ]
    assert len(told) > 50
    assert min(told) > AHEAD_M - 0.15
    assert not any("scan_" in name for state in run.states for name in state.limits)
