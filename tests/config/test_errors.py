"""Foreign text as it is printed: one line that shows, and does nothing."""

import pytest
from telerobot.config.errors import LONGEST_LINE, ConfigError, printable

HOSTILE = {
    "\x1b]0;title\x07": r"\u001b]0;title\u0007",
    "\x1b[2J": r"\u001b[2J",
    "\x9b2J": r"\u009b2J",
    "\x00\x7f\r\n\t": r"\u0000\u007f\u000d\u000a\u0009",
    "safe\u202egnp.exe": r"safe\u202egnp.exe",
    "\u2066x\u2069\u200f\ufeff": r"\u2066x\u2069\u200f\ufeff",
    "\u2028\ud800\U000e0001": r"\u2028\ud800\U000e0001",
}


@pytest.mark.parametrize(("text", "shown"), HOSTILE.items(), ids=ascii)
def test_whatever_acts_on_a_terminal_is_written_as_its_number(text, shown):
    assert printable(text) == shown
    assert printable(text).isprintable()


@pytest.mark.parametrize("text", ["ready", "Σ 10 µs → 3°", "Ärmel, 左"])
def test_what_people_write_is_left_as_it_is(text):
    assert printable(text) == text


def test_what_is_long_is_cut():
    assert printable("a" * 10**7) == "a" * (LONGEST_LINE - 1) + "…"
    assert printable("abcdef", 4) == "abc…"


def test_a_mistake_in_a_file_is_told_in_plain_text():
    assert str(ConfigError("cell.toml: \x1b]0;own\x07.\u202ekey: unknown")) == (
        r"cell.toml: \u001b]0;own\u0007.\u202ekey: unknown"
    )
