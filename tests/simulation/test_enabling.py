"""Modes and drives agree: ENABLED means that every drive is on, READY that none is."""

import pytest
from laboratory.campaign.requests import ASKING, SETTLED_TICKS, STARTS, faults_of
from telerobot.protocols import topics as t
from telerobot.server.mode import Mode
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

ON = "operation_enabled"


@pytest.mark.parametrize(
    ("start", "first", "second", "apart"),
    [
        (Mode.ENABLED, "disable", "enable", 3),
        (Mode.ENABLED, "disable", "enable", 4),
        (Mode.HOLD, "disable", "enable", 2),
        (Mode.HOLD, "disable", "resume", 1),
        (Mode.READY, "enable", "disable", 4),
        (Mode.READY, "enable", "protective_stop", 7),
        (Mode.FAULT, "reset", "enable", 1),
    ],
)
def test_modes_and_drives_agree_whatever_two_things_are_asked(pa10, start, first, second, apart):
    assert faults_of(pa10, start, [(first, apart), (second, SETTLED_TICKS)]) == []


@pytest.mark.parametrize("start", STARTS, ids=str)
def test_modes_and_drives_agree_whatever_is_asked(start):
    """One seed of those that `make campaign ARGS="--only requests"` plays."""
    assert ASKING.play(("pa10", start, 0)).reasons == []


def test_enable_thirty_milliseconds_after_disable_ends_enabled_with_every_drive_on(play):
    run = play(
        {"at_s": 0.5, "operator/mode": {"action": "disable"}},
        {"at_s": 0.53, "operator/mode": {"action": "enable"}},
        seconds=1.2,
    )
    assert run.summary["refused"] == []
    last = run.states[-1]
    assert (last.mode, set(last.drives)) == ("enabled", {ON})
    off = [s for s in run.states if s.mode == "ready" and s.time_s > run.at(0.5).time_s]
    assert any(ON not in s.drives for s in off)


@pytest.fixture
def arm(pa10):
    """An arm that an operator drives, tick by tick."""
    simulation = Simulation(pa10, Script.model_validate({"duration_s": 60}))
    simulation.cycle.boot()
    while simulation.cycle.mode is not Mode.ENABLED:
        simulation.step()
    yield simulation
    simulation.cycle.close()
    simulation.buses.hubs[0].close()


def test_disable_is_answered_once_the_drives_have_said_that_they_are_off(arm):
    replies = []
    arm.player.client.request(t.MODE, replies.append, action="disable")
    while not replies:
        arm.step()
    assert replies[0].ok
    assert arm.cycle.mode is Mode.READY
    assert ON not in arm.rig.truth().drives
    assert all(s in ("switch_on_disabled", "ready_to_switch_on") for s in arm.states[-1].drives)


@pytest.mark.parametrize("ask", [None, "hold"])
def test_a_drive_that_switches_off_in_an_energised_mode_is_a_fault_within_two_ticks(arm, ask):
    """Also where it was this daemon that told it: what counts is where the drive is."""
    if ask is not None:
        arm.player.client.request(t.MODE, lambda _reply: None, action=ask)
        for _ in range(20):
            arm.step()
        assert arm.cycle.mode is Mode.HOLD
    off = 0
    while arm.cycle.mode.energised:
        arm.cycle.plant.drives[3].request_disable()
        arm.step()
        off += arm.rig.truth().drives[3] != ON
        assert off <= 2
    assert arm.cycle.mode is Mode.FAULT
    (fault,) = [e for e in arm.events if e.name == "fault"]
    assert fault.values["device"] == "e1"
    assert fault.values["cause"] == "state_lost"


def test_a_protective_stop_ends_an_enable_that_is_under_way(arm):
    client, replies = arm.player.client, []
    client.request(t.MODE, lambda _reply: None, action="disable")
    for _ in range(30):
        arm.step()
    client.request(t.MODE, replies.append, action="enable")
    for _ in range(4):
        arm.step()
    assert arm.cycle.mode is Mode.READY
    client.protective_stop(lambda _reply: None)
    for _ in range(3):
        arm.step()
    client.clear_protective_stop(lambda _reply: None)
    for _ in range(40):
        arm.step()
    assert [(r.ok, r.reason, r.detail) for r in replies] == [(False, "not_now", "protective stop")]
    assert arm.cycle.mode is Mode.READY
    assert ON not in arm.rig.truth().drives
