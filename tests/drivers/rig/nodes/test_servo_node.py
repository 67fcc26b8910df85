"""The simulated drive through its frames: what a control server sees of it."""

import math
import struct

import numpy as np
import pytest
from telerobot.config.load import Cell, altered
from telerobot.protocols.canopen import can301, cia402
from telerobot.protocols.canopen.can301 import EmcyCode, NmtCommand, NmtState
from telerobot.protocols.canopen.cia402 import Controlword, DriveState, Object, Status
from telerobot.protocols.messages.rig import RigFault

from ..conftest import PERIOD_S, Master

JOINT = "e1"
ABORTED = 0x80


def sagging(cell: Cell) -> Cell:
    """Return the cell with drives that open their brakes before they hold their joints."""
    return altered(cell, {"rig.drive.torque_delay_s": 0.02})


def move(master: Master, joint: str, speed: float, periods: int) -> None:
    """Stream setpoints at a constant speed [rad/s], starting from where the target is."""
    drive = master.drives[joint]
    step = speed * PERIOD_S * drive.direction * drive.counts_per_radian
    start = master.targets[joint]
    for k in range(1, periods + 1):
        master.targets[joint] = start + round(k * step)
        master.cycle()


# --- the CANopen slave --------------------------------------------------------------------------


def test_a_drive_whose_only_frames_are_syncs_and_setpoints_comes_on_and_stops_in_time(
    master: Master,
) -> None:
    """No heartbeat of anybody's makes it look what is due."""
    master.beating = False
    master.configure()
    for joint in master.drives:
        master.write(joint, can301.CommunicationObject.PRODUCER_HEARTBEAT, 0, "<H", 0)
    master.cycle(5)
    for word in (Controlword.SHUTDOWN, Controlword.SWITCH_ON, Controlword.ENABLE_OPERATION):
        master.command(word)
        for _ in range(6):
            master.seed()
            master.cycle()
    assert master.state(JOINT) is DriveState.OPERATION_ENABLED
    master.command(Controlword.QUICK_STOP)
    master.cycle(4)
    assert master.state(JOINT) is DriveState.SWITCH_ON_DISABLED


def test_every_node_announces_itself_once(master: Master) -> None:
    for drive in master.drives.values():
        beats = [d for _, i, d in master.frames if i == can301.heartbeat_id(drive.node)]
        assert beats == [bytes((NmtState.BOOT_UP,))]
    master.nmt(NmtCommand.RESET_NODE)
    for drive in master.drives.values():
        assert master.newest(can301.heartbeat_id(drive.node)) == bytes((NmtState.BOOT_UP,))


def test_a_reset_node_has_its_defaults_again(master: Master) -> None:
    master.write(JOINT, Object.SETPOINT_TIMEOUT, 0, "<H", 80)
    assert master.read(JOINT, Object.SETPOINT_TIMEOUT, 0, "<H") == 80
    master.nmt(NmtCommand.RESET_COMMUNICATION, master.node(JOINT))
    assert master.read(JOINT, Object.SETPOINT_TIMEOUT, 0, "<H") == 80
    master.nmt(NmtCommand.RESET_NODE, master.node(JOINT))
    assert master.read(JOINT, Object.SETPOINT_TIMEOUT, 0, "<H") == 0


@pytest.mark.parametrize(
    ("index", "sub", "layout", "value", "code"),
    [
        (0x2345, 0, "<H", 1, 0x06020000),
        (Object.POSITION_LIMIT, 9, "<i", 1, 0x06090011),
        (Object.STATUSWORD, 0, "<H", 1, 0x06010002),
        (Object.CONTROLWORD, 0, "<I", 1, 0x06070010),
        (0x1600, 1, "<I", 0x60400010, 0x08000022),
    ],
)
def test_a_wrong_write_is_refused_with_its_own_code_and_object(
    master: Master, index: int, sub: int, layout: str, value: int, code: int
) -> None:
    answer = master.write(JOINT, index, sub, layout, value)
    assert struct.unpack("<BHBI", answer) == (ABORTED, index, sub, code)


def test_a_name_longer_than_a_frame_comes_in_segments(master: Master) -> None:
    node = master.node(JOINT)
    request, reply = can301.sdo_request_id(node), can301.sdo_reply_id(node)
    master.send(request, struct.pack("<BHB4x", 0x40, 0x1008, 0))
    (size,) = struct.unpack_from("<I", master.newest(reply), 4)
    name, toggle = b"", 0
    while len(name) < size:
        master.send(request, bytes((0x60 | toggle,)).ljust(8, b"\0"))
        answer = master.newest(reply)
        name += answer[1 : 8 - (answer[0] >> 1 & 7)]
        toggle ^= 0x10
    assert name == b"simulated servo drive"


def test_only_the_configured_pdo_answers_sync(master: Master) -> None:
    master.configure()
    before = len(master.frames)
    master.send(can301.SYNC_ID)
    heard = [i for _, i, _ in master.frames[before:] if 0x180 <= i < 0x580]
    assert heard == [can301.tpdo1_id(d.node) for d in master.drives.values()]


def test_an_unconfigured_node_floods_the_bus_with_its_default_pdos(master: Master) -> None:
    master.nmt(NmtCommand.START)
    before = len(master.frames)
    master.send(can301.SYNC_ID)
    assert sum(0x180 <= i < 0x580 for _, i, _ in master.frames[before:]) == 3 * len(master.drives)


def test_heartbeats_keep_their_period_in_physics_time(master: Master) -> None:
    master.write(JOINT, 0x1017, 0, "<H", 50)
    beat = can301.heartbeat_id(master.node(JOINT))
    start = master.count(beat)
    master.rig.advance(1.0)
    master.listen()
    assert 19 <= master.count(beat) - start <= 20


# --- the drive ----------------------------------------------------------------------------------


def test_a_drive_holds_its_joint_before_it_opens_the_brake(master: Master) -> None:
    start = master.rig.world.q.copy()
    master.enable()
    assert {master.state(j) for j in master.drives} == {DriveState.OPERATION_ENABLED}
    master.cycle(50)
    assert np.abs(master.rig.world.q - start).max() < 1e-3


def test_a_wrongly_set_drive_sags_a_little_and_holds_without_a_jump(cell: Cell) -> None:
    master = Master(sagging(cell))
    start = master.rig.world.q.copy()
    master.enable()
    assert {master.state(j) for j in master.drives} == {DriveState.OPERATION_ENABLED}
    moved = np.abs(master.rig.world.q - start)
    assert 1e-4 < moved.max() < 0.02
    held = master.rig.world.q.copy()
    master.cycle(50)
    assert np.abs(master.rig.world.q - held).max() < 5e-3
    master.close()


def test_enabled_is_reported_only_once_the_brake_is_open(master: Master) -> None:
    master.configure()
    master.cycle(2)
    master.seed()
    for word in (Controlword.SHUTDOWN, Controlword.SWITCH_ON):
        master.command(word)
        master.cycle(3)
    master.command(Controlword.ENABLE_OPERATION)
    states = []
    for _ in range(6):
        master.seed()
        master.cycle()
        states.append(master.state(JOINT))
    assert states[0] is states[1] is DriveState.SWITCHED_ON
    assert states[-1] is DriveState.OPERATION_ENABLED


def test_csp_tracks_a_moving_setpoint_within_a_milliradian(enabled: Master) -> None:
    enabled.cycle(60)
    target = enabled.rig.world.q[3]
    speed, ramp = 0.8, 20
    errors = []
    for k in range(100):
        due = target  # applied at the SYNC that comes next, reached one period after it
        target -= speed * min(1.0, (k + 1) / ramp) * PERIOD_S
        enabled.aim(JOINT, target)
        enabled.cycle()
        errors.append(abs(enabled.rig.world.q[3] - due))
    assert max(errors) < 1.5e-3
    assert max(errors[50:]) < 5e-4
    # sampled before the SYNC that starts the way to the last setpoint: two periods behind it
    assert enabled.position(JOINT) - target == pytest.approx(2 * speed * PERIOD_S, abs=1e-3)


@pytest.mark.parametrize("joint", ["s2", "e1", "w1", "w2"])
def test_position_and_torque_keep_the_drives_own_sign_and_zero(enabled: Master, joint: str) -> None:
    enabled.cycle(60)
    index = list(enabled.drives).index(joint)
    world = enabled.rig.world
    assert enabled.position(joint) == pytest.approx(world.q[index], abs=1e-5)
    drive = enabled.drives[joint]
    torque = enabled.feedback(joint).torque * 1e-3 * drive.rated_torque * drive.direction
    gravity = world.data.qfrc_bias[index]
    assert torque == pytest.approx(gravity, abs=5.0)


def test_a_held_arm_does_not_droop(enabled: Master) -> None:
    enabled.cycle(60)
    for joint in enabled.drives:
        drive = enabled.drives[joint]
        lag = (enabled.targets[joint] - enabled.feedback(joint).position) / drive.counts_per_radian
        assert abs(lag) < 2e-4


def test_quick_stop_ramps_down_then_takes_the_power(enabled: Master) -> None:
    move(enabled, JOINT, -0.6, 40)
    deceleration = enabled.drives[JOINT].quick_stop_deceleration
    enabled.command(Controlword.QUICK_STOP, JOINT)
    speeds, states = [], []
    for _ in range(9):
        enabled.cycle()
        speeds.append(abs(enabled.rig.world.dq[3]))
        states.append(enabled.state(JOINT))
    assert speeds[0] == pytest.approx(0.6, abs=0.02)
    assert np.min(np.diff(speeds)) > -1.3 * deceleration * PERIOD_S
    assert speeds[-1] < 0.02
    assert states[2] is DriveState.QUICK_STOP_ACTIVE
    assert states[-1] is DriveState.SWITCH_ON_DISABLED


def test_quick_stop_option_6_stays_in_quick_stop(enabled: Master) -> None:
    enabled.write(JOINT, Object.QUICK_STOP_OPTION, 0, "<h", 6)
    enabled.command(Controlword.QUICK_STOP, JOINT)
    enabled.cycle(20)
    assert enabled.state(JOINT) is DriveState.QUICK_STOP_ACTIVE


def test_silence_of_setpoints_stops_the_drive_by_physics_time(enabled: Master) -> None:
    move(enabled, JOINT, -0.4, 20)
    enabled.silent.add(JOINT)
    last = enabled.rig.time_s - PERIOD_S
    enabled.cycle(25)
    stamp = next(t for t, i, _ in enabled.frames if i == can301.emcy_id(enabled.node(JOINT)))
    assert 0.080 <= stamp - last <= 0.080 + 2 * PERIOD_S
    assert enabled.emergencies(JOINT) == [EmcyCode.SETPOINT_TIMEOUT]
    assert enabled.state(JOINT) is DriveState.FAULT
    assert enabled.state("s1") is DriveState.OPERATION_ENABLED


def test_a_dead_master_is_noticed_and_6007_decides(enabled: Master) -> None:
    enabled.write("s1", Object.ABORT_CONNECTION_OPTION, 0, "<h", 3)
    enabled.beating = False
    enabled.cycle(60)
    nodes = enabled.rig.drives
    assert enabled.emergencies(JOINT) == [EmcyCode.HEARTBEAT]
    assert enabled.emergencies("s1") == [EmcyCode.HEARTBEAT]
    assert {n.nmt for n in nodes.values()} == {NmtState.PRE_OPERATIONAL}
    status = enabled.read(JOINT, Object.STATUSWORD, 0, "<H")
    assert cia402.decode_state(status) is DriveState.FAULT
    status = enabled.read("s1", Object.STATUSWORD, 0, "<H")
    assert cia402.decode_state(status) is DriveState.SWITCH_ON_DISABLED


def test_a_fault_is_reset_by_the_rising_edge_and_only_when_its_cause_is_gone(
    enabled: Master,
) -> None:
    enabled.rig.inject(RigFault(kind="fault", target=JOINT))
    enabled.cycle(2)
    assert enabled.state(JOINT) is DriveState.FAULT

    def reset() -> DriveState:
        enabled.command(Controlword.DISABLE_VOLTAGE, JOINT)
        enabled.cycle(2)
        enabled.command(Controlword.FAULT_RESET, JOINT)
        enabled.cycle(3)
        return enabled.state(JOINT)

    assert reset() is DriveState.FAULT
    enabled.rig.inject(RigFault(kind="fault", target=JOINT, on=False))
    enabled.cycle(5)  # bit 7 is high all the time: no edge
    assert enabled.state(JOINT) is DriveState.FAULT
    assert reset() is DriveState.SWITCH_ON_DISABLED
    assert enabled.emergencies(JOINT) == [EmcyCode.OVERCURRENT, EmcyCode.NO_ERROR]


def test_a_blocked_joint_ends_in_a_following_error(enabled: Master) -> None:
    enabled.rig.inject(RigFault(kind="block", target=JOINT))
    move(enabled, JOINT, -0.8, round(enabled.drives[JOINT].window / 0.8 / PERIOD_S) + 5)
    enabled.cycle(10)
    assert enabled.emergencies(JOINT) == [EmcyCode.FOLLOWING_ERROR]
    assert enabled.state(JOINT) is DriveState.FAULT
    assert enabled.feedback(JOINT).statusword & Status.FOLLOWING_ERROR


def test_a_target_beyond_the_software_limit_is_cut_and_reported(enabled: Master) -> None:
    here = enabled.feedback(JOINT).position
    drive = enabled.drives[JOINT]
    reach = round(0.05 * drive.counts_per_radian)
    enabled.write(JOINT, Object.POSITION_LIMIT, 1, "<i", here - reach)
    enabled.write(JOINT, Object.POSITION_LIMIT, 2, "<i", here + reach)
    move(enabled, JOINT, 0.5, 20)
    enabled.cycle(40)
    assert enabled.feedback(JOINT).statusword & Status.INTERNAL_LIMIT
    assert abs(enabled.feedback(JOINT).position - here) == pytest.approx(reach, rel=0.02)


def test_one_lost_setpoint_is_bridged(enabled: Master) -> None:
    move(enabled, JOINT, -0.5, 30)
    speed = enabled.rig.world.dq[3]
    enabled.silent.add(JOINT)
    enabled.cycle()
    assert enabled.rig.world.dq[3] == pytest.approx(speed, abs=0.05)
    assert math.isfinite(speed)
    enabled.silent.clear()
    enabled.cycle(30)
    assert enabled.state(JOINT) is DriveState.OPERATION_ENABLED
