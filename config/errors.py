"""The one exception of this folder, how its messages help, and how foreign text is printed."""

import difflib
from collections.abc import Iterable
from typing import Final

_LONGEST_VALUE: Final = 60

LONGEST_LINE: Final = 1000
"""Foreign text is printed up to here [1]."""


def printable(text: object, most: int = LONGEST_LINE) -> str:
    """Return text of others as one line that shows, and does nothing, on any terminal.

    Files, messages and pages hold whatever their makers like: control characters, escape sequences
    (C0 and C1), marks that turn the direction of reading. Whatever is not printable is written as
    its number, `\\u001b`; what is longer than `most` is cut.
    """
    line = str(text)
    line = line if len(line) <= most else line[: most - 1] + "…"
    if line.isprintable():
        return line
    return "".join(c if c.isprintable() else _number(c) for c in line)


def _number(character: str) -> str:
    code = ord(character)
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


class ConfigError(Exception):
    """A file that a person wrote says something that cannot be.

    Its text is one line for each thing, `file: key.path: value …: what is expected`: the reader of
    a terminal needs no more, and no traceback.
    """

    def __init__(self, *messages: str) -> None:
        self.messages = tuple(printable(" ".join(message.split())) for message in messages)
        """Mistakes, a line each."""
        super().__init__("\n".join(self.messages))


def nearest(word: str, known: Iterable[str]) -> str:
    """Return `; did you mean '…'?` for the known word that looks most like `word`, or nothing."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f"; did you mean '{close[0]}'?" if close else ""


def short(value: object) -> str:
    """Return a value as a person would write it, cut where it is long."""
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 1] + "…"
