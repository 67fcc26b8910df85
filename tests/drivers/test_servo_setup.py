"""What a servo drive is told before it may move, and how angles become counts."""

import struct
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from telerobot.config.schema.cell import TimingSection
from telerobot.config.schema.mechanism import DriveSection
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.canopen import servo_setup
from telerobot.drivers.canopen.servo import ServoDrive
from telerobot.drivers.device import DeviceError
from telerobot.drivers.fieldbus import Fieldbus
from telerobot.protocols.canopen.can301 import NmtState
from telerobot.protocols.canopen.cia402 import OperationMode


def drive(**changes: Any) -> DriveSection:
    return DriveSection.model_validate(
        {
            "joint": "j1",
            "node": 5,
            "counts_per_radian": 10_000,
            "rated_torque": 50,
            "max_torque": 100,
            "max_velocity": 1,
            "max_acceleration": 5,
            "max_jerk": 50,
            "following_window": 0.06,
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
        list(
            servo_setup.steps(
                drive(counts_per_radian=1e7), TimingSection(), -300.0, 300.0, OperationMode.CSP
            )
        )


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


# --- an EDS -------------------------------------------------------------------------------------


def test_a_drive_is_opened_with_its_eds() -> None:
    path = Path(str(resources.files("telerobot") / "config/devices/simulated_drive.eds"))
    fieldbus = Fieldbus(InProcessBus(Hub()))
    servo = ServoDrive(fieldbus, drive(), TimingSection(), lower=-1, upper=1, eds=path)
    assert servo.name == "j1"
    fieldbus.close()
