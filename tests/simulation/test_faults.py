"""Faults of hardware, loop and surroundings: which stop follows, and what is told.

Judged by the physics' own time and truth.
"""

import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.protocols.canopen import can301, cia402
from telerobot.protocols.canopen.cia402 import OperationMode
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from .conftest import REST, STICK

MOVING = {"at_s": 0.3, "cmd/joystick": STICK}


def assert_quick_stopped(run, joint, node):
    """Every drive is off or stopping, and one error names joint and node."""
    errors = [e for e in run.simulation.events if e.severity == "error"]
    assert len(errors) == 1
    assert errors[0].name == "fault"
    assert errors[0].values["device"] == joint
    assert errors[0].values["node"] == node
    assert run.summary["mode"] == "fault"
    return errors[0]


@pytest.mark.parametrize(
    ("fault", "causes"),
    [
        ({"kind": "silence", "target": "e1"}, {"pdo_lost", "heartbeat_lost"}),
        ({"kind": "fault", "target": "e1"}, {"drive_fault", "emergency"}),
        ({"kind": "emcy", "target": "e1"}, {"emergency", "drive_fault"}),
        ({"kind": "restart", "target": "e1"}, {"node_restarted"}),
    ],
)
def test_one_bad_drive_in_motion_quick_stops_them_all(play, fault, causes):
    run = play(MOVING, {"at_s": 1.2, "rig/fault": fault}, seconds=2.5)
    error = assert_quick_stopped(run, "e1", 4)
    assert error.values["cause"] in causes
    assert np.abs(run.speeds(1.1, 1.2)).max() > 0.02
    assert np.abs(run.speeds(2.0, 2.5)).max() < 1e-3
    states = run.states[-1].drives
    assert all(s != "operation_enabled" for i, s in enumerate(states) if i != 3)


def test_reset_works_only_after_the_cause_is_gone(play):
    run = play(
        MOVING,
        {"at_s": 1.0, "rig/fault": {"kind": "fault", "target": "e1"}},
        {"at_s": 2.0, "operator/mode": {"action": "reset"}},
        {"at_s": 6.0, "rig/fault": {"kind": "fault", "target": "e1", "on": False}},
        {"at_s": 6.2, "operator/mode": {"action": "reset"}},
        {"at_s": 7.0, "operator/mode": {"action": "enable"}},
        seconds=9.0,
    )
    assert run.at(5.9).mode == "fault"
    assert [r for r in run.summary["refused"] if "still_wrong" in r]
    assert len(run.summary["refused"]) == 1
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0


def test_a_drive_that_restarted_can_be_reset_and_obeys_again(play):
    """It has forgotten its PDOs, its mode, its limits: all are set anew."""
    run = play(
        MOVING,
        {"at_s": 1.0, "rig/fault": {"kind": "restart", "target": "e1"}},
        {"at_s": 2.0, "operator/mode": {"action": "reset"}},
        {"at_s": 4.0, "operator/mode": {"action": "enable"}},
        seconds=6.0,
    )
    assert run.at(1.9).mode == "fault"
    assert (run.summary["failure"], run.summary["refused"]) == (None, [])
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    assert np.abs(run.speeds(5.5, 6.0)[:, 3]).max() > 0.02, "the stick is still held"


def test_a_silent_drive_can_be_reset_once_it_speaks_again(play):
    run = play(
        MOVING,
        {"at_s": 1.0, "rig/fault": {"kind": "silence", "target": "w1"}},
        {"at_s": 2.0, "operator/mode": {"action": "reset"}},
        {"at_s": 5.5, "rig/fault": {"kind": "silence", "target": "w1", "on": False}},
        {"at_s": 6.0, "operator/mode": {"action": "reset"}},
        {"at_s": 8.0, "operator/mode": {"action": "enable"}},
        seconds=9.5,
    )
    assert run.at(5.4).mode == "fault"
    assert len([r for r in run.summary["refused"] if "still_wrong" in r]) == 1
    assert run.summary["mode"] == "enabled"


def test_a_joint_pushed_out_of_its_following_window_quick_stops_the_arm(play):
    run = play(
        MOVING,
        {"at_s": 1.0, "rig/fault": {"kind": "push", "target": "e1", "vector": [0.0, 0.0, -4000.0]}},
        seconds=1.6,
    )
    errors = [e for e in run.simulation.events if e.severity == "error"]
    assert errors[0].values["cause"] in ("following_error", "drive_fault", "emergency")
    assert errors[0].values["node"] in range(1, 8)
    assert run.summary["mode"] == "fault"


@pytest.fixture
def unfeeling(pa10):
    """The PA-10 without collision detection: what is left is the leash."""
    return altered(pa10, {"touch": None})


def test_a_blocked_elbow_is_met_by_the_leash_without_wind_up_or_jump(play, pa10, unfeeling):
    leash = pa10.config.mechanism.drives[3].leash
    run = play(
        {"at_s": 0.3, "cmd/jog": {"rates": [0, 0, 0, 0.1, 0, 0, 0]}},
        {"at_s": 1.0, "rig/fault": {"kind": "block", "target": "e1"}},
        {"at_s": 3.0, "rig/fault": {"kind": "block", "target": "e1", "on": False}},
        {"at_s": 3.5, "silence": ["cmd/jog"]},
        seconds=5.0,
        cell=unfeeling,
    )
    blocked = run.at(2.9)
    assert run.events("fault") == []
    assert "leash:e1" in blocked.limits
    assert 0.4 * leash < abs(blocked.following_error[3]) < 1.2 * leash
    assert abs(blocked.dq_command[3]) < 0.01
    # On release the joint comes back to its command and no further, at no more than its speed.
    after = run.speeds(3.0, 5.0)[:, 3]
    assert np.abs(after).max() <= 1.2 * pa10.config.mechanism.drives[3].max_velocity
    assert abs(run.states[-1].following_error[3]) < 1e-3
    assert run.states[-1].q_command[3] - blocked.q_command[3] < 0.1 * 0.5 + 0.02
    assert run.summary["limit_violations"] == 0


def test_motion_away_from_a_blocked_direction_is_free(play, unfeeling):
    run = play(
        {"at_s": 0.3, "cmd/jog": {"rates": [0, 0, 0, 0.1, 0, 0, 0]}},
        {"at_s": 1.0, "rig/fault": {"kind": "block", "target": "e1"}},
        {"at_s": 2.0, "cmd/jog": {"rates": [0, 0, 0, -0.1, 0, 0, 0]}},
        seconds=2.25,
        cell=unfeeling,
    )
    assert run.at(2.2).dq_command[3] == pytest.approx(-0.1, abs=0.01)


def test_a_blocked_elbow_is_felt_long_before_the_leash_is_spent(play, pa10):
    run = play(
        {"at_s": 0.3, "cmd/jog": {"rates": [0, 0, 0, 0.1, 0, 0, 0]}},
        {"at_s": 1.0, "rig/fault": {"kind": "block", "target": "e1"}},
        seconds=2.0,
    )
    (felt,) = run.events("touched")
    assert felt.values["joint"] == "e1"
    assert run.summary["mode"] == "hold"
    leash = pa10.config.mechanism.drives[3].leash
    assert max(abs(s.following_error[3]) for s in run.states) < 0.5 * leash


def test_the_daemons_heartbeat_is_produced_by_the_tick_in_its_period(pa10):
    simulation = Simulation(pa10, Script.model_validate({"duration_s": 2.0}))
    beats = []

    def on_sent(can_id, _data):
        if can_id == can301.heartbeat_id(can301.MASTER_NODE):
            beats.append(simulation.cycle.tick)

    simulation.cycle.plant.buses[0].taps.append(on_sent)
    simulation.run()
    timing = pa10.config.timing
    assert set(np.diff(beats)) == {round(timing.heartbeat_period_s / timing.period_s)}
    assert len(beats) > 1.5 / timing.heartbeat_period_s


def test_a_dead_daemon_leaves_drives_that_stop_by_themselves(pa10):
    """Killed or hung is the same on the bus: silence, for the tick makes the heartbeat too."""
    script = Script.model_validate({"duration_s": 1.0, "step": [MOVING]})
    simulation = Simulation(pa10, script)
    simulation.cycle.boot()
    while not simulation.player.over:
        simulation.step()
    last_setpoint_s = simulation.rig.time_s
    assert np.abs(simulation.rig.truth().dq).max() > 0.02
    timing = pa10.config.timing
    ramp_s = max(d.max_velocity / d.quick_stop_deceleration for d in pa10.config.mechanism.drives)
    simulation.rig.advance(timing.setpoint_timeout_s + timing.period_s + ramp_s)
    assert np.abs(simulation.rig.truth().dq).max() < 2e-3
    assert simulation.rig.time_s - last_setpoint_s < 0.4
    simulation.rig.advance(0.5)
    assert all(s != "operation_enabled" for s in simulation.rig.truth().drives)
    simulation.cycle.close()
    simulation.buses.hubs[0].close()


def test_a_stale_sensor_silences_the_force_source_and_says_so(play):
    run = play(
        {"at_s": 0.5, "rig/fault": {"kind": "silence", "target": "force_torque"}},
        {"at_s": 1.5, "rig/fault": {"kind": "silence", "target": "force_torque", "on": False}},
        seconds=2.5,
    )
    assert run.at(1.4).wrench_mrf is None
    assert run.at(1.4).sources["force"] == (0.0,) * 6
    assert run.at(2.4).wrench_mrf is not None
    assert len(run.events("sensor_stale")) == 1
    assert len(run.events("sensor_fresh")) >= 1
    assert run.summary["mode"] == "enabled"


def test_an_essential_sensor_that_falls_silent_stops_the_arm_until_it_is_back(play, pa10):
    run = play(
        MOVING,
        {"at_s": 1.0, "rig/fault": {"kind": "silence", "target": "force_torque"}},
        {"at_s": 2.0, "operator/mode": {"action": "resume"}},
        {"at_s": 2.5, "rig/fault": {"kind": "silence", "target": "force_torque", "on": False}},
        {"at_s": 3.0, "operator/mode": {"action": "resume"}},
        seconds=3.5,
        cell=altered(pa10, {"mechanism.force_torque.essential": True}),
    )
    assert run.at(1.9).mode == "hold"
    assert [r for r in run.summary["refused"] if "sensor_stale" in r]
    assert run.summary["mode"] == "enabled"


def test_a_sensor_that_restarted_is_started_again(play):
    run = play(
        MOVING,
        {"at_s": 1.0, "rig/fault": {"kind": "restart", "target": "force_torque"}},
        seconds=3.0,
    )
    assert run.events("sensor_stale")
    assert run.events("sensor_fresh")
    assert run.summary["mode"] == "enabled"
    assert run.at(2.9).wrench_mrf is not None


def test_late_ticks_in_a_row_stop_the_arm(pa10):
    script = Script.model_validate({"duration_s": 2.0, "step": [MOVING]})
    simulation = Simulation(pa10, script)
    tolerated = pa10.config.timing.tolerated_overruns

    def stall(s):
        if s.cycle.tick == 120:
            s.cycle.missed(tolerated + 1)

    simulation.on_tick = stall
    simulation.run()
    stopping = [e for e in simulation.events if e.name == "stopping"]
    assert [e.values["reason"] for e in stopping] == ["overruns"]
    assert simulation.cycle.mode == "hold"


def test_an_exception_in_the_tick_ends_in_a_quick_stop(pa10):
    script = Script.model_validate({"duration_s": 2.0, "step": [MOVING]})
    simulation = Simulation(pa10, script)

    def poison(s):
        if s.cycle.tick == 120:
            s.cycle.units.settings.speed_factor = None

    simulation.on_tick = poison
    result = simulation.run()
    assert result.summary["mode"] == "fault"
    errors = [e for e in simulation.events if e.severity == "error"]
    assert errors[0].name == "tick_raised"
    assert "TypeError" in errors[0].detail
    assert all(s != "operation_enabled" for s in result.truths[-1].drives)


def test_what_the_gate_refuses_is_never_sent_and_ends_in_a_quick_stop(pa10):
    script = Script.model_validate({"duration_s": 2.0, "step": [MOVING]})
    simulation = Simulation(pa10, script)

    def leap(s):
        if s.cycle.tick == 120:
            units = s.cycle.units
            commanded = units.memory.commanded
            motion = commanded.motion._replace(q=commanded.motion.q + 0.05)
            units.memory = units.memory._replace(commanded=commanded._replace(motion=motion))

    targets = []

    def on_sent(can_id, data):
        if can_id == can301.rpdo1_id(4):
            targets.append(cia402.COMMAND[OperationMode.CSP].unpack(data)[1])

    simulation.cycle.plant.buses[0].taps.append(on_sent)
    simulation.on_tick = leap
    result = simulation.run()
    errors = [e for e in simulation.events if e.severity == "error"]
    assert errors[0].name == "gate_refused"
    assert errors[0].values["device"] == "gate"
    assert result.summary["mode"] == "fault"
    counts_per_radian = pa10.config.mechanism.drives[3].counts_per_radian
    assert np.abs(np.diff(targets)).max() < 0.02 * counts_per_radian
    assert all(s != "operation_enabled" for s in result.truths[-1].drives)


def test_a_second_master_on_the_bus_quick_stops_the_arm(pa10):
    from telerobot.drivers.bus import InProcessBus

    script = Script.model_validate({"duration_s": 2.0, "step": [MOVING]})
    simulation = Simulation(pa10, script)
    intruder = InProcessBus(simulation.buses.hubs[0])

    def intrude(s):
        if s.cycle.tick == 120:
            intruder.put(0x80, b"")

    simulation.on_tick = intrude
    result = simulation.run()
    assert result.summary["mode"] == "fault"
    errors = [e for e in simulation.events if e.severity == "error"]
    assert errors[0].values["cause"] == "second_master"


@pytest.mark.parametrize("off", [500, 20000], ids=["near", "far"])
@pytest.mark.parametrize("first", [False, True], ids=["after", "before"])
def test_a_second_sender_of_a_drives_answers_quick_stops_the_arm(pa10, off, first):
    """Nobody knows which of the two is true: the stop needs neither, and a reset waits for one."""
    from telerobot.drivers.bus import InProcessBus

    script = Script.model_validate(
        {
            "duration_s": 3.0,
            "step": [MOVING, {"at_s": 2.0, "operator/mode": {"action": "reset"}}],
        }
    )
    simulation = Simulation(pa10, script)
    tpdo = can301.tpdo1_id(pa10.config.mechanism.drives[3].node)
    newest = {}

    def on_bus(frame):
        if frame[0] == tpdo:
            newest[tpdo] = cia402.unpack_feedback(frame[1])
        if frame[0] == (0x80 if first else tpdo) and len(newest) and on:
            told = newest[tpdo]
            data = cia402.FEEDBACK.pack(told.statusword, told.position + off, told.torque)
            spoofer.put(tpdo, data)

    on = []
    spoofer = InProcessBus(simulation.buses.hubs[0], on_bus)
    simulation.on_tick = lambda s: on.append(1) if s.cycle.tick == 120 else None
    result = simulation.run()
    spoofer.shutdown()
    errors = [e for e in simulation.events if e.severity == "error"]
    assert [e.values["cause"] for e in errors[:1]] == ["foreign_pdo"]
    assert errors[0].tick in (120, 121)
    assert result.summary["mode"] == "fault"
    assert result.summary["limit_violations"] == 0
    assert any("still_wrong" in r for r in result.summary["refused"])
    assert np.abs([t.dq for t in result.truths[-100:]]).max() < 1e-3


def test_enabling_does_not_move_a_joint_that_sagged(play, pa10):
    """A brake opens before its drive holds: joints sag, and are held where they have sagged."""
    cell = altered(pa10, {"rig.drive.torque_delay_s": 0.02})
    off = {"at_s": 0.0, "operator/switch": {"source": "force", "on": False}}
    run = play(off, seconds=1.5, cell=cell)
    start = np.array(pa10.config.mechanism.postures["start"])
    enabled = run.at(0.0)
    assert np.abs(np.array(enabled.q) - start).max() > 1e-3
    commands = np.array([s.q_command for s in run.states if s.mode == "enabled"])
    assert np.abs(commands[0] - np.array(enabled.q)).max() < 2e-3
    assert np.abs(np.diff(commands, axis=0)).max() / 0.01 < 0.05


def test_contact_beyond_the_threshold_in_hold_is_bled_off(play, pa10):
    """The wall is pushed with 45 N, then HOLD: force control alone goes on until little is left."""
    threshold = pa10.config.sources.force.hold_threshold
    run = play(
        {"at_s": 0.2, "cmd/posture": {"posture": "ready"}},
        {"at_s": 3.5, "cmd/joystick": {"twist": [0.034, 0, 0, 0, 0, 0], "expressed_in": "base"}},
        {"at_s": 9.0, "operator/mode": {"action": "hold"}},
        {"at_s": 9.0, "cmd/joystick": REST},
        seconds=12.0,
    )
    pressed = np.linalg.norm(run.at(8.9).wrench_mrf[:3])
    assert pressed > threshold
    assert run.summary["mode"] == "hold"
    assert np.linalg.norm(run.states[-1].wrench_mrf[:3]) < 0.5 * threshold
    moved = np.array(run.states[-1].pose_mrf[:3]) - run.at(9.5).pose_mrf[:3]
    assert np.linalg.norm(moved) <= pa10.config.sources.force.hold_leash + 1e-3
