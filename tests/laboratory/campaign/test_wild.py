"""Wild operators: careless but legal, the same for the same seed, and no reason for a fault."""

import pytest
from laboratory.campaign.hostile.wild import equipped, wild
from laboratory.campaign.hostile.wild_runs import CELLS, play_in
from telerobot.config.load import load_cell
from telerobot.protocols import topics as t


def test_equal_seeds_are_equally_wild():
    cell = load_cell("pa10_vision")
    assert wild(cell, 3) == wild(cell, 3)
    assert wild(cell, 3) != wild(cell, 4)


def test_they_use_all_that_a_cell_has():
    cell, asked = load_cell("pa10_all"), set()
    for seed in range(12):
        for step in wild(equipped(cell, seed), seed).steps:
            asked |= {step.message.topic.key} if step.message else step.model_fields_set
    wanted = {
        "cmd/joystick", "cmd/jog", "cmd/position", "cmd/posture", "cmd/path", "cmd/force",
        "cmd/cancel", "operator/gain", "operator/switch", "operator/frame", "operator/speed",
        "operator/mode", "operator/store_view", "operator/payload", "operator/redundancy",
        "operator/avoidance", "operator/clutch", "operator/protective_stop",
        "operator/protective_clear", "operator/path", "master", "obstacle", "silence",
    }  # fmt: skip
    assert wanted <= asked


@pytest.mark.parametrize("name", CELLS)
def test_nothing_that_they_do_is_forged_and_nothing_of_the_hardware_fails(name):
    cell = load_cell(name)
    for seed in range(5):
        for step in wild(cell, seed).steps:
            assert step.raw is None
            assert step.link is None
            assert step.says(t.LEASE) is step.says(t.RELEASE) is None
            # The things in a camera's view may be moved and covered; that is no fault of hardware.
            fault = step.says(t.RIG_FAULT)
            assert fault is None or fault["kind"] in ("cover", "move", "silence")


@pytest.mark.parametrize(
    ("name", "seed"),
    # The last runs into something beside the tool at full speed: e2 is thrown on by 75 mrad.
    [("ur5e_scene", 4), ("pa10_all", 2), ("pa10_platform", 5)],
)
def test_a_wild_run_ends_without_a_fault_that_nothing_touched_explains(name, seed):
    """`make campaign ARGS="--only wild"` tries more."""
    run = play_in(name, seed)
    assert run.reasons == []
    assert run.enabled_s > 1.0
