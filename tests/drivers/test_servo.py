"""One servo drive: configuration, enabling without a jump, stops, and everything it watches."""

import struct
from collections.abc import Callable
from typing import Any

import canopen
import pytest
from hypothesis import given
from hypothesis import strategies as st
from telerobot.config.schema import Drive, Timing
from telerobot.drivers import servo_setup
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.device import Cause, DeviceError
from telerobot.drivers.fieldbus import Fieldbus
from telerobot.drivers.servo import ServoDrive
from telerobot.protocols.can301 import EmcyCode, NmtState
from telerobot.protocols.cia402 import Control, DriveState, Status

ENABLED = DriveState.OPERATION_ENABLED
DISABLED = DriveState.SWITCH_ON_DISABLED


def drive(**changes: Any) -> Drive:
    return Drive.model_validate(
        {
            "joint": "j1",
            "node": 5,
            "counts_per_radian": 10_000,
            "rated_torque": 50,
            "max_torque": 100,
            "max_velocity": 1,
            "max_acceleration": 5,
            "max_jerk": 50,
            **changes,
        }
    )


# --- configuration ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("index", "subindex", "layout", "value"),
    [
        (0x1016, 1, "<I", 127 << 16 | 200),
        (0x1017, 0, "<H", 50),
        (0x6007, 0, "<h", 3),
        (0x605A, 0, "<h", 2),
        (0x6085, 0, "<I", 100_000),
        (0x6065, 0, "<I", 600),
        (0x607D, 1, "<i", -22_500),
        (0x607D, 2, "<i", 27_500),
        (0x60C2, 1, "<B", 10),
        (0x60C2, 2, "<b", -3),
        (0x2F00, 0, "<H", 80),
        (0x6060, 0, "<b", 8),
        (0x1400, 1, "<I", 0x205),
        (0x1400, 2, "<B", 1),
        (0x1600, 0, "<B", 2),
        (0x1600, 2, "<I", 0x607A0020),
        (0x1401, 1, "<I", 0x80000305),
        (0x1800, 1, "<I", 0x185),
        (0x1800, 2, "<B", 1),
        (0x1A00, 3, "<I", 0x60770010),
        (0x1803, 1, "<I", 0x80000485),
    ],
)
def test_opening_writes_what_the_cell_says(
    cell: Any, index: int, subindex: int, layout: str, value: int
) -> None:
    cell.servo.open()
    assert cell.played.objects[(index, subindex)] == struct.pack(layout, value)
    assert cell.played.nmt is NmtState.OPERATIONAL


def test_a_pdo_is_off_while_it_is_mapped(cell: Any) -> None:
    cell.servo.open()
    written = cell.played.written
    mapped = written.index((0x1600, 1))
    assert written.index((0x1400, 1)) < mapped
    assert (0x1400, 1) in written[mapped:]


def test_limits_turn_round_with_the_drives_direction(make_cell: Callable[..., Any]) -> None:
    cell = make_cell(direction=-1)
    cell.servo.open()
    low, high = (struct.unpack("<i", cell.played.objects[(0x607D, i)])[0] for i in (1, 2))
    assert (low, high) == (-27_500, 22_500)


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ((0x6065, 0), r"j1 \(node 5\): writing 600 to 6065h:0 \(following_window\)"),
        ((0x1017, 0), r"1017h:0 \(producer_heartbeat\)"),
        ((0x6502, 0), r"reading 6502h:0 \(supported_modes\)"),
        ((0x1400, 1), r"1400h:1 \(rpdo_communication\)"),
        ((0x2F00, 0), r"2F00h:0 \(setpoint_timeout\)"),
    ],
)
def test_a_refused_step_names_joint_node_object_and_answer(
    cell: Any, key: tuple[int, int], words: str
) -> None:
    cell.played.refuse[key] = 0x08000022
    with pytest.raises(DeviceError, match=words) as refused:
        cell.servo.open()
    assert "0x08000022" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_drive_may_do_without_the_pdos_that_are_only_disabled(cell: Any) -> None:
    cell.played.refuse[(0x1402, 1)] = 0x06020000
    cell.servo.open()
    cell.played.refuse[(0x1402, 1)] = 0x08000022
    with pytest.raises(DeviceError, match="1402h:1"):
        cell.servo.open()


def test_a_node_that_does_not_boot_cannot_be_opened(cell: Any) -> None:
    cell.played.boots = False
    with pytest.raises(DeviceError, match=r"j1 \(node 5\): no boot-up message"):
        cell.servo.open()


def test_a_drive_without_position_mode_cannot_be_opened(cell: Any) -> None:
    cell.played.objects[(0x6502, 0)] = struct.pack("<I", 1 << 9)
    with pytest.raises(DeviceError, match=r"6502h:0 .* 0x200: cyclic synchronous position"):
        cell.servo.open()


def test_a_drive_that_does_not_take_the_mode_cannot_be_opened(cell: Any) -> None:
    cell.played.refuse[(0x6061, 0)] = 0x06010000
    with pytest.raises(DeviceError, match="6061h:0"):
        cell.servo.open()


def test_a_silent_drive_cannot_be_opened(cell: Any) -> None:
    cell.played.answers_sdo = False
    with pytest.raises(DeviceError, match="6502h:0"):
        cell.servo.open()


def test_limits_beyond_32_bits_are_refused() -> None:
    with pytest.raises(ValueError, match=r"j1: -300\.0 rad is beyond"):
        list(servo_setup.steps(drive(counts_per_radian=1e7), Timing(), -300.0, 300.0))


@pytest.mark.parametrize(
    ("period_s", "said"), [(0.01, (10, -3)), (0.001, (1, -3)), (0.0025, (25, -4)), (0.1, (100, -3))]
)
def test_the_sync_period_is_said_exactly(period_s: float, said: tuple[int, int]) -> None:
    assert servo_setup.interpolation_period(period_s) == said


def test_a_period_that_cannot_be_said_is_refused() -> None:
    with pytest.raises(ValueError, match="cannot be written to 60C2h"):
        servo_setup.interpolation_period(1 / 300)


# --- conversions --------------------------------------------------------------------------------


@given(
    st.floats(-50, 50),
    st.floats(101, 1e6),
    st.sampled_from([1, -1]),
    st.floats(-10, 10),
)
def test_quantisation_is_within_half_a_count(
    position: float, scale: float, direction: int, zero: float
) -> None:
    joint = drive(counts_per_radian=scale, direction=direction, zero_rad=zero)
    back = servo_setup.to_radians(joint, servo_setup.to_counts(joint, position))
    assert abs(back - position) <= 0.5 / scale * (1 + 1e-9) + 1e-13


@given(st.integers(-(2**31) + 1, 2**31 - 1), st.sampled_from([1, -1]))
def test_every_count_comes_back_exactly(counts: int, direction: int) -> None:
    joint = drive(direction=direction, zero_rad=0.5)
    assert servo_setup.to_counts(joint, servo_setup.to_radians(joint, counts)) == counts


@pytest.mark.parametrize("position", [float("nan"), float("inf"), 1e9])
def test_what_is_not_a_position_is_never_sent(cell: Any, position: float) -> None:
    cell.enable()
    before = list(cell.played.received)
    with pytest.raises(ValueError, match="j1"):
        cell.servo.write(position)
    assert cell.played.received == before


# --- enabling and moving ------------------------------------------------------------------------


def test_before_the_first_answer_nothing_is_known_and_nothing_sent(cell: Any) -> None:
    cell.servo.open()
    reading = cell.servo.read()
    assert not reading.ready
    assert reading.position_rad is None
    assert reading.state is None
    sent = cell.servo.write(1.0)
    assert sent.counts is None
    assert sent.position_rad is None
    cell.servo.stop()
    assert cell.played.received == []


def test_the_reading_is_in_joint_units(make_cell: Callable[..., Any]) -> None:
    cell = make_cell(direction=-1)
    cell.servo.open()
    cell.played.torque = 500
    reading, _ = cell.step()
    assert reading.position_rad == pytest.approx(0.25 - 0.4)
    assert reading.torque_nm == pytest.approx(-25.0)
    assert reading.velocity_rad_s is None
    assert (reading.fresh, reading.age_syncs, reading.ready) == (True, 0, True)


def test_enabling_moves_nothing_whatever_is_asked(cell: Any) -> None:
    cell.servo.open()
    cell.servo.request_enable()
    states = []
    for _ in range(8):
        reading, sent = cell.step(position=1.5)
        states.append(reading.state)
        if reading.state is not ENABLED:
            assert sent.counts == 4000
            assert sent.position_rad == reading.position_rad
    first = states.index(ENABLED)
    assert states[first:] == [ENABLED] * (8 - first)
    at_enabling = [c.target_position for c in cell.played.received if c.controlword != 0x0F]
    assert set(at_enabling) == {4000}


def test_enabled_the_setpoint_goes_out_as_asked_and_what_was_sent_is_returned(cell: Any) -> None:
    cell.enable()
    _, sent = cell.step(position=0.70004)
    assert sent.counts == 4500
    assert sent.position_rad == pytest.approx(0.7)
    assert cell.played.received[-1] == (Control.ENABLE_OPERATION, 4500)


def test_disabling_steps_back_and_is_no_trouble(cell: Any) -> None:
    cell.enable()
    cell.servo.request_disable()
    for _ in range(8):
        reading, _ = cell.step()
    assert reading.state is DISABLED
    assert reading.trouble is None


# --- stops --------------------------------------------------------------------------------------


def test_a_stop_is_sent_at_once_and_stays_until_reset(cell: Any) -> None:
    cell.enable()
    cell.servo.stop()
    assert cell.played.received[-1].controlword == Control.QUICK_STOP
    cell.servo.stop()
    cell.servo.request_enable()
    for _ in range(3):
        reading, sent = cell.step(position=1.0)
        assert sent.controlword == Control.QUICK_STOP
    assert reading.state is DriveState.QUICK_STOP_ACTIVE
    assert reading.trouble is None
    cell.played.state = DISABLED  # its ramp has ended
    cell.servo.request_fault_reset()
    cell.step()
    cell.servo.request_enable()
    for _ in range(8):
        reading, _ = cell.step()
    assert reading.state is ENABLED


def test_a_reset_does_not_cut_a_running_quick_stop_short(cell: Any) -> None:
    cell.enable()
    cell.servo.stop()
    cell.step()
    cell.servo.request_fault_reset()
    for _ in range(3):
        _, sent = cell.step()
        assert sent.controlword == Control.QUICK_STOP


# --- what is watched ----------------------------------------------------------------------------


def causes(cell: Any, count: int = 1) -> Any:
    for _ in range(count):
        reading, _ = cell.step()
    return reading.trouble


def fault(cell: Any) -> None:
    cell.played.state = DriveState.FAULT


def following(cell: Any) -> None:
    cell.played.status |= Status.FOLLOWING_ERROR


def no_power(cell: Any) -> None:
    cell.played.status &= ~Status.VOLTAGE_ENABLED


def left(cell: Any) -> None:
    cell.played.state = DriveState.QUICK_STOP_ACTIVE


def no_state(cell: Any) -> None:
    cell.played.state = DriveState.NOT_READY
    cell.played.status |= 0x01


def emergency(cell: Any) -> None:
    cell.played.emcy(EmcyCode.OVERCURRENT)


def following_emergency(cell: Any) -> None:
    cell.played.emcy(EmcyCode.FOLLOWING_ERROR)


def restart(cell: Any) -> None:
    cell.played.boot()


def pre_operational(cell: Any) -> None:
    cell.played.nmt = NmtState.PRE_OPERATIONAL


@pytest.mark.parametrize(
    ("happens", "cause"),
    [
        (fault, Cause.DRIVE_FAULT),
        (following, Cause.FOLLOWING_ERROR),
        (no_power, Cause.POWER_LOST),
        (left, Cause.STATE_LOST),
        (no_state, Cause.STATE_LOST),
        (emergency, Cause.EMERGENCY),
        (following_emergency, Cause.FOLLOWING_ERROR),
        (restart, Cause.NODE_RESTARTED),
        (pre_operational, Cause.NODE_RESTARTED),
    ],
)
def test_what_goes_wrong_is_named_within_a_period_and_stays(
    cell: Any, happens: Callable[[Any], None], cause: Cause
) -> None:
    cell.enable()
    happens(cell)
    trouble = causes(cell)
    assert trouble.cause is cause
    assert trouble.device == "j1"
    assert trouble.values["node"] == 5
    cell.played.state = ENABLED
    cell.played.status = int(Status.VOLTAGE_ENABLED)
    assert causes(cell, 3) == trouble


def test_an_emergency_tells_code_and_name(cell: Any) -> None:
    cell.enable()
    emergency(cell)
    trouble = causes(cell)
    assert trouble.values["code"] == 0x2310
    assert trouble.values["name"] == "overcurrent"
    assert "0x2310" in trouble.detail


def test_missing_answers_are_noticed_after_the_fourth_sync(cell: Any) -> None:
    cell.enable()
    cell.played.answers_sync = False
    for age in (1, 2, 3):
        reading, _ = cell.step()
        assert (reading.fresh, reading.age_syncs, reading.trouble) == (False, age, None)
    assert causes(cell).cause is Cause.PDO_LOST


def test_a_missing_heartbeat_is_noticed_after_its_timeout(cell: Any) -> None:
    cell.enable()
    cell.played.beats = False
    assert causes(cell, 19) is None
    assert causes(cell, 2).cause is Cause.HEARTBEAT_LOST


def test_a_drive_that_never_answers_is_noticed(cell: Any) -> None:
    cell.servo.open()
    cell.played.answers_sync = False
    assert causes(cell, 3) is None
    assert causes(cell).cause is Cause.PDO_LOST


# --- reset --------------------------------------------------------------------------------------


def test_a_fault_is_reset_on_a_rising_edge_and_the_drive_ends_disabled(cell: Any) -> None:
    cell.enable()
    fault(cell)
    cell.step()
    cell.played.controlword = Control.FAULT_RESET  # as if bit 7 had been left high
    cell.servo.request_fault_reset()
    for _ in range(6):
        reading, _ = cell.step()
    assert reading.trouble is None
    assert reading.state is DISABLED
    cell.servo.request_enable()
    for _ in range(8):
        reading, _ = cell.step()
    assert reading.state is ENABLED


def test_trouble_forbids_enabling(cell: Any) -> None:
    cell.servo.open()
    emergency(cell)
    cell.step()
    cell.servo.request_enable()
    for _ in range(5):
        reading, _ = cell.step()
    assert reading.state is DISABLED


def test_a_reset_does_not_work_while_the_cause_is_there(cell: Any) -> None:
    cell.enable()
    cell.played.answers_sync = False
    causes(cell, 5)
    cell.servo.request_fault_reset()
    assert causes(cell, 30).cause is Cause.PDO_LOST
    cell.played.answers_sync = True
    assert causes(cell, 3).cause is Cause.PDO_LOST
    cell.servo.request_fault_reset()
    assert causes(cell, 1) is None


def test_a_node_that_restarted_needs_to_be_opened_again(cell: Any) -> None:
    cell.enable()
    restart(cell)
    cell.step()
    cell.servo.request_fault_reset()
    assert causes(cell, 30).cause is Cause.NODE_RESTARTED
    cell.servo.open()
    assert causes(cell, 2) is None


def test_an_emergency_is_taken_back_by_the_drive_while_resetting(cell: Any) -> None:
    cell.enable()
    emergency(cell)
    cell.played.emcy(EmcyCode.NO_ERROR)
    assert causes(cell).cause is Cause.EMERGENCY
    cell.servo.request_fault_reset()
    cell.played.emcy(EmcyCode.OVERCURRENT)
    assert causes(cell).cause is Cause.EMERGENCY
    cell.played.emcy(EmcyCode.NO_ERROR)
    assert causes(cell) is None


# --- an EDS -------------------------------------------------------------------------------------


def test_a_drive_is_opened_with_its_eds(cell: Any, tmp_path: Any) -> None:
    path = tmp_path / "drive.eds"
    dictionary = canopen.import_od(None)
    with path.open("w") as file:
        canopen.export_od(dictionary, file, doc_type="eds")
    fieldbus = Fieldbus(InProcessBus(Hub()))
    servo = ServoDrive(fieldbus, drive(), Timing(), lower=-1, upper=1, eds=path)
    assert servo.name == "j1"
    fieldbus.close()
