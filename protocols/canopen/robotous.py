"""Robotous RFT force/torque sensor over CAN: commands of 8 bytes, replies of 16 in two frames.

Layout of a reply (RFT series manual, revision 1.8, section 3): byte 0 the command that it
answers; for a sample, bytes 1 to 12 are Fx, Fy, Fz, Tx, Ty, Tz as big-endian int16, byte 13 the
overload status, bytes 14 and 15 the error flags. Forces are raw / 50 [N], torques raw / 2000
[N·m]. Tx lies across both frames and nothing numbers them: which halves belong together is the
driver's to judge.
"""

import struct
from enum import IntEnum
from typing import Final, NamedTuple

from .can301 import FrameError

HALF: Final = 8
"""Length of a command, and of either half of a reply [byte]."""
COUNTS_PER_NEWTON: Final = 50
COUNTS_PER_NEWTON_METRE: Final = 2000

AXES: Final = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
"""Of a sample, in its order."""

_SAMPLE: Final = struct.Struct(">B6hBH")
_LIMIT: Final = 2**15 - 1
RAILS: Final = (_LIMIT / COUNTS_PER_NEWTON,) * 3 + (_LIMIT / COUNTS_PER_NEWTON_METRE,) * 3
"""Greatest reading of each axis that 16 bits hold [N, N·m]; a load beyond reads like it."""
HALF_COUNTS: Final = (0.5 / COUNTS_PER_NEWTON,) * 3 + (0.5 / COUNTS_PER_NEWTON_METRE,) * 3
"""Half the steps in which each axis reads [N, N·m]."""


class SensorCommand(IntEnum):
    """Command ids, byte 0 of a command."""

    START = 0x0B
    STOP = 0x0C
    SET_RATE = 0x0F
    SET_BIAS = 0x11


RATE_CODES: Final = {200: 0, 10: 1, 20: 2, 50: 3, 100: 4, 333: 6, 500: 7, 1000: 8}
"""Output rate [Hz] to its code. The maker's header names code 6 `300 Hz`; code 5 is 200 Hz too."""


class Sample(NamedTuple):
    """One reading: the load *on* the sensor, in its own axes.

    `force` (3,) [N], `torque` (3,) [N·m]; `overload` and `error` are zero when all is well.
    """

    force: tuple[float, float, float]
    torque: tuple[float, float, float]
    overload: int
    error: int


def start() -> bytes:
    """Return the command that starts the stream of samples."""
    return _command(SensorCommand.START)


def stop() -> bytes:
    """Return the command that stops the stream; settings are only taken while it is stopped."""
    return _command(SensorCommand.STOP)


def set_rate(rate_hz: int) -> bytes:
    """Return the command that sets the output rate. Raises `ValueError` for one not offered."""
    code = RATE_CODES.get(rate_hz)
    if code is None:
        raise ValueError(f"rate {rate_hz} Hz is not one of {sorted(RATE_CODES)}")
    return _command(SensorCommand.SET_RATE, code)


def bias() -> bytes:
    """Return the command that takes the present load as zero."""
    return _command(SensorCommand.SET_BIAS, 1)


def clear_bias() -> bytes:
    """Return the command that forgets the bias."""
    return _command(SensorCommand.SET_BIAS, 0)


def parse_command(data: bytes) -> tuple[SensorCommand, int]:
    """Return command and parameter, as the sensor reads them. Raises `FrameError`."""
    if len(data) != HALF:
        raise FrameError(f"RFT command: {len(data)} bytes instead of {HALF}")
    try:
        return SensorCommand(data[0]), data[1]
    except ValueError:
        raise FrameError(f"RFT command: id {data[0]:#04x} is not known") from None


def encode_sample(sample: Sample) -> tuple[bytes, bytes]:
    """Return the two frames of a sample; a load beyond the 16 bits stays at their end."""
    raw = [
        max(-_LIMIT, min(_LIMIT, round(value * per_unit)))
        for values, per_unit in (
            (sample.force, COUNTS_PER_NEWTON),
            (sample.torque, COUNTS_PER_NEWTON_METRE),
        )
        for value in values
    ]
    data = _SAMPLE.pack(SensorCommand.START, *raw, sample.overload, sample.error)
    return data[:HALF], data[HALF:]


def is_sample_start(first: bytes) -> bool:
    """Return whether a frame on the first reply id opens a sample, not another command's reply."""
    return len(first) == HALF and first[0] == SensorCommand.START


def join_sample(first: bytes, second: bytes) -> Sample:
    """Return the sample in two frames. Raises `FrameError` if they are not halves of one."""
    if not is_sample_start(first) or len(second) != HALF:
        raise FrameError(f"RFT sample: {first.hex()} {second.hex()} are not its two halves")
    _, fx, fy, fz, tx, ty, tz, overload, error = _SAMPLE.unpack(first + second)
    n, nm = COUNTS_PER_NEWTON, COUNTS_PER_NEWTON_METRE
    return Sample((fx / n, fy / n, fz / n), (tx / nm, ty / nm, tz / nm), overload, error)


def _command(command: SensorCommand, parameter: int = 0) -> bytes:
    return bytes((command, parameter)).ljust(HALF, b"\0")
