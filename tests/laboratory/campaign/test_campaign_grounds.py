"""The campaign's platforms and conveyors move, and stand in the end."""

import numpy as np
import pytest
from laboratory.campaign.hostile.generator import MOVING, generate
from telerobot.config.load import load_cell
from telerobot.protocols import topics as t
from telerobot.tools.simulation.simulation import Simulation

SEEDS = range(40)


@pytest.fixture(scope="module")
def plans():
    plans = [generate(load_cell(name), seed) for name in ("pa10", "ur5e") for seed in SEEDS]
    return [plan for plan in plans if plan.cell.config.frames.moving]


def test_a_part_of_the_cells_has_a_base_or_a_carrier_that_moves_or_both(plans):
    assert len(plans) == pytest.approx(MOVING * 2 * len(SEEDS), rel=0.5)
    kinds = {tuple(plan.cell.config.frames.moving) for plan in plans}
    assert kinds == {("base",), ("carrier",), ("base", "carrier")}


def test_scripts_move_what_is_there_and_silence_it_and_put_all_back(plans):
    seen = set()
    for plan in plans:
        frames = plan.cell.config.frames
        for name, of in (("platform", frames.base), ("carrier", frames.carrier)):
            told = [motion for motion in motions(plan) if motion["target"] == name]
            assert bool(told) is (of is not None)
            if told:
                seen |= {name} if any("twist" in m or "sway" in m for m in told) else set()
                assert told[-1] == {"target": name}, "it ends where it began, at rest"
        for name in frames.moving:
            faults = [fault for s in plan.script.steps if (fault := s.says(t.RIG_FAULT))]
            silenced = [fault.get("on", True) for fault in faults if fault["target"] == name]
            seen |= {"silence"} if any(silenced) else set()
            assert silenced[-1] is False
        frames = [frame for s in plan.script.steps if (frame := s.says(t.FRAME))]
        crf = [frame.get("moves_with") for frame in frames if frame["frame"] == "crf"]
        seen |= {"riding"} if "carrier" in crf else set()
        assert crf[-1] == "world"
    assert seen == {"platform", "carrier", "silence", "riding"}


def motions(plan):
    return [motion for s in plan.script.steps if (motion := s.says(t.RIG_MOTION))]


def test_a_platform_that_has_swayed_stands_in_its_place_when_the_goal_is_judged(plans):
    def swings(plan):
        return any(motion.get("sway") for motion in motions(plan))

    simulation = Simulation(next(filter(swings, plans)).cell, next(filter(swings, plans)).script)
    truths = simulation.run().truths
    bases = np.array([truth.frames["base"] for truth in truths])
    assert np.abs(bases - bases[0]).max() > 5e-3
    assert np.abs(bases[-50:] - bases[0]).max() < 1e-5
