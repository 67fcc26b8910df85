"""How far back a base may go at speed: as far as it came, or as rays saw."""

import numpy as np
import pytest
from telerobot.server.control.spatial import Pose
from telerobot.server.perception.scanning.placing import (
    BANDS,
    CELL,
    LOOKS_BACK,
    LOWEST,
    SEEN_S,
    GroundBehind,
)

REAR = 0.35
STANDS_OFF = 0.15


@pytest.fixture
def ground():
    return GroundBehind(width=0.6, rear=REAR, height=0.5)


def at(x):
    return Pose(np.eye(3), np.array([x, 0.0, 0.0]))


def drive(ground, to, time_s=0.0):
    for x in np.arange(0.0, to + 1e-9, 0.02):
        ground.stand(at(x), time_s)


def look(ground, ends, echo=False):
    """Rays from 1 m ahead of the start, where they all pass."""
    ends = np.array(ends, dtype=float)
    ground.see(
        np.array([1.0, 0.0, 0.3]),
        ends,
        np.full(len(ends), echo),
        np.zeros(len(ends), dtype=bool),
        1.0,
    )


def test_what_nobody_saw_is_no_room(ground):
    ground.stand(at(0.0), 0.0)
    assert ground.room(at(0.0), 0.0) == 0.0


def test_the_base_may_go_back_as_far_as_it_came(ground):
    drive(ground, 1.2)
    assert ground.room(at(1.2), 0.0) == pytest.approx(1.2 - STANDS_OFF, abs=CELL)
    drive(ground, 4.0)
    assert ground.room(at(4.0), 0.0) == pytest.approx(LOOKS_BACK - STANDS_OFF)


def test_what_was_seen_long_ago_may_have_changed(ground):
    drive(ground, 1.2)
    assert ground.room(at(1.2), SEEN_S - 1.0) > 1.0
    assert ground.room(at(1.2), SEEN_S + 1.0) == 0.0


def test_ground_counts_as_seen_when_rays_went_through_it_at_all_heights(ground):
    across = np.linspace(-0.45, 0.45, 40)
    heights = LOWEST + CELL * np.arange(-0.5, BANDS + 0.5, 0.4)
    ground.stand(at(0.0), 1.0)
    for half in (heights[: len(heights) // 2], heights):
        for z in half:  # level rays, as from scanners at all heights
            for y in across:
                ground.see(
                    np.array([-0.2, y, z]),
                    np.array([[-2.0, y, z]]),
                    np.zeros(1, dtype=bool),
                    np.zeros(1, dtype=bool),
                    1.0,
                )
        if half is not heights:
            assert ground.room(at(0.0), 1.0) == 0.0
    assert ground.room(at(0.0), 1.0) > 1.0


def test_what_a_ray_ended_on_ends_the_room(ground):
    drive(ground, 1.5)
    look(ground, [[0.4, 0.1, 0.8]] * 2, echo=True)
    assert ground.room(at(1.5), 1.0) == pytest.approx(1.5 - REAR - 0.4 - STANDS_OFF, abs=1.5 * CELL)


def test_what_rays_go_through_again_is_gone(ground):
    drive(ground, 1.5)
    look(ground, [[0.45, 0.15, 0.8]] * 2, echo=True)
    assert ground.room(at(1.5), 1.0) < 0.7
    look(ground, [[-0.1, 0.3, 1.3]] * 40)
    assert ground.room(at(1.5), 1.0) > 1.2


def test_the_arms_own_rays_tell_nothing(ground):
    drive(ground, 1.5)
    ends = np.array([[0.4, 0.1, 0.8]] * 5)
    ones = np.ones(5, dtype=bool)
    ground.see(np.array([1.0, 0.0, 0.3]), ends, ones, ones, 1.0)
    assert ground.room(at(1.5), 1.0) > 1.2
