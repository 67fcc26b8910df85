"""The arm keeps out of a camera's line of sight while its tool goes over it, and then down."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.proximity.capsules import Capsules
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

CLEAR = 0.05
"""Every link's housing stays so far from the line [m]."""
CROSS_TRACK = 1e-3
"""And the tool so close to its path [m]."""
LEGS = ((0.4, 4.4), (4.4, 9.0))
"""When each leg of the motion is under way, in the scripts' time [s]."""


def played(name):
    simulation = Simulation(load_cell("ranger"), load_script(name))
    return Run(simulation, simulation.run())


@pytest.fixture(scope="module")
def on():
    return played("sight_line_on")


@pytest.fixture(scope="module")
def off():
    return played("sight_line_off")


@pytest.fixture(scope="module")
def moving():
    return played("sight_line_moving")


def cross_track(run, until_s=LEGS[-1][1]):
    """Return the true tool's greatest distance from the lines between its targets [m]."""
    start = run.simulation.player.start_s
    worst = 0.0
    for begin, end in LEGS:
        at = [t for t in run.truths if begin + 0.02 < t.time_s - start < min(end, until_s)]
        origin = np.array(run.at(begin + 0.02).path_mrf[:3])
        way = np.array(run.at(end - 0.02).target_mrf[:3]) - origin
        along = way / np.linalg.norm(way)
        away = np.array([t.pose_mrf[:3] for t in at]) - origin
        aside = away - np.outer(away @ along, along)
        worst = max(worst, np.linalg.norm(aside, axis=1).max())
    return worst


def is_well(run):
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    assert run.summary["mode"] == "enabled"
    assert [e for e in run.simulation.events if e.severity == "error"] == []


def test_with_the_field_every_housing_keeps_clear_of_the_sight_line(on):
    is_well(on)
    assert on.summary["min_sight_m"] > CLEAR


def test_without_it_the_same_motion_blocks_the_view(off):
    is_well(off)
    assert off.summary["min_sight_m"] < 0.0


def test_where_the_target_moves_the_arm_gives_way(moving):
    is_well(moving)
    assert moving.summary["min_sight_m"] > CLEAR
    ends = np.array([t.tags["target"][:3] for t in moving.truths])
    assert np.ptp(ends[:, 1]) > 0.15
    # The tool stands meanwhile: it is the elbow that goes.
    still = [t for t in moving.truths if t.time_s - moving.simulation.player.start_s > 8.0]
    tool = np.array([t.pose_mrf[:3] for t in still])
    assert np.ptp(tool, axis=0).max() < CROSS_TRACK
    q = np.array([t.q for t in still])
    assert np.ptp(q, axis=0).max() > 0.1


@pytest.mark.parametrize("which", ["on", "off", "moving"])
def test_the_tool_keeps_to_its_path(which, request):
    assert cross_track(request.getfixturevalue(which)) < CROSS_TRACK


def test_the_tool_arrives_all_the_same(on, off):
    for run in (on, off):
        assert run.summary["tool_error_m"] < 1e-3
        assert run.summary["tool_error_rad"] < 2e-3


def test_the_slope_of_the_field_is_gone_once_all_stands(on):
    """ε is a thousandth of the strength of 0.3 N; less than a second after the tool stood."""
    assert on.states[-1].potential["slope"] < 3e-4


def test_what_the_physics_says_of_the_sight_line_is_what_geometry_says(on):
    """Housings against closed-form capsules, which hold them: these are never further off."""
    links = Capsules(load_cell("ranger"))
    start = np.array(on.simulation.cell.config.cameras[0].T_world_lens.xyz)
    for truth in on.truths[::100]:
        end = np.array(truth.tags["target"][:3])
        line = start + np.linspace(0.0, 1.0, 400)[:, None] * (end - start)
        ends = links.place(np.array([truth.q])).ends[0]
        near = dict.fromkeys(links.links, np.inf)
        for (a, b), radius, link in zip(ends, links.radius, links.links, strict=True):
            part = np.clip((line - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0.0, 1.0)
            apart = np.linalg.norm(line - a - part[:, None] * (b - a), axis=1).min() - radius
            near[link] = min(near[link], apart)
        for link in set(links.links) - {"base"}:
            assert truth.sight["head"][link] >= near[link] - 2e-3


def test_a_sight_line_that_is_lost_is_told_and_one_that_is_kept_is_not(on, off, moving):
    for run in (on, moving):
        assert run.events("sight_line_lost") == []
    (lost,) = off.events("sight_line_lost")
    assert lost.values["obstacle"] == "view"
    assert lost.values["gap_m"] < 0.0
    # The capsule of the link that is named holds the housing, which the physics measures.
    start, told = off.simulation.player.start_s, lost.time_s
    assert told - start > LEGS[1][0]


def test_of_two_lines_the_one_that_is_given_up_is_told_until_it_is_free():
    """A second camera looks through where the elbow stands."""
    line = {"name": "second", "shape": "sight_line", "xyz": (0.9, 0.3, 0.9), "max_speed": 0.3}
    steps = [
        {"at_s": 0.5, "sensor/obstacle": {**line, "to": (-0.5, 0.2, 0.75), "timeout_s": 60.0}},
        {"at_s": 1.5, "sensor/obstacle": {"name": "second", "to": (-0.5, 2.0, 0.75)}},
    ]
    script = Script.model_validate({"duration_s": 2.0, "step": steps})
    simulation = Simulation(load_cell("ranger"), script)
    run = Run(simulation, simulation.run())
    (lost,), (free,) = run.events("sight_line_lost"), run.events("sight_line_free")
    assert lost.values["obstacle"] == free.values["obstacle"] == "second"
    start = run.simulation.player.start_s
    assert 0.5 < lost.time_s - start < 0.6
    assert 1.5 < free.time_s - start < 1.6
