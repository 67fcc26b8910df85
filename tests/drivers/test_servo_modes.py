"""One servo drive in CSV and CST: units, what goes out while it is not enabled, and the set-up."""

import math
import struct
from collections.abc import Callable
from typing import Any

import pytest
from telerobot.drivers.device import DeviceError
from telerobot.protocols.canopen.cia402 import Controlword, DriveState, OperationMode

CSV, CST = OperationMode.CSV, OperationMode.CST
ENABLED = DriveState.OPERATION_ENABLED


@pytest.mark.parametrize(("mode", "entry"), [(CSV, 0x60FF0020), (CST, 0x60710010)])
def test_mode_and_mapping_are_set_up(
    make_cell: Callable[..., Any], mode: OperationMode, entry: int
) -> None:
    cell = make_cell(mode=mode)
    cell.servo.open()
    assert cell.played.objects[(0x6060, 0)] == struct.pack("<b", mode)
    assert cell.played.objects[(0x1600, 2)] == struct.pack("<I", entry)


def test_a_drive_without_torque_mode_cannot_be_opened(make_cell: Callable[..., Any]) -> None:
    cell = make_cell(mode=CST)
    cell.played.objects[(0x6502, 0)] = struct.pack("<I", 1 << 7)
    with pytest.raises(DeviceError, match=r"6502h:0 .* 0x80: cyclic synchronous torque"):
        cell.servo.open()


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize(("mode", "command", "raw"), [(CSV, 0.25, 2_500), (CST, -12.5, -250)])
def test_a_setpoint_is_in_joint_units_and_comes_back_as_sent(
    make_cell: Callable[..., Any], direction: int, mode: OperationMode, command: float, raw: int
) -> None:
    cell = make_cell(direction=direction, mode=mode)
    cell.enable()
    _, sent = cell.step(position=command)
    assert sent.raw == cell.played.received[-1][1] == direction * raw
    assert sent.command == pytest.approx(command)


def test_a_speed_is_sent_to_an_enabled_drive_only(make_cell: Callable[..., Any]) -> None:
    cell = make_cell(mode=CSV)
    cell.servo.open()
    cell.servo.request_enable()
    for _ in range(8):
        reading, sent = cell.step(position=0.5)
        assert sent.raw == (5_000 if reading.state is ENABLED else 0)
    assert reading.state is ENABLED


def test_the_holding_torque_is_there_before_the_brake_opens(make_cell: Callable[..., Any]) -> None:
    cell = make_cell(mode=CST)
    cell.servo.open()
    cell.servo.request_enable()
    states = []
    for _ in range(8):
        reading, sent = cell.step(position=7.5)
        states.append(reading.state)
        assert sent.raw == 150
    assert states[0] is not ENABLED
    assert states[-1] is ENABLED


@pytest.mark.parametrize(("mode", "command"), [(CSV, 0.5), (CST, 7.5)])
def test_after_a_stop_nothing_is_asked_for(
    make_cell: Callable[..., Any], mode: OperationMode, command: float
) -> None:
    cell = make_cell(mode=mode)
    cell.enable()
    cell.step(position=command)
    cell.servo.stop()
    assert cell.played.received[-1] == (Controlword.QUICK_STOP, 0)
    for _ in range(4):
        _, sent = cell.step(position=command)
        assert (sent.controlword, sent.raw) == (Controlword.QUICK_STOP, 0)


@pytest.mark.parametrize(("mode", "command"), [(CSV, 1e9), (CST, 1e4), (CST, math.nan)])
def test_what_does_not_fit_is_never_sent(
    make_cell: Callable[..., Any], mode: OperationMode, command: float
) -> None:
    cell = make_cell(mode=mode)
    cell.enable()
    before = len(cell.played.received)
    with pytest.raises(ValueError, match=r"j1: .* beyond the bits"):
        cell.servo.write(command)
    assert len(cell.played.received) == before
