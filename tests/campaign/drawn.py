"""Draws from a seed by hypothesis: what fails is shrunk to the least that fails.

A seed's bytes are the choices (`fuzz_one_input`): what is drawn depends on them and on the
strategy alone. By its own generator hypothesis draws numbers that it finds in modules, too, and so
by what a process happens to have imported. Nothing is bounded by time, for the same reason.
"""

import random
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TypeVar

import hypothesis
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.database import InMemoryExampleDatabase
from hypothesis.strategies import SearchStrategy

T = TypeVar("T")

CHOICES = 2**13
"""Bytes of what is drawn at once; hypothesis takes no more [1]."""
LEAST = 150
"""Runs that look for the least that fails, at most [1]."""
TRIES = 10
"""So often as many are drawn as are played, at most: some have more choices than there are [1]."""


class _BrokenError(Exception):
    pass


class _Enough(BaseException):
    pass


def play(
    what: SearchStrategy[T], judge: Callable[[T], list[str]], seed: str, times: int
) -> list[str]:
    """Judge `times` things that a seed draws; return the reasons against the first that fails.

    The last of them is the least thing that was found to fail, and why. `judge` is a function of
    the thing alone.
    """
    failing: dict[str, list[str]] = {}
    played = 0

    # The seed inside: outside it would take the database away.
    @settings(
        database=InMemoryExampleDatabase(), phases=(Phase.reuse, Phase.shrink), deadline=None,
        suppress_health_check=list(HealthCheck), report_multiple_bugs=False, print_blob=False,
    )  # fmt: skip
    @hypothesis.seed(0)
    @given(what)
    def run(drawn: T) -> None:
        nonlocal played
        if played == times:
            raise _Enough
        played += 1
        if reasons := judge(drawn):
            failing[repr(drawn)] = reasons
            raise _BrokenError

    dice = random.Random(seed)
    for _ in range(TRIES * times):
        with suppress(_BrokenError, _Enough):
            run.hypothesis.fuzz_one_input(dice.randbytes(CHOICES))  # type: ignore[attr-defined]
        if failing or played == times:
            break
    if not failing:
        return []
    first = next(iter(failing.values()))
    played, times = 0, LEAST
    with suppress(_BrokenError, _Enough):
        run()
    least = min(reversed(failing), key=len)  # the last of them is the smallest one
    return [*first, f"the least: {failing[least][0]}; by {least}"]


def stream(what: SearchStrategy[T], seed: str) -> Iterator[T]:
    """Yield what a seed draws, without end; nothing is shrunk."""
    drawn: list[T] = []

    @given(what)
    def run(one: T) -> None:
        drawn.append(one)

    dice = random.Random(seed)
    while True:
        run.hypothesis.fuzz_one_input(dice.randbytes(CHOICES))  # type: ignore[attr-defined]
        yield from drawn
        drawn.clear()
