"""The one exception of this folder, and how its messages help."""

import difflib
from collections.abc import Iterable
from typing import Final

_LONGEST_VALUE: Final = 60


class ConfigError(Exception):
    """A file that a person wrote says something that cannot be.

    Its text is one line for each thing, `file: key.path: value …: what is expected`: the reader of
    a terminal needs no more, and no traceback.
    """

    def __init__(self, *messages: str) -> None:
        self.messages = tuple(" ".join(message.split()) for message in messages)
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
