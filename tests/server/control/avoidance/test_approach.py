"""How fast gaps may close: against the law written out, and against an arm that brakes."""

import numpy as np
import pytest
from telerobot.server.control.avoidance.approach import (
    BRAKING,
    RETURN_RATE,
    RETURN_SPEED,
    Braking,
)

PERIOD_S = 0.01
ACCELERATION = np.array([2.0, 3.0, 4.0])
JERK = np.array([20.0, 60.0, 50.0])
BRAKES = Braking(ACCELERATION, JERK, PERIOD_S)


@pytest.fixture
def gaps(rng):
    """Slopes, room and closing speed: gaps with room and without, to what stands and what comes."""
    slopes = rng.uniform(-1.0, 1.0, (60, 3))
    slopes[0] = 0.0
    return slopes, rng.uniform(-0.05, 0.3, 60), np.maximum(rng.uniform(-0.3, 0.3, 60), 0.0)


@pytest.mark.parametrize("factor", [1.0, 0.3])
@pytest.mark.parametrize("widen", [False, True])
def test_the_speed_is_that_of_the_law(gaps, factor, widen):
    slopes, room, closing = gaps
    lag = 2.0 * (factor * 0.1 + PERIOD_S)
    size = np.abs(slopes)
    slowest = np.maximum((size / (factor * ACCELERATION)).max(axis=1), 1e-12)
    a = BRAKING * (size * size).sum(axis=1) / slowest
    b = a * lag + closing
    speed = np.sqrt(b * b + 2.0 * a * np.maximum(room - closing * lag, 0.0)) - b
    if widen:
        beyond = np.maximum(closing * lag - room, 0.0)
        speed -= np.minimum(RETURN_RATE * beyond, RETURN_SPEED)
    rows = BRAKES.rows(slopes, room, closing, factor, widen)
    assert rows.low == pytest.approx(-speed, abs=1e-12)
    assert rows.A is slopes


def test_an_arm_that_closes_so_fast_stands_before_its_room_is_used_up(gaps):
    slopes, room, closing = gaps
    rows = BRAKES.rows(slopes, room, closing, 1.0, widen=False)
    for slope, left, comes, speed in zip(slopes, room, closing, -rows.low, strict=True):
        if not slope.any() or speed <= 0.0:
            assert speed <= 1e-12
            continue
        # The joint rates with that speed and the least size, braked once the lag is over.
        dq = speed * np.abs(slope) / float(slope @ slope)
        braking_s = float((dq / ACCELERATION).max())
        way = speed * (BRAKES.lag(1.0) + 0.5 * braking_s) + comes * (BRAKES.lag(1.0) + braking_s)
        assert way < left
