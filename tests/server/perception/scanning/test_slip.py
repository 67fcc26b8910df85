"""Wheels that roll where the base does not come along: seen by scans, as far as these can tell."""

import numpy as np
import pytest
from laboratory.papers.rover import Rover
from telerobot.config.schema.rig import BoxSection, RigPersonSection

SPEED = 0.2
SLIPS_S = 2.5


def box(name: str, xyz: tuple[float, ...], half: tuple[float, ...]) -> BoxSection:
    return BoxSection(name=name, xyz=xyz, half_size=half)


SIDES = (
    box("left", (0.0, 2.0, 1.0), (30.0, 0.1, 1.0)),
    box("right", (0.0, -2.0, 1.0), (30.0, 0.1, 1.0)),
)
"""A bare corridor."""
ROOM = (*SIDES, box("ahead", (4.0, 0.0, 1.0), (0.1, 2.0, 1.0)))


class Slipping(Rover):
    """One that drives, and after a while comes along with a share of its wheels' way."""

    def __init__(self, boxes: tuple[BoxSection, ...], walks: bool = False) -> None:
        person = RigPersonSection(xyz=(1.5, 1.0, 0.0)) if walks else None
        super().__init__(None, SPEED, boxes=boxes, person=person, wait=False)
        self.slips_s: float | None = None
        """When slip was seen first [s]."""
        self.slid = np.zeros(3)
        """All that was told of it: x, y [m], yaw [rad]."""

    def go(self, seconds: float, grip: float = 1.0, walking: float | None = None) -> "Slipping":
        """Let time pass; the person walks ahead at a speed [m/s]."""
        self.grip = grip
        for _ in range(round(seconds * 100)):
            if walking is not None:
                self.place_person(1.5 + walking * self.time_s, 1.0)
            looked = self.newest
            self.step()
            if self.newest is None or self.newest is looked:
                continue
            news = self.newest.messages[0]
            if news.slipping and self.slips_s is None:
                self.slips_s = self.time_s
            if news.slide is not None:
                self.slid += news.slide
        return self


@pytest.mark.parametrize("walking", [None, 0.2])
def test_wheels_that_spin_are_seen_within_half_a_second_and_by_how_much(
    walking: float | None,
) -> None:
    """Somebody who walks along, as quickly as the wheels roll, does not hide it."""
    rover = Slipping(ROOM, walks=walking is not None)
    rover.go(SLIPS_S, walking=walking).go(0.5, grip=0.0, walking=walking)
    assert rover.slips_s is not None
    assert SLIPS_S < rover.slips_s < SLIPS_S + 0.5
    rover.speed = 0.0
    rover.go(1.0, grip=0.0, walking=walking)
    x, y, yaw = rover.slid
    assert x == pytest.approx(rover.x - rover.rolled, abs=0.015)
    assert abs(y) < 0.01
    assert abs(yaw) < 0.015
    assert not rover.scanning.slip.slipping


def test_half_of_the_way_that_is_lost_is_seen() -> None:
    rover = Slipping(ROOM).go(SLIPS_S).go(1.0, grip=0.4)
    assert rover.slips_s is not None
    assert rover.slips_s > SLIPS_S


def test_along_a_bare_corridor_nothing_is_said() -> None:
    """Its walls tell nothing of how far the base came: the wheels are believed."""
    rover = Slipping(SIDES).go(SLIPS_S).go(1.5, grip=0.0)
    assert rover.slips_s is None


@pytest.mark.parametrize("speed", [0.05, 0.1])
@pytest.mark.parametrize("underside", [0.95, 1.1])
def test_what_a_scan_draws_under_a_lintel_is_no_wall_that_comes_along(
    underside: float, speed: float
) -> None:
    """It goes along with the sweep, and with the base."""
    lintel = box("lintel", (2.0, 0.0, underside + 0.5), (0.6, 1.2, 0.5))
    rover = Slipping((*SIDES, lintel))
    rover.speed = speed
    rover.go(3.0)
    assert rover.slips_s is None


@pytest.mark.parametrize("boxes", [ROOM, ()], ids=["room", "empty"])
@pytest.mark.parametrize("walking", [SPEED, -1.0])
def test_somebody_who_walks_by_or_along_is_no_slip(
    boxes: tuple[BoxSection, ...], walking: float
) -> None:
    rover = Slipping(boxes, walks=True).go(3.5, walking=walking)
    assert rover.slips_s is None
