"""A counter of 32 bits that wraps, at its very ends."""

import pytest
from telerobot.protocols.canopen.cia402 import HALF, SPAN, Unwrapped, wrapped


@pytest.mark.parametrize(
    ("counts", "seen"),
    [
        (0, 0), (HALF - 1, HALF - 1), (HALF, -HALF), (HALF + 1, -HALF + 1),
        (-HALF, -HALF), (-HALF - 1, HALF - 1), (SPAN, 0), (SPAN - 1, -1), (-SPAN, 0),
    ],
)  # fmt: skip
def test_a_count_beyond_the_last_one_is_the_first_one(counts, seen):
    assert wrapped(counts) == seen


@pytest.mark.parametrize("step", [1, -1, HALF - 1, -HALF + 1])
def test_the_shorter_way_is_gone_for_turns_on_end(step):
    true, counter = 5, Unwrapped()
    assert counter.take(wrapped(true)) == true
    for _ in range(9):
        true += step
        assert counter.take(wrapped(true)) == true


def test_half_a_turn_of_the_counter_goes_backwards():
    counter = Unwrapped()
    counter.take(0)
    assert counter.take(wrapped(HALF)) == -HALF


def test_the_first_reading_is_taken_as_it_is():
    assert Unwrapped().take(HALF - 1) == HALF - 1
