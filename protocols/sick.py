"""SICK's LMS1xx laser scanners: CoLa-A telegrams in a stream of bytes, and the scans in them."""

import math
import struct
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

# --- CoLa-A, the text protocol of SICK's scanners: telegrams in a stream of bytes, and their fields
#
# A telegram is STX, ASCII words with one space between them, ETX. Numbers are hexadecimal,
# upper case, without leading zeros; with a sign they are decimal. Negative hexadecimal ones are
# two's complement of 32 bits. A request `sRN`, `sWN`, `sMN`, `sEN` is answered by `sRA`, `sWA`,
# `sAN`, `sEA`; what a scanner sends unasked is `sSN`; an error is `sFA` and its number.

STX: Final = b"\x02"
ETX: Final = b"\x03"

LONGEST: Final = 65536
"""A telegram that is longer is none [B]: 541 rays with remission take 6 kB."""

FAULTS: Final = {
    0x1: "method denied", 0x3: "unknown variable", 0x4: "not in this state", 0x5: "wrong data",
    0x8: "too few data", 0xA: "write access denied", 0xC: "unknown command", 0xD: "busy",
    0x11: "character that is none: binary framing on an ASCII port",
}  # fmt: skip
"""Meanings of the numbers that `sFA` tells."""


class TelegramError(ValueError):
    """A telegram that cannot be, with what is wrong and where."""


def framed(words: str) -> bytes:
    """Return the bytes of a telegram."""
    return STX + words.encode("ascii") + ETX


class TelegramCutter:
    """Cuts a stream of bytes into telegrams; what stands between two of them is refused."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, received: bytes) -> list[str | TelegramError]:
        """Return the words of all telegrams that are whole now, and errors in their places."""
        found: list[str | TelegramError] = []
        self._rest += received
        while self._rest:
            start = self._rest.find(STX)
            if start != 0:
                junk = self._rest if start < 0 else self._rest[:start]
                self._rest = self._rest[len(junk) :]
                found.append(TelegramError(f"{len(junk)} bytes outside of a telegram"))
                continue
            end = self._rest.find(ETX)
            again = self._rest.find(STX, 1)
            if again >= 0 and (end < 0 or again < end):
                found.append(TelegramError(f"a telegram was cut after {again - 1} bytes"))
                self._rest = self._rest[again:]
            elif end >= 0:
                found.append(_text(self._rest[1:end]))
                self._rest = self._rest[end + 1 :]
            elif len(self._rest) > LONGEST:
                found.append(TelegramError(f"a telegram of over {LONGEST} bytes has no end"))
                self._rest = b""
            else:
                break
        return found


def _text(content: bytes) -> str | TelegramError:
    if len(content) > LONGEST:
        return TelegramError(f"a telegram of {len(content)} bytes: at most {LONGEST}")
    for i, byte in enumerate(content):
        if not 0x20 <= byte < 0x7F:
            return TelegramError(f"byte {i} of a telegram is {byte:#04x}: no printable ASCII")
    return content.decode("ascii")


def fault_in(words: str) -> str | None:
    """Return the error that an answer tells of, None where it tells of none."""
    kind, _, number = words.partition(" ")
    if kind != "sFA":
        return None
    try:
        code = int(number, 16)
    except ValueError:
        return f"error {number!r}"
    return FAULTS.get(code, f"error {code:X}")


class Fields:
    """The words of a telegram, taken one after the other. Every refusal names the field."""

    def __init__(self, words: str) -> None:
        self._words = words.split(" ")
        self.taken = 0

    def word(self, name: str) -> str:
        """Return the next word. Raises `TelegramError` at the end."""
        if self.taken >= len(self._words):
            raise TelegramError(f"{name}: the telegram ends before it, after {self.taken} words")
        self.taken += 1
        return self._words[self.taken - 1]

    def words(self, count: int, name: str) -> list[str]:
        """Return the next words. Raises `TelegramError` where there are fewer."""
        left = len(self._words) - self.taken
        if left < count:
            raise TelegramError(f"{name}: {left} of {count} words are there")
        self.taken += count
        return self._words[self.taken - count : self.taken]

    def expect(self, word: str, name: str) -> None:
        """Take a word that has to be that one. Raises `TelegramError`."""
        found = self.word(name)
        if found != word:
            raise TelegramError(f"{name}: value {found[:20]!r}: must be {word}")

    def number(self, name: str, bits: int = 32) -> int:
        """Return the next number, not negative. Raises `TelegramError`."""
        return number(self.word(name), name, bits)

    def signed(self, name: str) -> int:
        """Return the next number of 32 bits, two's complement. Raises `TelegramError`."""
        found = self.number(name)
        return found - (1 << 32) if found >= 1 << 31 else found

    def end(self) -> None:
        """Take the end. Raises `TelegramError` for words that are left."""
        left = len(self._words) - self.taken
        if left:
            raise TelegramError(f"{left} words too many, from {self._words[self.taken][:20]!r} on")


def number(word: str, name: str, bits: int = 32) -> int:
    """Return the value of a word, not negative. Raises `TelegramError`."""
    decimal = word[:1] in ("+", "-")
    digits = word[1:] if decimal else word
    known = "0123456789" if decimal else "0123456789ABCDEFabcdef"
    if not digits or len(digits) > 10 or digits.strip(known):
        raise TelegramError(f"{name}: value {word[:20]!r}: no number")
    value = int(word, 10 if decimal else 16)
    if not 0 <= value < 1 << bits:
        raise TelegramError(f"{name}: value {word[:20]!r}: must be 0 to {(1 << bits) - 1:X}")
    return value


def hexadecimal(value: int) -> str:
    """Return the word of a number; a negative one as two's complement of 32 bits."""
    return f"{value & 0xFFFFFFFF:X}"


# --- Scan of a SICK LMS1xx: the telegram `LMDscandata`, and the requests that start it ------------
#
# The angle of a ray counts from the scanner's right (−45° to 225° in a whole scan); 90° is
# straight ahead.

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
