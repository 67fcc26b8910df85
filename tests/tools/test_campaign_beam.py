"""Two arms on one payload, drawn by the campaign: a sample of its runs."""

import pytest
from telerobot.config.load import load_cell
from telerobot.tools.campaign import beam
from telerobot.tools.campaign.part import Selection


@pytest.mark.parametrize("seed", [1, 8])
def test_a_payload_is_neither_pressed_nor_stretched(seed):
    run = beam.play(seed)
    assert run.reasons == []
    assert run.stops > 0
    assert run.travelled_m > 0.05


def test_arms_that_do_not_give_way_are_found(monkeypatch):
    """The judge sees it: without force control, what does not fit stays pressed."""
    monkeypatch.setattr(beam, "LOOP_GAIN", (1e-9, 1e-8))
    monkeypatch.setattr(beam, "FAULTY", 0.0)
    monkeypatch.setattr(beam, "MISFIT", 0.0)
    assert any("internal force" in reason for reason in beam.play(8).reasons)


def test_every_seed_is_another_payload_with_its_motion():
    cell = load_cell(beam.CELL)
    drawn = [beam.generate(cell, seed) for seed in range(4)]
    assert len({made.joint_tasks[0].payload.mass for made, _, _ in drawn}) == 4
    for made, script, _ in drawn:
        assert made.config.rig.beam.mass == made.joint_tasks[0].payload.mass
        assert any("operator/mode" in str(step.message) for step in script.step)
    assert beam.jobs(Selection((), range(3))) == [0, 1, 2]
