"""What a drive says counts from when it was told; and its position limits leave room to enable."""

import struct
from collections.abc import Callable
from typing import Any

import pytest
from telerobot.config.schema.cell import TimingSection
from telerobot.drivers.canopen import servo_setup
from telerobot.drivers.device import OBEYED_SYNCS, SWITCH_OFF_S, Cause, DeviceError
from telerobot.protocols.canopen.cia402 import (
    STATE_BITS,
    Controlword,
    DriveState,
    Object,
    OperationMode,
    Status,
)

SWITCH_OFF_SYNCS = round(SWITCH_OFF_S / TimingSection().period_s)
ENABLED = DriveState.OPERATION_ENABLED
DISABLED = DriveState.SWITCH_ON_DISABLED


def limits(cell: Any) -> tuple[int, int]:
    """Return 607Dh as the drive has it [counts]."""
    at = cell.played.objects
    low, high = (struct.unpack("<i", at[Object.POSITION_LIMIT, i])[0] for i in (1, 2))
    return low, high


# --- saying and being told ----------------------------------------------------------------------


def test_a_state_that_was_sampled_before_the_drive_was_told_says_nothing(cell: Any) -> None:
    cell.enable()
    assert cell.servo.read().obeyed
    cell.servo.request_disable()
    reading = cell.servo.read()
    assert (reading.state, reading.obeyed) == (ENABLED, False)
    for _ in range(OBEYED_SYNCS - 1):
        reading, _ = cell.step()
        assert not reading.obeyed
    reading, _ = cell.step()
    assert reading.obeyed
    assert reading.state is not ENABLED


def test_a_drive_that_is_told_the_same_again_has_nothing_new_to_obey(cell: Any) -> None:
    cell.enable()
    cell.servo.request_enable()
    assert cell.servo.read().obeyed


def test_a_stale_operation_enabled_is_not_taken_for_enabled_and_left_unasked(cell: Any) -> None:
    """Disabled and enabled again at once, the old answer comes first and then the way down."""
    cell.enable()
    cell.servo.request_disable()
    cell.step()
    cell.servo.request_enable()
    readings = [cell.step()[0] for _ in range(12)]
    assert {reading.trouble for reading in readings} == {None}
    assert (readings[-1].state, readings[-1].obeyed) == (ENABLED, True)


def test_a_drive_that_does_not_switch_off_is_named(cell: Any) -> None:
    cell.enable()
    cell.played.unpack = lambda _data: (
        Controlword.ENABLE_OPERATION,
        4000,
    )  # deaf to the controlword
    cell.servo.request_disable()
    readings = [cell.step()[0] for _ in range(SWITCH_OFF_SYNCS + 2)]
    assert {reading.trouble for reading in readings[:-2]} == {None}
    assert readings[-1].trouble.cause is Cause.STATE_LOST
    assert "told to switch off" in readings[-1].trouble.detail


def test_a_drive_whose_quick_stop_stays_active_is_let_go_once_its_ramp_is_long_over(
    cell: Any,
) -> None:
    cell.enable()
    cell.servo.stop()
    for _ in range(3):
        cell.step()
    cell.servo.open()  # 605Ah may be one that stays: another master's
    cell.servo.request_fault_reset()
    words = [cell.step()[1].controlword for _ in range(SWITCH_OFF_SYNCS + 3)]
    assert words[10] == Controlword.QUICK_STOP
    assert cell.played.state is DISABLED


# --- another master's drive ---------------------------------------------------------------------


@pytest.fixture
def left_on(cell: Any) -> Any:
    """Return a cell whose drive another master left in Operation enabled, in a mode of its own."""
    played = cell.played
    played.state = ENABLED
    obey = played.on_sdo

    def on_sdo(request: bytes) -> None:
        command, index, _subindex = struct.unpack("<BHB", request[:4])
        word = STATE_BITS[played.state] | Status.VOLTAGE_ENABLED
        played.objects[Object.STATUSWORD, 0] = struct.pack("<H", word)
        under_power = played.state is not DISABLED
        played.refuse = {(Object.MODE_OF_OPERATION, 0): 0x08000022} if under_power else {}
        if command >> 5 == 1 and index == Object.CONTROLWORD:
            (word,) = struct.unpack_from("<H", request, 4)
            words.append(word)
            if word == Controlword.DISABLE_VOLTAGE:
                played.state = DISABLED
        obey(request)

    words: list[int] = []
    cell.words, played.on_sdo = words, on_sdo
    return cell


def test_a_drive_that_another_master_left_on_is_brought_to_rest_and_off_before_it_is_set_up(
    left_on: Any,
) -> None:
    before_s = left_on.hub.time_s
    left_on.servo.open()
    assert left_on.words == [Controlword.QUICK_STOP, Controlword.DISABLE_VOLTAGE]
    assert left_on.hub.time_s >= before_s
    left_on.servo.request_enable()
    for _ in range(8):
        reading, _ = left_on.step()
    assert (reading.state, reading.trouble) == (ENABLED, None)


def test_a_drive_that_is_off_is_told_nothing_more(cell: Any) -> None:
    cell.played.objects[Object.STATUSWORD, 0] = struct.pack("<H", STATE_BITS[DISABLED])
    cell.servo.open()
    assert (Object.CONTROLWORD, 0) not in cell.played.written


# --- room for a joint outside its limits --------------------------------------------------------


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize(
    ("stands", "lower", "upper"),
    [
        (0.0, -2.0, 3.0),
        (-1.9, -2.0, 3.0),
        (2.98, -2.0, 3.0),
        (3.03, -2.0, 3.03 + 0.06),
        (-2.5, -2.5 - 0.06, 3.0),
        (2.995, -2.0, 2.995 + 0.06),
    ],
)
def test_the_drive_is_given_room_for_a_joint_outside_its_limits_and_no_more(
    make_cell: Callable[..., Any], direction: int, stands: float, lower: float, upper: float
) -> None:
    cell = make_cell(direction=direction)
    cell.servo.open()
    cell.played.position = servo_setup.to_counts(cell.drive, stands)
    cell.step()
    cell.servo.prepare(0.0)
    ends = sorted(servo_setup.to_radians(cell.drive, counts) for counts in limits(cell))
    assert ends == pytest.approx([lower, upper], abs=2e-4)


def test_room_is_asked_for_where_it_changes_and_taken_back_once_the_joint_is_inside(
    cell: Any,
) -> None:
    cell.servo.open()
    cell.step()
    assert not cell.servo.prepare(0.0)
    at_start = limits(cell)
    cell.played.position = servo_setup.to_counts(cell.drive, 3.1)
    cell.step()
    assert cell.servo.prepare(0.0)
    assert not cell.servo.prepare(0.0)
    cell.played.position = 0
    cell.step()
    assert cell.servo.prepare(0.0)
    assert limits(cell) == at_start


def test_a_drive_that_refuses_the_room_is_named(cell: Any) -> None:
    cell.servo.open()
    cell.played.position = servo_setup.to_counts(cell.drive, 3.1)
    cell.step()
    cell.played.refuse[Object.POSITION_LIMIT, 2] = 0x06090030
    with pytest.raises(DeviceError, match=r"j1 \(node 5\): writing .* to 607Dh:2"):
        cell.servo.prepare(0.0)


# --- the torque that holds a joint --------------------------------------------------------------


def preload(cell: Any) -> int:
    """Return 60B2h of the played drive [rated torque / 1000]."""
    return struct.unpack("<h", cell.played.objects[Object.TORQUE_OFFSET, 0])[0]


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("mode", [OperationMode.CSP, OperationMode.CSV])
def test_a_drive_is_told_the_torque_that_holds_its_joint(
    make_cell: Callable[..., Any], direction: int, mode: OperationMode
) -> None:
    cell = make_cell(direction=direction, mode=mode)
    cell.servo.open()
    cell.step()
    drive = cell.drive
    assert cell.servo.prepare(0.4 * drive.rated_torque)
    assert preload(cell) == 400 * direction
    assert not cell.servo.prepare(0.4 * drive.rated_torque)
    assert cell.servo.prepare(-100.0 * drive.max_torque)
    assert preload(cell) == round(-1000 * drive.max_torque / drive.rated_torque) * direction
    cell.servo.open()
    assert preload(cell) == 0
    cell.step()
    assert cell.servo.prepare(-100.0 * drive.max_torque)


def test_in_cst_the_setpoint_alone_is_the_torque(make_cell: Callable[..., Any]) -> None:
    cell = make_cell(mode=OperationMode.CST)
    cell.servo.open()
    cell.step()
    assert not cell.servo.prepare(0.4 * cell.drive.rated_torque)
    assert preload(cell) == 0


def test_a_drive_without_a_torque_offset_is_enabled_without(cell: Any) -> None:
    cell.played.refuse[Object.TORQUE_OFFSET, 0] = 0x06020000
    cell.servo.open()
    cell.step()
    cell.servo.prepare(0.4 * cell.drive.rated_torque)
    cell.enable()
    assert cell.servo.read().state is ENABLED


def test_a_drive_that_refuses_the_torque_is_named(cell: Any) -> None:
    cell.servo.open()
    cell.step()
    cell.played.refuse[Object.TORQUE_OFFSET, 0] = 0x06090030
    with pytest.raises(DeviceError, match=r"j1 \(node 5\): writing 400 to 60B2h:0"):
        cell.servo.prepare(0.4 * cell.drive.rated_torque)
