"""A sample of the campaign's scenes, and that its judge can tell."""

import dataclasses

import pytest
from telerobot.config.load import load_cell
from telerobot.tools.campaign.crowd import KINDS, PROMISE, crowd
from telerobot.tools.campaign.crowd_runs import Findings, play


@pytest.fixture(scope="module")
def scenes():
    return [play(seed) for seed in (1, 2, 3, 8)]


def test_a_sample_of_scenes_keeps_every_promise(scenes):
    assert {s.kind for s in scenes} == set(KINDS)
    assert [s.reasons for s in scenes] == [[]] * len(scenes)
    assert any(s.limited_ticks > 100 for s in scenes)
    assert Findings(scenes).kept


def test_the_label_is_of_the_scene_alone():
    cell = load_cell("pa10")
    for seed in range(4):
        scene = crowd(cell, seed)
        again = crowd(cell, seed)
        assert (scene.cell.config, scene.script) == (again.cell.config, again.script)
        assert scene.keepable == (scene.kind in ("free", "near"))
        assert (scene.start_m >= PROMISE) == (scene.kind != "inside")


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"least_m": PROMISE - 1e-4}, "promised"),
        ({"left": False}, "did not leave"),
        ({"closed_m": 0.01}, "own motion"),
        ({"limit_violations": 1}, "limit violations"),
        ({"kind": "inside", "held_m": 0.01, "least_m": 0.008}, "deeper inside"),
    ],
)
def test_what_speaks_against_a_run_is_found(scenes, change, word):
    bad = dataclasses.replace(scenes[0], **change)
    assert any(word in reason for reason in bad.reasons)
    assert not Findings([bad]).kept
    assert any(word in line for line in Findings([bad]).lines())
