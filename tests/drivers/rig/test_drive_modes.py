"""The simulated drive in CSV and CST: hand-over at enable, limits, silence and quick stop."""

import numpy as np
import pytest
from telerobot.protocols.canopen.can301 import Abort
from telerobot.protocols.canopen.cia402 import (
    Controlword,
    DriveState,
    Object,
    OperationMode,
    Status,
)

from .conftest import PERIOD_S, Master

JOINT, INDEX = "e1", 3
OTHERS = ("s1", "s2", "s3", "e2", "w1", "w2")


def raw_torque(master: Master, joint: str, torque: float) -> int:
    drive = master.drives[joint]
    return round(drive.direction * torque / drive.rated_torque * 1000)


def hold(master: Master) -> None:
    """Ask every joint for the torque that gravity takes."""
    for i, joint in enumerate(master.drives):
        torque = float(master.rig.world.data.qfrc_bias[i])
        master.targets[joint] = raw_torque(master, joint, torque)


@pytest.fixture
def torques(master: Master) -> Master:
    """Return a master whose drives are enabled in CST and hold against gravity."""
    master.mode = OperationMode.CST
    master.enable(hold)
    return master


@pytest.fixture
def speeds(master: Master) -> Master:
    master.mode = OperationMode.CSV
    master.enable(lambda m: m.targets.update(dict.fromkeys(m.drives, 0)))
    return master


def test_in_cst_the_torque_that_stands_at_enabling_holds_the_arm(torques: Master) -> None:
    start = np.array(torques.cell.config.mechanism.postures["start"])
    assert {torques.state(j) for j in torques.drives} == {DriveState.OPERATION_ENABLED}
    for _ in range(20):
        hold(torques)
        torques.cycle()
    assert np.abs(torques.rig.world.q - start).max() < 0.02
    assert np.abs(torques.rig.world.dq).max() < 0.02


def test_in_cst_a_motor_gives_what_is_asked_up_to_its_limit(torques: Master) -> None:
    drive = torques.drives[JOINT]
    for asked in (5.0, -5.0, 10.0 * drive.max_torque):
        torques.targets[JOINT] = raw_torque(torques, JOINT, asked)
        torques.cycle(2)
        torques.send(0x080)
        given = torques.rig.world.data.ctrl[INDEX]
        assert given == pytest.approx(min(asked, drive.max_torque), abs=0.06)
    assert torques.feedback(JOINT).statusword & Status.INTERNAL_LIMIT


def test_in_cst_the_drive_keeps_its_top_speed(torques: Master) -> None:
    drive = torques.drives["w2"]
    torques.targets["w2"] = raw_torque(torques, "w2", 10.0)
    for _ in range(60):
        torques.cycle()
    top = 1.2 * drive.max_velocity
    assert 0.9 * top < abs(torques.rig.world.dq[6]) <= 1.01 * top


@pytest.mark.parametrize("cause", ["quick stop", "silence", "master"])
def test_in_cst_a_moving_joint_is_braked_by_the_drives_own_ramp(
    torques: Master, cause: str
) -> None:
    deceleration = torques.drives["w2"].quick_stop_deceleration
    torques.targets["w2"] = raw_torque(torques, "w2", 3.0)
    while abs(torques.rig.world.dq[6]) < 1.0:
        torques.cycle()
    before = torques.rig.world.q.copy()
    if cause == "quick stop":
        torques.command(Controlword.QUICK_STOP)
    elif cause == "silence":
        torques.silent.update(torques.drives)
    else:
        torques.beating = False
    speed = []
    for _ in range(80):
        torques.cycle()
        speed.append(abs(float(torques.rig.world.dq[6])))
    slower = -np.diff(speed)
    ramp = float(np.median(slower[slower > 0.1 * slower.max()])) / PERIOD_S
    assert ramp == pytest.approx(deceleration, rel=0.15)
    assert speed[-1] < 1e-3
    assert np.abs(torques.rig.world.q[:6] - before[:6]).max() < 0.05
    assert torques.rig.drives["w2"].state is not DriveState.OPERATION_ENABLED


def test_a_quick_stop_in_cst_starts_from_the_torque_that_stands(torques: Master) -> None:
    # An arm that stands has ramped down at once: told to stay, its drives hold it then.
    torques.write(JOINT, Object.QUICK_STOP_OPTION, 0, "<h", 6)
    for _ in range(10):
        hold(torques)
        torques.cycle()
    stood = torques.rig.world.data.ctrl.copy()
    torques.command(Controlword.QUICK_STOP)
    torques.cycle()
    torques.send(0x080)
    torques.rig.step()
    assert np.abs(torques.rig.world.data.ctrl[INDEX] - stood[INDEX]) < 1.0


def test_in_csv_the_joint_runs_at_the_speed_asked_for_and_stops_on_silence(speeds: Master) -> None:
    drive = speeds.drives[JOINT]
    asked = -0.4
    speeds.targets[JOINT] = round(asked * drive.direction * drive.counts_per_radian)
    speeds.cycle(40)
    assert speeds.rig.world.dq[INDEX] == pytest.approx(asked, rel=0.01)
    speeds.silent.add(JOINT)
    speeds.cycle(30)
    assert abs(speeds.rig.world.dq[INDEX]) < 1e-3
    assert speeds.state(JOINT) is DriveState.FAULT


def test_in_csv_a_freed_joint_does_not_catch_up_with_what_it_missed(speeds: Master) -> None:
    world, drive = speeds.rig.world, speeds.drives[JOINT]
    world.set_jam(INDEX, jammed=True)
    speeds.targets[JOINT] = round(-0.3 * drive.direction * drive.counts_per_radian)
    speeds.cycle(100)
    assert speeds.state(JOINT) is DriveState.OPERATION_ENABLED
    missed = 0.3
    start = float(world.q[INDEX])
    speeds.targets[JOINT] = 0
    speeds.cycle(5)
    world.set_jam(INDEX, jammed=False)
    speeds.cycle(50)
    assert abs(world.q[INDEX] - start) < 0.2 * missed


@pytest.mark.parametrize("mode", [OperationMode.CSP, OperationMode.CSV, OperationMode.CST])
def test_the_mode_stays_while_the_power_is_on(master: Master, mode: OperationMode) -> None:
    master.mode = mode
    master.enable(hold if mode is OperationMode.CST else None)
    other = OperationMode.CSP if mode is OperationMode.CST else OperationMode.CST
    answer = master.write(JOINT, Object.MODE_OF_OPERATION, 0, "<b", other)
    assert answer[0] == 0x80
    assert master.read(JOINT, Object.MODE_DISPLAY, 0, "<b") == mode


def test_a_mode_that_the_drive_lacks_is_refused_and_without_any_it_cannot_be_enabled(
    master: Master,
) -> None:
    master.enable()
    master.command(Controlword.DISABLE_VOLTAGE)
    master.cycle(2)
    answer = master.write(JOINT, Object.MODE_OF_OPERATION, 0, "<b", 3)
    assert int.from_bytes(answer[4:], "little") == Abort.INVALID_VALUE
    assert master.read(JOINT, Object.MODE_DISPLAY, 0, "<b") == OperationMode.CSP
    master.write(JOINT, Object.MODE_OF_OPERATION, 0, "<b", 0)
    for word in (Controlword.SHUTDOWN, Controlword.SWITCH_ON, Controlword.ENABLE_OPERATION):
        master.command(word)
        master.cycle(5)
    assert master.state(JOINT) is DriveState.SWITCHED_ON
    assert master.state("e2") is DriveState.OPERATION_ENABLED
