"""Two arms in one cell with what single arms have beside them: a Carrier, another operation mode,
another bus' trouble, a switch for all."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

LEFT, RIGHT = slice(0, 7), slice(7, 14)
UP = {"twist": [0.0, 0.0, 0.05, 0.0, 0.0, 0.0], "expressed_in": "world"}
BOTH_UP = [
    {"at_s": 0.2, "cmd/joystick": UP},
    {"at_s": 0.2, "cmd/joystick": {"task": "right", **UP}},
]


@pytest.fixture
def cell(two_arms):
    """Load two arms, the right one like another cell's, with more in the file."""

    def load(more="", like="pa10"):
        return load_cell(two_arms(like=("pa10", like), more=more))

    return load


def places(run, name, low, high):
    """Return the true places (t, 3) of an arm's tool between two times of the script [m]."""
    start = run.simulation.player.start_s
    return np.array(
        [t.arms[name].pose_mrf[:3] for t in run.truths if low <= t.time_s - start <= high]
    )


def test_both_arms_follow_a_carrier_that_moves(play, cell):
    moving = "[frames.carrier]\n[rig.frames.carrier]\ntwist = [0.02, 0.0, 0.0, 0.0, 0.0, 0.0]\n"
    # Where the tools stand at start, as seen from the Carrier, which is at World's origin then.
    goal = {"rpy": [0.0, 1.5708, 0.0], "relative_to": "carrier"}
    run = play(
        {"at_s": 0.2, "cmd/position": {"xyz": [0.668, 0.55, 0.4], **goal}},
        {"at_s": 0.2, "cmd/position": {"task": "right", "xyz": [0.668, -0.6, 0.4], **goal}},
        seconds=5.0,
        cell=cell(moving),
    )
    assert run.summary["failure"] is None
    assert run.summary["limit_violations"] == 0
    for name in ("left", "right"):
        at = places(run, name, 3.0, 5.0)
        np.testing.assert_allclose(at[-1] - at[0], [0.04, 0.0, 0.0], atol=1.5e-3)


@pytest.mark.parametrize("like", ["pa10_hand_torque", "ur5e"])
def test_arms_of_different_kinds_and_operation_modes_share_a_tick(play, cell, like):
    run = play(*BOTH_UP, seconds=2.0, cell=cell(like=like))
    assert (run.summary["failure"], run.summary["limit_violations"]) == (None, 0)
    for name in ("left", "right"):
        at = places(run, name, 0.5, 2.0)
        assert at[-1][2] - at[0][2] > 0.04
    assert run.states[-1].mode == "enabled"


def test_one_enabling_switch_stops_all_arms(play, cell):
    switch = '[enabling_switch]\nnode = 40\nbus = "other"\n'
    run = play(
        *BOTH_UP,
        {"at_s": 1.0, "rig/fault": {"kind": "push", "target": "enabling_switch", "on": False}},
        seconds=2.0,
        cell=cell(switch),
    )
    assert run.summary["mode"] == "hold"
    before = np.abs(run.speeds(0.9, 1.0))
    assert min(before[:, LEFT].max(), before[:, RIGHT].max()) > 0.01
    assert np.abs(run.speeds(1.6, 2.0)).max() < 1e-3
    assert run.summary["limit_violations"] == 0


def test_an_emergency_of_one_drive_names_it_and_stops_all(play, cell):
    fault = {"kind": "emcy", "target": "right.w2", "value": 0x8500}
    run = play(*BOTH_UP, {"at_s": 1.0, "rig/fault": fault}, seconds=2.0, cell=cell())
    told = run.events("fault")[0]
    assert told.values["device"] == "right.w2"
    assert told.values["cause"] == "emergency"
    assert np.abs(run.speeds(1.6, 2.0)).max() < 1e-3
    assert "operation_enabled" not in run.truths[-1].drives


def test_contact_of_one_arm_holds_both_and_that_arm_alone_gives_way(play, cell):
    fault = {"kind": "block", "target": "right.s2"}
    run = play(*BOTH_UP, {"at_s": 0.6, "rig/fault": fault}, seconds=2.5, cell=cell())
    touched = run.events("touched")[0].values
    assert (touched["mechanism"], touched["joint"]) == ("right", "right.s2")
    assert {e.values["mechanism"] for e in run.events("giving_way")} == {"right"}
    assert run.summary["mode"] == "hold"
    assert run.summary["limit_violations"] == 0
    left = np.abs(run.speeds(1.2, 2.5))[:, LEFT]
    assert left.max() < 2e-3


def test_a_drive_of_one_arm_that_restarts_stops_both_and_is_configured_anew(cell):
    steps = [
        *BOTH_UP,
        {"at_s": 2.0, "operator/mode": {"action": "reset"}},
        {"at_s": 4.5, "operator/mode": {"action": "enable"}},
    ]
    simulation = Simulation(cell(), Script.model_validate({"duration_s": 6.0, "step": steps}))
    restarted: list[float] = []

    def on_tick(now):
        start = now.player.start_s
        if start and now.clock.time_s > start + 1.0 and not restarted:
            restarted.append(now.clock.time_s)
            now.rig.nodes["right.e1"].boot()

    simulation.on_tick = on_tick
    run = Run(simulation, simulation.run())
    fault = run.events("fault")[0]
    assert fault.values["device"] == "right.e1"
    assert fault.values["cause"] in ("node_restarted", "state_lost")
    assert fault.time_s - restarted[0] < 0.05
    assert np.abs(run.speeds(1.6, 1.9)).max() < 1e-3
    assert run.summary["refused"] == []
    assert run.summary["mode"] == "enabled"
    late = np.abs(run.speeds(5.5, 6.0))
    assert min(late[:, LEFT].max(), late[:, RIGHT].max()) > 0.01, "both sticks are still held"
    assert run.summary["limit_violations"] == 0
