"""Dead, hung and frozen processes: what the arm does is judged by the physics, not by the wall."""

import signal
import socket
import subprocess
import sys

import numpy as np
import pytest
from telerobot import OperatorError
from telerobot.tools.host.address import moved, options
from telerobot.tools.host.machine import free_port

OPERATOR = """
import sys
from telerobot import Operator

with Operator("pa10", endpoint=sys.argv[1], name="remote") as operator:
    operator.acquire()
    operator.enable()
    operator.joystick([0, 0.05, 0.02, 0, 0, 0.1], seconds=600, expressed_in="base")
"""


def speed(truth):
    return float(np.abs(truth.dq).max())


def moving(plant):
    plant.until(lambda: speed(plant.truth) > 0.03, 10.0, "the arm does not move")


def drive(plant):
    operator = plant.enabled_operator()
    operator.joystick([0, 0.05, 0.02, 0, 0, 0.1], expressed_in="base")
    moving(plant)
    return operator


def ramp_s(plant):
    """Return how long the slowest quick-stop ramp takes from full speed [s]."""
    drives = plant.cell.config.mechanism.drives
    return max(d.max_velocity / d.quick_stop_deceleration for d in drives)


@pytest.mark.hil
@pytest.mark.parametrize("death", ["kill9_daemon", "stop_daemon"])
def test_drives_stop_by_themselves_when_the_daemon_is_killed_or_hangs(plant, death):
    drive(plant)
    timing = plant.cell.config.timing
    syncs, died_s = plant.truth.sync_count, plant.truth.time_s
    getattr(plant, death)()
    within = timing.setpoint_timeout_s + 3 * timing.period_s + ramp_s(plant)
    plant.until(lambda: speed(plant.truth) < 2e-3, 5.0, "the arm goes on")
    # Up to two truths a period apart, and what was on its way, came after the death.
    assert plant.truth.time_s - died_s < within + 0.1
    assert plant.truth.sync_count - syncs <= 10
    plant.until(
        lambda: all(d != "operation_enabled" for d in plant.truth.drives), 5.0, "still energised"
    )


@pytest.mark.hil
def test_a_daemon_that_wakes_up_finds_its_drives_stopped_and_says_fault(plant):
    operator = drive(plant)
    plant.stop_daemon()
    plant.until(
        lambda: all(d != "operation_enabled" for d in plant.truth.drives), 5.0, "still energised"
    )
    rested = np.array(plant.truth.q)
    plant.cont_daemon()
    plant.until(lambda: operator.state.mode == "fault", 5.0, "no fault is told")
    plant.run_for(0.5)
    assert np.abs(np.array(plant.truth.q) - rested).max() < 1e-3
    assert [e for e in operator.events if e.name == "fault" and e.values["node"]]


@pytest.mark.hil
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_an_operator_that_is_killed_or_frozen_loses_the_arm(plant, end):
    watcher = plant.operator("watcher")
    plant.wait_wall(lambda: watcher.state.mode == "ready", "not ready")
    remote = subprocess.Popen(
        [sys.executable, "-c", OPERATOR, plant.cell.config.zenoh.listen],
        stderr=subprocess.PIPE,
    )
    try:
        moving(plant)
        remote.send_signal(end)
        # A daemon that ran late may hold before: the lease ends in its own time.
        plant.until(lambda: watcher.state.lease_holder is None, 3.0, "the lease does not end")
        plant.until(lambda: watcher.state.mode == "hold", 3.0, "the arm does not hold")
        plant.until(lambda: speed(plant.truth) < 2e-3, 1.0, "the arm goes on")
        assert [e for e in watcher.events if e.name == "lease_expired"]
        if end == signal.SIGSTOP:
            held = np.array(plant.truth.q)
            remote.send_signal(signal.SIGCONT)
            plant.run_for(1.0)
            assert np.abs(np.array(plant.truth.q) - held).max() < 1e-3
            assert watcher.state.mode == "hold"
        watcher.acquire()
        watcher.enable()
        assert watcher.state.lease_holder == "watcher"
    finally:
        remote.kill()
        remote.communicate()


@pytest.mark.hil
def test_one_silent_drive_stops_them_all_and_is_reset_once_it_speaks(plant):
    operator = drive(plant)
    plant.inject("silence", "e1")
    plant.until(lambda: operator.state.mode == "fault", 3.0, "no fault")
    plant.until(lambda: speed(plant.truth) < 2e-3, 2.0, "the arm goes on")
    faults = [e for e in operator.events if e.name == "fault"]
    assert (faults[0].values["device"], faults[0].values["node"]) == ("e1", 4)
    plant.inject("silence", "e1", on=False)
    plant.run_for(0.2)
    operator.reset()
    operator.enable()
    plant.until(lambda: operator.state.mode == "enabled", 3.0, "not enabled again")


@pytest.mark.hil
def test_a_daemon_told_to_end_in_motion_stops_the_arm_and_switches_it_off(plant):
    drive(plant)
    plant.daemon.terminate()
    plant.until(lambda: plant.daemon.poll() is not None, 10.0, "the daemon does not end")
    assert plant.daemon.returncode == 0
    assert "leaked" not in plant.complaints()
    plant.run_for(0.2)
    assert speed(plant.truth) < 2e-3
    assert all(d != "operation_enabled" for d in plant.truth.drives)


@pytest.mark.hil
def test_a_rig_that_gets_no_processor_is_the_witness_of_a_machine_that_stood_still(make_plant):
    plant = make_plant()
    plant.run_for(0.2)
    before = plant.truth.sync_count
    plant.rig.send_signal(signal.SIGSTOP)
    with pytest.raises(subprocess.TimeoutExpired):
        plant.rig.wait(0.3)
    plant.rig.send_signal(signal.SIGCONT)
    plant.until(lambda: plant.truth.sync_count > before, 5.0, "no physics")
    plant.stop()
    assert plant.lost_ms >= 200


@pytest.mark.hil
def test_a_rig_that_is_lost_is_a_fault_and_one_that_comes_later_is_taken_up(plant):
    operator = drive(plant)
    plant.rig.kill()
    plant.rig.wait()
    plant.rig = None
    plant.wait_wall(lambda: operator.state.mode == "fault", "no fault is told")
    with pytest.raises(OperatorError) as caught:
        operator.reset()
    assert caught.value.reason == "still_wrong"
    plant.start_rig()
    time_s = plant.truth.time_s
    plant.wait_wall(lambda: plant.truth.time_s < time_s, "the new rig tells no truth")
    operator.reset()
    operator.enable()
    operator.joystick([0, 0.05, 0.02, 0, 0, 0.1], expressed_in="base")
    moving(plant)


@pytest.mark.hil
def test_a_second_daemon_waits_and_leaves_the_arm_to_the_first(plant, tmp_path):
    operator = drive(plant)
    endpoint = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    second_cell = moved(plant.cell, endpoint=endpoint)
    command = [sys.executable, "-m", "telerobot.tools.cli", "serve", *options(second_cell)]
    log = tmp_path / "second"
    with log.open("w") as errors:
        second = subprocess.Popen(command, stderr=errors)
    try:
        plant.wait_wall(lambda: "waiting: bus: someone else" in log.read_text(), "it says nothing")
        second.terminate()
        plant.wait_wall(lambda: second.poll() is not None, "it does not end")
    finally:
        second.kill()
        second.wait()
    assert second.returncode == 0
    plant.run_for(0.3)
    assert [e for e in operator.events if e.severity == "error"] == []
    assert all(d == "operation_enabled" for d in plant.truth.drives)
