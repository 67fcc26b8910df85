"""Scan of a SICK LMS1xx: the telegram `LMDscandata`, and the requests that start it.

The angle of a ray counts from the scanner's right (−45° to 225° in a whole scan); 90° is straight
ahead.
"""

import math
import struct
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .cola import Fields, TelegramError, hexadecimal, number

ANGLE_UNIT: Final = math.radians(1e-4)
"""Unit of angles in a telegram [rad]."""

LEAST_MM: Final = 16
"""Smaller values of a distance tell that there was no echo [mm]."""

MOST_RAYS: Final = 1082
"""Rays of a scan: 270° in steps of 0.25°, and a few [1]."""

LOGIN: Final = "sMN SetAccessMode 03 F4724744"
"""As authorised client, with the password that every scanner leaves the factory with."""
CONFIGURE: Final = "sWN LMDscandatacfg 01 00 1 0 0 00 00 0 0 0 0 +1"
"""Distances of the first echo only, no remission, every scan."""
START: Final = "sMN LMCstartmeas"
STATE: Final = "sRN STlms"
RUN: Final = "sMN Run"
SUBSCRIBE: Final = "sEN LMDscandata 1"
MEASURING: Final = 7
"""State in which a scanner measures (`STlms`)."""

_ECHO: Final = "DIST1"
_ONE: Final = "3F800000"
_ENCODER_WORDS: Final = 2


@dataclass(frozen=True)
class Scan:
    """One turn of the mirror."""

    count: int
    """Number of the scan, counts up and wraps at 65536 [1]."""
    start_us: int
    """When its zero index passed, since the scanner's start; wraps at 2³² [µs]."""
    sent_us: int
    """When the telegram was sent, on the same clock [µs]."""
    frequency_hz: float
    """Turns in a second [Hz]."""
    first_rad: float
    """Angle of the first ray [rad]."""
    step_rad: float
    """Angle from ray to ray [rad]."""
    distances: NDArray[np.float64]
    """(n,) [m]; NaN where there was no echo."""
    faulty: bool = False
    """The scanner itself tells that something is wrong with it."""

    @property
    def angles(self) -> NDArray[np.float64]:
        """Angles of the rays (n,) [rad]."""
        found: NDArray[np.float64] = self.first_rad + self.step_rad * np.arange(
            len(self.distances), dtype=np.float64
        )
        return found


def encode_scan(scan: Scan) -> str:
    """Return the words of a telegram, as a scanner sends it that was asked for distances only."""
    millimetres = np.rint(np.nan_to_num(scan.distances * 1e3)).astype(np.int64)
    values = np.clip(millimetres, 0, 0xFFFF).tolist()
    head = (
        f"sSN LMDscandata 1 1 8D4C04 0 {int(scan.faulty)} {scan.count:X} {scan.count:X} "
        f"{scan.start_us:X} {scan.sent_us:X} 0 0 7 0 0 {round(scan.frequency_hz * 100):X} 168 0 1"
    )
    first, step = round(scan.first_rad / ANGLE_UNIT), round(scan.step_rad / ANGLE_UNIT)
    channel = f"{_ECHO} {_ONE} 00000000 {hexadecimal(first)} {step:X} {len(values):X}"
    return f"{head} {channel} {' '.join(f'{value:X}' for value in values)} 0 0 0 0 0 0"


def is_scan(words: str) -> bool:
    """Return whether a telegram is a scan, well formed or not."""
    return words.startswith(("sSN LMDscandata ", "sRA LMDscandata "))


def decode_scan(words: str) -> Scan:
    """Return the scan of a telegram. Raises `TelegramError`, which names the field."""
    fields = Fields(words)
    kind = fields.word("kind of telegram")
    if kind not in ("sSN", "sRA"):
        raise TelegramError(f"kind of telegram: value {kind[:20]!r}: must be sSN or sRA")
    fields.expect("LMDscandata", "name")
    fields.expect("1", "version")
    fields.words(2, "device and serial number")
    status = (fields.number("device status", 16), fields.number("device status", 16))
    fields.number("telegram counter", 16)
    count = fields.number("scan counter", 16)
    start_us, sent_us = fields.number("time since start"), fields.number("time of transmission")
    fields.words(5, "digital inputs and outputs")
    frequency = fields.number("scan frequency")
    if not 0 < frequency <= 10_000:
        raise TelegramError(f"scan frequency: value {frequency / 100:g}: must be 0.01 to 100 Hz")
    fields.number("measurement frequency")
    fields.words(_ENCODER_WORDS * fields.number("number of encoders", 2), "encoders")
    found: tuple[float, float, NDArray[np.float64]] | None = None
    for _ in range(fields.number("number of 16-bit channels", 3)):
        name, first, step, values = _channel(fields)
        if name == _ECHO:
            found = first, step, values
    if found is None:
        raise TelegramError(f"channels: there is no {_ECHO}")
    for _ in range(fields.number("number of 8-bit channels", 3)):
        _channel(fields)
    _tail(fields)
    return Scan(count, start_us, sent_us, frequency / 100, *found, faulty=status != (0, 0))


def _channel(fields: Fields) -> tuple[str, float, float, NDArray[np.float64]]:
    """Return name, first angle, step [rad] and values (n,) [m] of one channel."""
    name = fields.word("name of a channel")
    if name not in ("DIST1", "DIST2", "RSSI1", "RSSI2", "ANGL1", "ANGL2", "VANG1", "VANG2"):
        raise TelegramError(f"name of a channel: value {name[:20]!r}: unknown")
    scale = _real(fields, f"{name}: scale")
    offset = _real(fields, f"{name}: offset")
    first = fields.signed(f"{name}: start angle") * ANGLE_UNIT
    step = fields.number(f"{name}: angular step", 16) * ANGLE_UNIT
    if step <= 0:
        raise TelegramError(f"{name}: angular step: value 0: must be above 0")
    count = fields.number(f"{name}: number of rays", 16)
    if not 1 <= count <= MOST_RAYS:
        raise TelegramError(f"{name}: number of rays: value {count}: must be 1 to {MOST_RAYS}")
    place = f"{name}: rays"
    raw = np.array([number(w, place, 16) for w in fields.words(count, place)], dtype=np.float64)
    values = (raw * scale + offset) / 1e3
    values[raw < LEAST_MM] = np.nan
    return name, first, step, values


def _real(fields: Fields, name: str) -> float:
    """Return the next number, the bits of an IEEE 754 single."""
    bits = fields.number(name)
    value: float = struct.unpack(">f", struct.pack(">I", bits))[0]
    if not math.isfinite(value) or abs(value) > 1e3:
        raise TelegramError(f"{name}: value {value:g}: must be within ±1000")
    return value


def _tail(fields: Fields) -> None:
    """Take what may stand behind the channels: position, name, comment, time, event."""
    for name, words in (("position", 7), ("name", 2), ("comment", 2), ("time", 7), ("event", 4)):
        if fields.number(name, 1):
            fields.words(words, name)
    fields.end()
