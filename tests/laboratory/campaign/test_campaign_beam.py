"""Two arms on one payload, drawn by the campaign: a sample of its runs."""

import numpy as np
import pytest
from laboratory.campaign import beam
from laboratory.campaign.part import Selection
from telerobot.config.load import load_cell


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


def test_a_payload_that_sinks_is_found(monkeypatch):
    monkeypatch.setattr(beam, "FAULTY", 0.0)
    monkeypatch.setattr(beam, "SUNK", 0.0)
    run = beam.play(3)
    assert run.sunk_m > 0.0
    assert any("sank" in reason for reason in run.reasons)


def test_a_fault_that_leaves_more_than_its_bound_is_found(monkeypatch):
    """Of seed 1 a drive fails; judged against nothing, what that leaves is too much."""
    monkeypatch.setattr(beam, "AFTER_FAULT", 0.0)
    assert any("internal force" in reason for reason in beam.play(1).reasons)


def test_every_seed_is_another_payload_with_its_motion():
    cell = load_cell(beam.CELL)
    drawn = [beam.generate(cell, seed) for seed in range(4)]
    assert len({made.joint_tasks[0].payload.mass for made, _, _ in drawn}) == 4
    for made, script, _ in drawn:
        true, told = made.config.rig.beam.mass, made.joint_tasks[0].payload.mass
        assert 0.0 < abs(told - true) <= beam.TOLD_MASS * true * (1 + 1e-9)
        com, told_com = made.config.rig.beam.com, made.joint_tasks[0].payload.com
        assert 0.0 < np.abs(np.subtract(com, told_com)).max() <= beam.TOLD_COM
        assert any("operator/mode" in str(step.message) for step in script.step)
    assert beam.jobs(Selection((), range(3))) == [0, 1, 2]
