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


CROSS = {"xyz": (0.0, -0.4, 0.0), "rpy": (0, 0, 0), "relative_to": "mrf", "expressed_in": "base"}


def test_an_operator_tells_links_while_the_tool_goes_round_and_what_is_told_is_where_it_is(play):
    """From up and down to across the path: the tool is on the new links' plane in the end."""
    told = {"directions": [(1.0, 0.0, 0.0), (0.0, 0.0, 0.5)], "stiffness": 20.0}
    run = play(
        {"at_s": 0.4, "cmd/position": CROSS},
        {"at_s": 2.0, "operator/virtual_links": told},
        {"at_s": 3.0, "operator/virtual_links": {"axes": "path"}},
        {"at_s": 5.0, "operator/virtual_links": {"directions": []}},
        {"at_s": 8.0, "operator/virtual_links": {"reset": True}},
        seconds=8.2,
        cell=load_cell("ur5e_scene"),
    )
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    section = run.simulation.cell.config.potential.virtual_link
    assert run.at(1.9).links == {"axes": "world", "always": False, "stiffness": section.stiffness}
    assert run.at(1.9).link_directions == section.directions
    both = run.at(2.9)
    assert both.links["stiffness"] == 20.0
    assert np.abs(both.link_offs).min() > 2e-4
    assert both.off_path == pytest.approx((both.link_offs[0], 0.0, both.link_offs[1]), abs=1e-9)
    assert run.at(4.9).links["axes"] == "path"
    assert run.at(7.9).link_directions == run.at(7.9).link_offs == ()
    assert np.linalg.norm(run.at(7.9).off_path) < 1e-3
    assert run.states[-1].link_directions == section.directions
    assert [e.values["axes"] for e in run.events("links_set")] == ["world", "path", "path", "world"]


@pytest.mark.parametrize(
    ("cell", "told", "reason"),
    [
        ("ur5e_scene", {"directions": [(0.0, 0.0, 0.0)]}, "a direction must not be zero"),
        (
            "ur5e_scene",
            {"directions": [(1.0, 0, 0), (1.0, 0.1, 0)]},
            "must be square to each other",
        ),
        ("pa10", {"stiffness": 3.0}, "no [potential.virtual_link]"),
        ("pa10_pair", {"stiffness": 3.0}, "hold 'beam' together"),
    ],
)
def test_links_that_cannot_be_are_refused_with_their_reason(play, cell, told, reason):
    step = {"at_s": 0.2, "operator/virtual_links": told}
    run = play(step, seconds=0.3, cell=load_cell(cell))
    (refused,) = run.summary["refused"]
    assert reason in refused
    assert run.events("links_set") == []
