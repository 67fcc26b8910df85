"""Contract of an exhibit: what a paper prints, and the numbers and the picture that telerobot gets.

Results cross processes and are kept as lines of JSON, so they are plain values; `show` is a
function of a module. An exhibit is one more function, and one more row in its paper's table.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple


class Number(NamedTuple):
    """One number of an exhibit, and the range that it has to stay in."""

    what: str
    ours: float
    unit: str
    printed: str
    """The paper's word on it, or what it is compared with where the paper prints none."""
    low: float
    high: float

    @property
    def kept(self) -> bool:
        """True when it is inside its range; no range holds NaN."""
        return self.low <= self.ours <= self.high


class Shown(NamedTuple):
    """Result of an exhibit."""

    numbers: Sequence[Number]
    picture: str
    """SVG"""


class Exhibit(NamedTuple):
    """One table, figure or result of a paper."""

    place: str
    """Where it is printed."""
    title: str
    printed: str
    """What the paper prints, in a sentence or two."""
    wrong: str
    """What is wrong or left open in print, and why; empty where nothing is."""
    shown: str
    """What the picture shows: its caption."""
    command: str
    """Shows the same on its own."""
    show: Callable[[], Shown]


class Paper(NamedTuple):
    """One of the five papers, and its exhibits by name."""

    title: str
    source: str
    """Authors, year, where."""
    exhibits: dict[str, Exhibit]


def near(what: str, ours: float, printed: float, within: float, unit: str = "1") -> Number:
    """Return a number that has to be what is printed, to a tolerance."""
    return Number(what, ours, unit, f"{printed:.5g}", printed - within, printed + within)


def recalled(
    what: str, ours: float, beside: str, expected: float, within: float, unit: str = "1"
) -> Number:
    """Return a number that the paper leaves open: it has to stay what it was, to a tolerance."""
    return Number(what, ours, unit, beside, expected - within, expected + within)


def at_most(what: str, ours: float, printed: str, bound: float, unit: str = "1") -> Number:
    """Return a number that has an upper bound."""
    return Number(what, ours, unit, printed, -math.inf, bound)


def at_least(what: str, ours: float, printed: str, bound: float, unit: str = "1") -> Number:
    """Return a number that has a lower bound."""
    return Number(what, ours, unit, printed, bound, math.inf)
