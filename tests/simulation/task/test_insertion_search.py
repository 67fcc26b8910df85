"""Where a peg stands on the rim of its hole, it is said; and a search finds the hole."""

import pytest
from laboratory.campaign.contact import searched
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.section import PoseSection
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.judges import peg_depths
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

STICK = {
    "cmd/joystick": {
        "twist": [0.0, 0.0, 0.004, 0.0, 0.0, 0.0],
        "relative_to": "mrf",
        "expressed_in": "mrf",
    }
}
SEARCH = {"insertion": {"velocity": [0.0, 0.0, 0.004], "way": 0.036, "search": 0.008}}


@pytest.fixture
def insert():
    """Run a step of the peg over a hole that is 7 mm off, to 20 mm deep; return run and depth."""

    def run(step, seconds):
        told = load_cell("pa10_peg")
        rig = told.config.rig
        off = rig.holes[0].model_copy(update={"misplaced": PoseSection(xyz=(-0.0066, -0.0024, 0))})
        real = altered(told, {"rig.holes": (off,)})
        made = Script.model_validate({"duration_s": seconds, "step": [{"at_s": 0.5, **step}]})
        simulation = Simulation(told, made, real=real)

        def depth():
            return peg_depths(real, simulation.truths[-1])[0] if simulation.truths else 0.0

        return Run(simulation, simulation.run(until=lambda: depth() > 0.02)), depth()

    return run


def test_a_peg_on_the_rim_of_its_hole_is_jammed_by_name(insert):
    run, depth = insert(STICK, 5.0)
    assert depth < 1e-3
    (jammed,) = run.events("jammed")
    assert 10.0 < jammed.values["force_n"] < 15.0
    assert jammed.values["way_m"] < 0.1 * jammed.values["asked_m"]
    assert run.states[-1].mode == "enabled"


def test_a_tool_that_a_stick_presses_on_a_plain_wall_is_held_up_and_not_jammed(play):
    stick = {"twist": [0.03, 0.0, 0.0, 0.0, 0.0, 0.0], "expressed_in": "base"}
    ready = {"at_s": 0.0, "cmd/posture": {"posture": "ready"}}
    run = play(ready, {"at_s": 2.6, "cmd/joystick": stick}, seconds=8.6)
    (held_up,) = run.events("held_up")
    assert held_up.severity == "info"
    assert held_up.values["force_n"] == pytest.approx(40.0, rel=0.1)
    assert run.events("jammed") == []


def test_a_search_finds_the_hole_and_presses_no_harder(insert):
    run, depth = insert(SEARCH, 40.0)
    assert depth > 0.02
    assert max(t.arms["arm"].contact_peak for t in run.truths) < 60.0
    assert run.summary["limit_violations"] == 0


def test_a_beam_finds_nodes_that_its_chamfers_do_not_catch():
    """Without a search both pegs stay on the rims and press with 26 N."""
    found = searched.play(14)
    assert found.reasons == []
    assert found.inserted
