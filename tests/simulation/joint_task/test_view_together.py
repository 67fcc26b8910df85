"""Vision at either end of a payload: a camera of one of the arms that hold it together."""

import numpy as np
import pytest
from telerobot.config.load import HERE, load_cell
from telerobot.tools.scripts.script import load_script
from telerobot.tools.simulation.simulation import Simulation

pytestmark = pytest.mark.usefixtures("rendering")

LENS = """
[[tasks]]
name = "look"
by = ["{arm}"]
[[tasks.cameras]]
name = "wrist"
T_wrist_lens = {{ xyz = [-0.15, 0.0, 0.0] }}
size = [320, 240]
focal = [280.0, 280.0]
rate_hz = 20.0
latency_s = 0.06
tag = 7
tag_size = 0.1
law = "{law}"
[[rig.tags]]
name = "floor"
T_world_tag = {{ xyz = [0.70, {y}, 0.12] }}
tag = 7
size = 0.1
"""
SEES_NOTHING = """
[[tasks]]
name = "grope"
by = ["right"]
[[tasks.cameras]]
name = "hand"
T_wrist_lens = { xyz = [-0.15, 0.0, 0.0] }
tag = 9
"""
AWAY = {"twist": [-0.06, 0.04, 0.0, 0.0, 0.0, 0.05], "expressed_in": "world"}
END = {"left": 0.55, "right": -0.55}


@pytest.fixture
def cell_seen_by(tmp_path):
    """Return the pair without nodes, with a camera on one of its arms over a tag."""

    def make(arm, more="", law="pose"):
        text = (HERE / "cells/pa10_pair.toml").read_text()
        text = text[: text.index("# Mouths")]
        text = "\n".join(line for line in text.splitlines() if not line.startswith("pegs"))
        path = tmp_path / "pair.toml"
        path.write_text(text + LENS.format(arm=arm, y=END[arm], law=law) + more)
        return load_cell(path)

    return make


@pytest.mark.parametrize(("arm", "law"), [("left", "pose"), ("right", "pose"), ("right", "image")])
def test_a_camera_at_either_end_leads_the_payload_back_to_its_view(play, cell_seen_by, arm, law):
    run = play(
        {"at_s": 0.3, "operator/store_view": {"camera": "wrist"}},
        {"at_s": 0.3, "operator/switch": {"source": "vision", "on": True}},
        {"at_s": 0.4, "for_s": 0.6, "cmd/joystick": AWAY},
        seconds=4.5,
        cell=cell_seen_by(arm, law=law),
    )
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    assert run.states[-1].of(run.states[-1].held_by).view_law == law
    assert run.events("view_found")[0].values["mechanism"] == arm
    places = np.array([truth.beam.pose for truth in run.truths])
    assert np.abs(places - places[0])[:, :3].max() > 0.01
    np.testing.assert_allclose(places[-1][:3], places[0][:3], atol=4e-3)
    np.testing.assert_allclose(places[-1][3:], places[0][3:], atol=0.01)
    assert run.summary["internal_force_n"]["max"] < 10.0


def test_a_view_of_no_arm_that_holds_it_is_refused(play, cell_seen_by):
    run = play(
        {"at_s": 0.1, "operator/store_view": {"task": "beam", "camera": "hand"}},
        seconds=0.2,
        cell=cell_seen_by("right"),
    )
    assert "'hand' is none of wrist" in run.summary["refused"][0]


NODES_Y, NODES_Z = 0.013, 0.391
"""Where both nodes let the beam's middle in, by the cell: 13 mm aside, 8 to 10 mm down [m]."""


def test_a_view_that_cannot_be_stored_leaves_the_one_of_before(play, cell_seen_by):
    cell = cell_seen_by("left", SEES_NOTHING)
    run = play(
        {"at_s": 0.3, "operator/store_view": {"task": "beam", "camera": "wrist"}},
        {"at_s": 0.4, "operator/store_view": {"task": "beam", "camera": "hand"}},
        {"at_s": 0.5, "operator/switch": {"task": "beam", "source": "vision", "on": True}},
        seconds=0.8,
        cell=cell,
    )
    assert len(run.summary["refused"]) == 1
    assert "camera hand sees no tag now" in run.summary["refused"][0]
    assert run.states[-1].of("beam").view_error is not None


@pytest.fixture(scope="module")
def inserted():
    """Return a run of the paper's task: by position, by the view at either end, by force."""
    simulation = Simulation(load_cell("pa10_nodes"), load_script("see_and_insert"))
    return simulation, simulation.run()


def test_views_at_both_ends_bring_a_beam_to_nodes_that_nobody_was_told_of(inserted):
    simulation, result = inserted
    assert result.summary["ok"], result.summary["expected"]
    assert result.summary["refused"] == []
    kept = [e.detail for e in simulation.events if e.name == "view_kept"]
    assert kept == ["left_eye", "right_eye"]
    off = next(e for e in reversed(simulation.events) if e.name == "source_switched")
    seen = next(t for t, s in zip(result.truths, result.states, strict=True) if s.tick == off.tick)
    assert max(simulation.view.error(seen)) < 0.002  # of the right end, where it looked last
    x, y, z, *turn = seen.beam.pose
    assert abs(x - 0.55) < 0.002
    assert abs(y - NODES_Y) < 5e-4
    assert abs(z - NODES_Z) < 1e-3
    assert max(map(abs, turn)) < 0.002


def test_without_a_view_the_same_beam_stands_before_its_nodes():
    """The nodes are farther off than their chamfers catch: the drawing alone leads nowhere."""
    simulation = Simulation(load_cell("pa10_nodes"), load_script("two_nodes"))
    assert max(simulation.run().summary["peg_depth_m"]) < 0.005
