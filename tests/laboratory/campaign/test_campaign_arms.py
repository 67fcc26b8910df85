"""Two arms under hostile operators: a sample of the campaign's runs."""

import dataclasses

import pytest
from laboratory.campaign import arms
from laboratory.campaign.part import Selection
from telerobot.config.load import altered, load_cell


@pytest.mark.parametrize("seed", [0, 1, 5])
def test_two_arms_with_a_task_each_never_touch(seed):
    run = arms.play(seed)
    assert run.reasons == []
    assert run.limited > 100, "nothing held them up: the run shows nothing"


def test_arms_that_keep_no_clearance_are_found(monkeypatch):
    """The judge sees it: with the barriers off, the same operators drive them into each other."""
    cell = load_cell(arms.CELL)
    parts = [altered(p, {"avoidance.enabled": False}) for p in cell.parts]
    blind = dataclasses.replace(parts[0], others=tuple(parts[1:]))
    monkeypatch.setattr(arms, "load_cell", lambda _name: blind)
    assert any("commanded arms came to" in reason for reason in arms.play(1).reasons)


def test_every_step_names_an_arm_and_both_are_driven():
    cell, script = arms.generate(load_cell(arms.CELL), 3)
    assert (
        cell.parts[0].config.mechanism.T_world_base != cell.parts[1].config.mechanism.T_world_base
    )
    named = [s for made in script.step for s in made.streams]
    assert {name.partition(":")[2] for name in named} == {"left", "right"}
    assert arms.jobs(Selection((), range(4))) == [0, 1, 2, 3]
