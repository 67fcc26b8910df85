"""The force/torque sensor's frames."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from telerobot.protocols.canopen import robotous
from telerobot.protocols.canopen.can301 import FrameError
from telerobot.protocols.canopen.robotous import Sample, SensorCommand

FORCE = st.tuples(*[st.floats(-600, 600)] * 3)
TORQUE = st.tuples(*[st.floats(-15, 15)] * 3)
U8 = st.integers(0, 255)
U16 = st.integers(0, 65535)


@given(FORCE, TORQUE, U8, U16)
def test_a_sample_comes_back_within_half_a_step(
    force: tuple[float, float, float],
    torque: tuple[float, float, float],
    overload: int,
    error: int,
) -> None:
    first, second = robotous.encode_sample(Sample(force, torque, overload, error))
    assert (len(first), len(second)) == (8, 8)
    back = robotous.join_sample(first, second)
    assert back.force == pytest.approx(force, abs=0.5 / 50 + 1e-12)
    assert back.torque == pytest.approx(torque, abs=0.5 / 2000 + 1e-12)
    assert (back.overload, back.error) == (overload, error)


def test_the_layout_is_the_manuals() -> None:
    raw = (500, -500, 1000, 2000, -2000, 4000)
    data = b"\x0b" + struct.pack(">6h", *raw) + b"\x3f" + b"\x00\x01"
    sample = robotous.join_sample(data[:8], data[8:])
    assert sample == Sample((10.0, -10.0, 20.0), (1.0, -1.0, 2.0), 0x3F, 1)


def test_an_overload_stays_at_the_end_of_the_scale() -> None:
    first, second = robotous.encode_sample(Sample((1e6, -1e6, 0), (1e6, 0, 0), 0, 0))
    sample = robotous.join_sample(first, second)
    assert sample.force[:2] == (32767 / 50, -32767 / 50)
    assert sample.torque[0] == 32767 / 2000


@pytest.mark.parametrize(
    ("first", "second"),
    [(bytes(8), bytes(8)), (b"\x0b" + bytes(6), bytes(8)), (b"\x0b" + bytes(7), bytes(7))],
    ids=["another reply", "short first", "short second"],
)
def test_what_is_not_a_sample_is_refused(first: bytes, second: bytes) -> None:
    with pytest.raises(FrameError, match="not its two halves"):
        robotous.join_sample(first, second)


@pytest.mark.parametrize(
    ("data", "meaning"),
    [
        (robotous.start(), (SensorCommand.START, 0)),
        (robotous.stop(), (SensorCommand.STOP, 0)),
        (robotous.set_rate(200), (SensorCommand.SET_RATE, 0)),
        (robotous.set_rate(100), (SensorCommand.SET_RATE, 4)),
        (robotous.set_rate(1000), (SensorCommand.SET_RATE, 8)),
        (robotous.bias(), (SensorCommand.SET_BIAS, 1)),
        (robotous.clear_bias(), (SensorCommand.SET_BIAS, 0)),
    ],
)
def test_commands_are_read_as_they_were_meant(
    data: bytes, meaning: tuple[SensorCommand, int]
) -> None:
    assert len(data) == 8
    assert robotous.parse_command(data) == meaning


def test_unknown_commands_and_rates_are_refused() -> None:
    with pytest.raises(ValueError, match="123 Hz is not one of"):
        robotous.set_rate(123)
    with pytest.raises(FrameError, match="id 0xee"):
        robotous.parse_command(b"\xee" + bytes(7))
    with pytest.raises(FrameError, match="3 bytes instead of 8"):
        robotous.parse_command(bytes(3))
