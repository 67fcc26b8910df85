"""What holds a base that is driven ahead has a name, and loses it with headway."""

import pytest
from telerobot.server.perception.ahead import (
    HEADWAY_M,
    HELD_BACK,
    HELD_S,
    NO_HEADWAY,
    WAITING_S,
    Headway,
)

PERIOD_S = 0.01


class Base:
    """A base that is asked for a speed, and goes at another."""

    def __init__(self) -> None:
        self.headway, self.way, self.tick = Headway(PERIOD_S), 0.0, 0

    def go(
        self, seconds: float, asked: float = 0.1, speed: float = 0.0, *, held: bool = True
    ) -> str:
        for _ in range(round(seconds / PERIOD_S)):
            self.tick += 1
            self.way += speed * PERIOD_S
            self.headway.step(asked, self.way, self.tick, held=held)
        return self.headway.reason


def test_clearances_that_hold_a_base_are_told_after_some_seconds() -> None:
    base = Base()
    assert base.go(HELD_S - 0.1) == ""
    assert base.go(0.3) == HELD_BACK


def test_one_that_waits_for_its_arm_is_told_of_only_where_it_waits_without_end() -> None:
    base = Base()
    assert base.go(WAITING_S - 0.1, held=False) == ""
    assert base.go(0.3, held=False) == NO_HEADWAY


def test_clearances_count_without_headway_only() -> None:
    base = Base()
    for _ in range(10):
        assert base.go(0.5 * HELD_S) == ""
        assert base.go(0.3, speed=0.1) == ""


@pytest.mark.parametrize("asked", [0.3, 0.05, 0.004])
def test_a_base_that_comes_on_as_asked_is_not_held(asked: float) -> None:
    assert Base().go(3 * WAITING_S, asked, asked) == ""


def test_the_name_stays_until_the_base_has_come_farther() -> None:
    base = Base()
    assert base.go(HELD_S + 0.1) == HELD_BACK
    assert base.go(2.0, held=False) == HELD_BACK
    assert base.go(1.0, speed=0.9 * HEADWAY_M, held=False) == HELD_BACK
    assert base.go(1.0, speed=0.9 * HEADWAY_M) == ""
    assert base.go(HELD_S - 1.2) == ""


@pytest.mark.parametrize("asked", [0.0, -0.1])
def test_a_base_that_is_no_longer_driven_ahead_is_held_by_nothing(asked: float) -> None:
    base = Base()
    base.go(HELD_S + 0.1)
    assert base.go(PERIOD_S, asked) == ""
    assert base.go(HELD_S - 0.1) == ""


def test_time_in_which_nobody_may_drive_does_not_count() -> None:
    base = Base()
    base.go(HELD_S - 0.1)
    base.tick += 500
    assert base.go(HELD_S - 0.1) == ""
    assert base.go(0.3) == HELD_BACK
