"""A six-joint arm's tool goes round an obstacle on its path, and comes back to it."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run


@pytest.fixture(scope="module")
def run():
    simulation = Simulation(load_cell("ur5e_scene"), load_script("round_obstacle"))
    return Run(simulation, simulation.run())


def test_the_tool_passes_the_obstacle_and_is_back_on_its_path_in_the_end(run):
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    assert run.summary["min_clearance_m"] > 0.02
    assert max(s.off_path[2] for s in run.states if s.off_path) > 0.03
    assert run.summary["tool_error_m"] < 1e-3
    assert run.states[-1].at_goal
    # It went past: the ball stands between where the tool was and where it is.
    ball = run.simulation.cell.config.obstacles[0].xyz[1]
    assert run.at(0.5).pose_mrf[1] > ball + 0.1
    assert run.states[-1].pose_mrf[1] < ball - 0.1


def test_off_the_path_means_along_the_links_direction_alone(run):
    way = np.array([s.pose_mrf[:3] for s in run.states if s.off_path])
    assert np.ptp(way[:, 0]) < 1e-3
    # What is told is where the tool truly is: path and way off it together.
    told = np.array([np.add(s.path_mrf[:3], s.off_path)[2] for s in run.states if s.off_path])
    assert np.abs(told - way[:, 2]).max() < 5e-3


def test_links_across_a_path_that_goes_anywhere_give_way_square_to_it():
    """Both across the path, which goes to the side, ahead and up; the ball is beside it."""
    place = (0.5, -0.06, 0.5)
    ahead = {
        "xyz": (0.06, -0.3, 0.06),
        "rpy": (0, 0, 0),
        "relative_to": "mrf",
        "expressed_in": "base",
    }
    steps = [
        {"at_s": 0.1, "sensor/obstacle": {"name": "ball", "xyz": place}},
        {"at_s": 0.1, "rig/fault": {"kind": "place", "target": "ball", "vector": place}},
        {"at_s": 0.4, "cmd/position": ahead},
    ]
    ways = {"directions": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "axes": "path"}
    cell = altered(load_cell("ur5e_scene"), ways, "potential.virtual_link")
    simulation = Simulation(cell, Script.model_validate({"duration_s": 7.0, "step": steps}))
    run = Run(simulation, simulation.run())
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    assert run.summary["min_clearance_m"] > cell.config.avoidance.clearance
    off = np.array([s.off_path for s in run.states if s.off_path])
    path = np.array([s.path_mrf[:3] for s in run.states if s.off_path])
    way = path[-1] - path[0]
    assert np.linalg.norm(off, axis=1).max() > 0.01
    assert np.abs(off @ way).max() < 1e-6 * np.linalg.norm(way)
    assert np.abs(path[-1] + off[-1] - run.states[-1].pose_mrf[:3]).max() < 2e-3


@pytest.mark.parametrize("keeps_clear", [True, False])
def test_without_the_virtual_link_the_same_path_ends_at_the_obstacle(keeps_clear):
    """Before it, where clearances are kept; else in it, for the field is soft."""
    cell = load_cell("ur5e_scene")
    cell = altered(cell, {"potential.virtual_link": None})
    script = load_script("round_obstacle")
    if not keeps_clear:
        off = type(script.step[0]).model_validate(
            {"at_s": 0.1, "operator/avoidance": {"on": False}}
        )
        script = script.model_copy(update={"step": (off, *script.step)})
    simulation = Simulation(cell, script)
    run = Run(simulation, simulation.run())
    least = run.summary["min_clearance_m"]
    assert (least > cell.config.avoidance.clearance) is keeps_clear
    assert (least < 0.0) is not keeps_clear


@pytest.mark.parametrize("above", [0.02, 0.06])
def test_a_ball_over_the_path_is_passed_clear_with_the_setting_as_shipped(above):
    """The field leads the tool down, into it or past it; what keeps the distance is the barrier."""
    place = (0.5, -0.06, 0.5 + above)
    steps = [
        {"at_s": 0.1, "sensor/obstacle": {"name": "ball", "xyz": place}},
        {"at_s": 0.1, "rig/fault": {"kind": "place", "target": "ball", "vector": place}},
        *(step for step in load_script("round_obstacle").step if step.at_s < 1.0),
    ]
    cell = load_cell("ur5e_scene")
    simulation = Simulation(cell, Script.model_validate({"duration_s": 7.0, "step": steps}))
    run = Run(simulation, simulation.run())
    assert run.summary["mode"] == "enabled"
    assert run.summary["contact_peak_n"] == 0.0
    assert run.summary["min_clearance_m"] > cell.config.avoidance.clearance
    assert run.states[-1].pose_mrf[1] == pytest.approx(0.13 - 0.4, abs=1e-3)
