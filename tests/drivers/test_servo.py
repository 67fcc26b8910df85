"""One servo drive: enabling without a jump, stops, and everything it watches."""

from collections.abc import Callable
from typing import Any

import pytest
from telerobot.drivers.bus import Frame, InProcessBus
from telerobot.drivers.device import Cause
from telerobot.drivers.fieldbus import Fieldbuses
from telerobot.protocols.canopen import can301
from telerobot.protocols.canopen.can301 import EmcyCode, NmtState
from telerobot.protocols.canopen.cia402 import Controlword, DriveState, Status
from telerobot.server.plant import Plant

ENABLED = DriveState.OPERATION_ENABLED
DISABLED = DriveState.SWITCH_ON_DISABLED


# --- enabling and moving ------------------------------------------------------------------------


def test_before_the_first_answer_nothing_is_known_and_nothing_sent(cell: Any) -> None:
    cell.servo.open()
    reading = cell.servo.read()
    assert not reading.ready
    assert reading.position_rad is None
    assert reading.state is None
    assert cell.servo.write(1.0) is None
    cell.servo.stop()
    assert cell.played.received == []


def test_the_reading_is_in_joint_units(make_cell: Callable[..., Any]) -> None:
    cell = make_cell(direction=-1)
    cell.servo.open()
    cell.played.torque = 500
    reading, _ = cell.step()
    assert reading.position_rad == pytest.approx(0.25 - 0.4)
    assert reading.torque_nm == pytest.approx(-25.0)
    assert (reading.age_syncs, reading.ready) == (0, True)


def test_enabling_moves_nothing_whatever_is_asked(cell: Any) -> None:
    cell.servo.open()
    cell.servo.request_enable()
    states = []
    for _ in range(8):
        reading, sent = cell.step(position=1.5)
        states.append(reading.state)
        if reading.state is not ENABLED:
            assert sent.raw == 4000
            assert sent.command == reading.position_rad
    first = states.index(ENABLED)
    assert states[first:] == [ENABLED] * (8 - first)
    at_enabling = [target for word, target in cell.played.received if word != 0x0F]
    assert set(at_enabling) == {4000}


def test_enabled_the_setpoint_goes_out_as_asked(cell: Any) -> None:
    cell.enable()
    _, sent = cell.step(position=0.70004)
    assert sent.raw == 4500
    assert sent.command == pytest.approx(0.7)
    assert cell.played.received[-1] == (Controlword.ENABLE_OPERATION, 4500)


def test_disabling_steps_back_and_is_no_trouble(cell: Any) -> None:
    cell.enable()
    cell.servo.request_disable()
    for _ in range(8):
        reading, _ = cell.step()
    assert reading.state is DISABLED
    assert reading.trouble is None


@pytest.mark.parametrize("position", [float("nan"), float("inf"), 1e9])
def test_what_is_not_a_position_is_never_sent(cell: Any, position: float) -> None:
    cell.enable()
    before = list(cell.played.received)
    with pytest.raises(ValueError, match="j1"):
        cell.servo.write(position)
    assert cell.played.received == before


# --- stops --------------------------------------------------------------------------------------


def test_a_stop_is_sent_at_once_and_stays_until_reset(cell: Any) -> None:
    cell.enable()
    cell.servo.stop()
    assert cell.played.received[-1][0] == Controlword.QUICK_STOP
    cell.servo.stop()
    cell.servo.request_enable()
    for _ in range(3):
        reading, sent = cell.step(position=1.0)
        assert sent.controlword == Controlword.QUICK_STOP
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
        assert sent.controlword == Controlword.QUICK_STOP


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
        assert (reading.age_syncs, reading.trouble) == (age, None)
    assert causes(cell).cause is Cause.PDO_LOST


def test_a_missing_heartbeat_is_noticed_after_its_timeout(cell: Any) -> None:
    cell.enable()
    cell.played.beats = False
    assert causes(cell, 19) is None
    assert causes(cell, 2).cause is Cause.HEARTBEAT_LOST


def test_a_heartbeat_of_no_state_is_none_and_the_drive_can_be_configured_anew(cell: Any) -> None:
    """canopen would keep a state that it has no name for, and raise at the next command."""
    cell.enable()
    for state in {*range(256)} - set(NmtState):
        cell.played.send(0x705, bytes((state,)))
    assert causes(cell) is None
    assert cell.fieldbus.malformed == 252
    cell.played.beats = False
    assert causes(cell, 25).cause is Cause.HEARTBEAT_LOST
    cell.played.send(0x705, b"\x3f")
    cell.fieldbus.receive(cell.hub.time_s)
    cell.servo.close()
    cell.servo.open()


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
    cell.played.controlword = Controlword.FAULT_RESET  # as if bit 7 had been left high
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


@pytest.fixture
def plant(cell: Any) -> Plant:
    cell.enable()
    return Plant(Fieldbuses(cell.fieldbus), (cell.servo.it,))


def sampled_s(cell: Any, plant: Plant) -> float | None:
    """Send a SYNC, and read at once."""
    plant.buses.sync()
    return plant.read(cell.hub.time_s).units[0].sampled_s


def test_joints_were_sampled_at_the_sync_not_when_the_answer_came_or_is_read(
    cell: Any, plant: Plant
) -> None:
    cell.played.answers_sync = False
    for late_s in (0.001, 0.004, 0.002):
        at_s = cell.hub.time_s
        plant.buses.sync()
        cell.hub.time_s += late_s
        cell.played.answer()
        cell.hub.time_s += 0.001
        assert plant.read(cell.hub.time_s).units[0].sampled_s == at_s
        cell.hub.time_s = at_s + 0.01


def test_an_answer_after_a_missing_one_may_be_to_either_sync(cell: Any, plant: Plant) -> None:
    at_s = cell.hub.time_s
    assert sampled_s(cell, plant) == at_s
    cell.played.answers_sync = False
    cell.hub.time_s += 0.01
    assert sampled_s(cell, plant) == at_s
    cell.played.answers_sync = True
    cell.hub.time_s += 0.01
    assert sampled_s(cell, plant) is None
    cell.hub.time_s += 0.01
    assert sampled_s(cell, plant) == cell.hub.time_s


def test_a_sync_that_took_long_to_send_went_out_nobody_knows_when(cell: Any, plant: Plant) -> None:
    def slow(frame: Frame) -> None:
        cell.hub.time_s += 0.001 if frame[0] == can301.SYNC_ID else 0.0

    listener = InProcessBus(cell.hub, slow)
    assert sampled_s(cell, plant) is None
    listener.shutdown()
    assert sampled_s(cell, plant) == cell.hub.time_s
