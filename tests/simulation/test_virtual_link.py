"""A six-joint arm's tool goes round an obstacle on its path, and comes back to it."""

import dataclasses

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import load_script
from telerobot.tools.simulation.simulation import Simulation

from .conftest import Run


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


def test_without_the_virtual_link_the_same_path_ends_in_the_obstacle():
    cell = load_cell("ur5e_scene")
    potential = cell.config.potential.model_copy(update={"virtual_link": None})
    cell = dataclasses.replace(cell, config=cell.config.model_copy(update={"potential": potential}))
    simulation = Simulation(cell, load_script("round_obstacle"))
    assert Run(simulation, simulation.run()).summary["min_clearance_m"] < 0.0
