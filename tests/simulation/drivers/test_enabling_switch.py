"""An enabling switch on the bus: released or silent it stops the arm, and nothing enables it."""

import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.config.schema.bus import EnablingSwitchSection
from telerobot.server.telemetry import describe
from telerobot.tools.checks.cell import bus_load, worst_case_bits

from ..conftest import STICK

MOVING = {"at_s": 0.3, "cmd/joystick": STICK}
RELEASED = {"kind": "push", "target": "enabling_switch", "on": False}
HELD = {"kind": "push", "target": "enabling_switch"}


@pytest.fixture(scope="module")
def guarded(pa10):
    return altered(pa10, {"enabling_switch": EnablingSwitchSection(node=40)})


def reasons(run):
    return [e.values["reason"] for e in run.events("stopping")]


def test_releasing_the_switch_is_a_verified_stop_and_holding_it_again_moves_nothing(play, guarded):
    run = play(
        MOVING,
        {"at_s": 1.0, "rig/fault": RELEASED},
        {"at_s": 1.8, "operator/mode": {"action": "resume"}},
        {"at_s": 2.0, "rig/fault": HELD},
        {"at_s": 2.6, "operator/mode": {"action": "resume"}},
        seconds=3.2,
        cell=guarded,
    )
    assert run.summary["limit_violations"] == 0
    assert reasons(run) == ["enabling_switch released"]
    assert np.abs(run.speeds(0.9, 1.0)).max() > 0.02
    assert np.abs(run.speeds(1.6, 2.6)).max() < 1e-3
    assert [run.at(t).mode for t in (0.9, 1.9, 2.5, 3.1)] == ["enabled", "hold", "hold", "enabled"]
    assert np.abs(run.speeds(3.0, 3.2)).max() > 0.02
    assert [run.at(t).devices["enabling_switch"] for t in (0.9, 1.5)] == [
        {"held": True},
        {"held": False},
    ]


def test_nothing_is_enabled_while_the_switch_is_released(play, guarded):
    run = play(
        {"at_s": 0.1, "rig/fault": RELEASED},
        {"at_s": 0.3, "operator/lease": {}},
        {"at_s": 0.4, "operator/mode": {"action": "enable"}},
        {"at_s": 2.0, "rig/fault": HELD},
        {"at_s": 2.2, "operator/mode": {"action": "enable"}},
        seconds=3.0,
        cell=guarded,
        auto_enable=False,
    )
    assert [r for r in run.summary["refused"] if "enabling_switch released" in r]
    assert run.at(1.9).mode == "ready"
    assert run.at(2.9).mode == "enabled"


def test_a_broken_wire_stops_the_arm_before_the_heartbeat_is_missed(play, guarded):
    run = play(
        MOVING,
        {"at_s": 1.0, "rig/fault": {"kind": "silence", "target": "enabling_switch"}},
        seconds=2.0,
        cell=guarded,
    )
    assert reasons(run) == ["enabling_switch silent"]
    fault = run.events("fault")[0].values
    assert (fault["device"], fault["cause"]) == ("enabling_switch", "heartbeat_lost")
    assert np.abs(run.speeds(1.6, 2.0)).max() < 1e-3
    assert run.summary["limit_violations"] == 0


def test_operators_are_told_what_is_on_the_bus(guarded):
    *drives, sensor, switch = describe(guarded).buses["bus"]
    assert drives == [joint.name for joint in guarded.robot.joints]
    assert (sensor, switch) == ("force_torque", "enabling_switch")


def test_the_check_counts_its_frames(guarded, pa10):
    plain, more = (next(iter(bus_load(cell))).values for cell in (pa10, guarded))
    period = guarded.config.timing.period_s
    assert more["cyclic"] - plain["cyclic"] == pytest.approx(worst_case_bits(1) / period / 1e6)
    assert more["heartbeats"] > plain["heartbeats"]
