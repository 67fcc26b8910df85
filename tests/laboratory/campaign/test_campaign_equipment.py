"""The campaign's gripper weighs what it should, and its cameras see what is there."""

import numpy as np
import pytest
from laboratory.campaign.hostile.cells import EMPTY, LOADED, with_gripper
from laboratory.campaign.hostile.generator import generate
from telerobot.config.load import load_cell
from telerobot.protocols import topics as t
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation
from telerobot.tools.soak.cli import ComputedSights

WATCH = [
    {"at_s": 0.1, "cmd/posture": {"posture": "ready"}},
    {"at_s": 2.4, "operator/store_view": {"camera": "wrist"}},
    {"at_s": 2.5, "operator/switch": {"source": "vision", "on": True}},
]
REJECTED = "picture_rejected"


@pytest.fixture(scope="module")
def seeing():
    return load_cell("pa10_vision")


@pytest.fixture
def watch(seeing):
    def run(*steps, seconds):
        script = Script.model_validate({"duration_s": seconds, "step": [*WATCH, *steps]})
        simulation = Simulation(seeing, script, cameras=lambda s: ComputedSights(s, 3))
        return simulation, simulation.run()

    return run


@pytest.mark.parametrize("name", ["pa10", "ur5e"])
def test_what_the_gripper_holds_adds_up_to_what_the_daemon_is_told(name):
    cell = load_cell(name)
    held = with_gripper(np.random.default_rng(0), cell).config
    before = cell.config.mechanism.force_torque.payload
    empty, loaded = (held.mechanism.payloads[key] for key in (EMPTY, LOADED))
    assert empty == before
    assert loaded.mass == pytest.approx(before.mass + held.rig.gripper.mass)
    moment = before.mass * np.array(before.com)
    moment += held.rig.gripper.mass * np.array(held.rig.gripper.com)
    np.testing.assert_allclose(loaded.mass * np.array(loaded.com), moment)


def test_a_stored_view_is_kept_on_computed_sights(watch):
    stick = {"twist": [0.0, 0.05, 0.0, 0.0, 0.0, 0.0], "expressed_in": "base"}
    simulation, result = watch(
        {"at_s": 3.0, "cmd/joystick": stick},
        {"at_s": 4.0, "cmd/joystick": {"twist": [0.0] * 6}},
        seconds=9.0,
    )
    assert result.ok
    assert result.summary["refused"] == []
    away = max(simulation.view.error(t)[0] for t in result.truths[300:500])
    assert away > 0.01
    assert result.summary["view_error_m"] < 5e-3


def test_a_covered_tag_is_lost_and_found(watch):
    simulation, result = watch(
        {"at_s": 3.0, "rig/fault": {"kind": "cover", "target": "panel"}},
        {"at_s": 4.5, "rig/fault": {"kind": "cover", "target": "panel", "on": False}},
        seconds=6.0,
    )
    names = [e.name for e in simulation.events]
    assert "view_lost" in names
    assert names.index("view_found", names.index("view_lost")) > 0
    assert result.summary["limit_violations"] == 0


def test_some_sights_are_wrong_or_late_and_are_named(watch):
    simulation, _ = watch(seconds=8.0)
    said = " ".join(f"{e.detail} {e.values}" for e in simulation.events if e.name == REJECTED)
    assert "jump" in said
    assert "out_of_order" in said or "late" in said


def test_runs_with_cameras_watch_move_and_cover_and_put_all_back(seeing):
    kinds = set()
    for seed in range(6):
        steps = generate(seeing, seed).script.steps
        faults = [fault for s in steps if (fault := s.says(t.RIG_FAULT))]
        kinds |= {fault["kind"] for fault in faults if fault.get("on", True)}
        assert any(s.says(t.STORE_VIEW) for s in steps)
        switches = [switch for s in steps if (switch := s.says(t.SWITCH))]
        switched = [switch["on"] for switch in switches if switch["source"] == "vision"]
        assert switched[-1] is False
        for tag in ("panel", "hand"):
            covered = [f.get("on", True) for f in faults if f["target"] == tag]
            assert covered[-1] is False
    assert {"cover", "move"} <= kinds


def test_some_arms_have_a_gripper_and_let_go_in_the_end():
    gripping = [p for p in (generate(load_cell("pa10"), s) for s in range(20)) if _gripper(p)]
    assert 2 <= len(gripping) < 15
    for plan in gripping:
        assert grips(plan)[-1] is False
    assert any(closed for plan in gripping for closed in grips(plan))


def grips(plan):
    return [asked["closed"] for s in plan.script.steps if (asked := s.says(t.GRIPPER))]


def _gripper(plan):
    return plan.cell.config.mechanism.gripper is not None
