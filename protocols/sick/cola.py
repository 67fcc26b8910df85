"""CoLa-A, the text protocol of SICK's scanners: telegrams in a stream of bytes, and their fields.

A telegram is STX, ASCII words with one space between them, ETX. Numbers are hexadecimal, upper
case, without leading zeros; with a sign they are decimal. Negative hexadecimal ones are two's
complement of 32 bits. A request `sRN`, `sWN`, `sMN`, `sEN` is answered by `sRA`, `sWA`, `sAN`,
`sEA`; what a scanner sends unasked is `sSN`; an error is `sFA` and its number.
"""

from typing import Final

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
