"""How fast gaps may close: against the law written out, and against an arm that brakes."""

import numpy as np
import pytest
from telerobot.server.control.barriers.rows import (
    ASIDE_RATE,
    BRAKING,
    CATCH_UP,
    RETURN_RATE,
    RETURN_SPEED,
    SOON_S,
    Braking,
    Walled,
)

PERIOD_S = 0.01
ACCELERATION = np.array([2.0, 3.0, 4.0])
JERK = np.array([20.0, 60.0, 50.0])
BRAKES = Braking(ACCELERATION, JERK, PERIOD_S)
STANDS = np.zeros(60)
NO_WALLS = Walled(np.zeros((6, 3)), np.zeros(3), np.zeros((0, 3)), np.zeros(0))


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
    rows = BRAKES.rows(slopes, room, (closing, STANDS), NO_WALLS, factor, widen)
    assert rows.low == pytest.approx(-speed, abs=1e-12)
    np.testing.assert_array_equal(rows.A, slopes)


@pytest.mark.parametrize("widen", [False, True])
def test_what_comes_is_made_way_for(gaps, widen):
    """At what room does not allow; where that is used up, at k times by how much, at most 2 u."""
    slopes, room, closing = gaps
    alone = BRAKES.rows(slopes, room, (closing, STANDS), NO_WALLS, 1.0, widen).low
    gently = BRAKES.rows(slopes, room, (closing, STANDS), NO_WALLS, 1.0, widen=False).low
    coming = np.linspace(-0.1, 0.3, 60).clip(0.0)
    low, kept = BRAKES.rows(slopes, room, (closing, coming), NO_WALLS, 1.0, widen)[1:]
    # Of what the arm does itself, a gap may close as if nothing came.
    np.testing.assert_array_equal(kept, np.minimum(alone, 0.0))
    stands = coming == 0.0
    np.testing.assert_array_equal(low[stands], alone[stands])
    depth = np.maximum(closing * BRAKES.lag(1.0) - room, 0.0)
    apart = room - SOON_S * coming
    soon = BRAKES.rows(slopes, apart, (STANDS, STANDS), NO_WALLS, 1.0, widen=False).low
    law = coming + np.maximum(gently, soon)
    deep = np.minimum(ASIDE_RATE * depth, CATCH_UP * coming)
    law = np.where(depth > 0.0, np.maximum(law, deep), law)
    assert low[~stands] == pytest.approx(np.maximum(alone, law)[~stands], abs=1e-12)
    inside = ~stands & (depth > 0.0)
    assert (low[inside] >= coming[inside] - 1e-12).all()


@pytest.mark.parametrize("widen", [False, True])
@pytest.mark.parametrize("coming", [0.02, 0.1, 0.2])
def test_what_comes_and_is_far_may_be_approached_and_less_so_the_nearer_it_is(widen, coming):
    """It is made way for from a second on before it arrives, and that begins without a jump."""
    room = np.linspace(-0.1, 0.6, 7001)
    slopes = np.tile([0.3, -0.2, 0.1], (len(room), 1))
    each = np.full(len(room), 0.2), np.full(len(room), coming)
    low = BRAKES.rows(slopes, room, each, NO_WALLS, 1.0, widen).low
    assert low[-1] < -0.1
    assert (low[room <= SOON_S * coming] >= coming - 1e-12).all()
    steps = np.diff(low)
    assert (steps <= 1e-12).all()
    assert steps.min() > -0.0011  # k per step


@pytest.mark.parametrize("widen", [False, True])
def test_walls_are_gaps_that_stand(gaps, rng, widen):
    slopes, room, closing = gaps
    J, p = rng.uniform(-1.0, 1.0, (6, 3)), rng.uniform(-0.5, 0.5, 3)
    low, high = np.array([-0.4, -0.3, -0.2]), np.array([0.1, 0.2, 0.3])
    box = np.vstack([np.eye(3), -np.eye(3)]), np.r_[low, -high]
    rows = BRAKES.rows(slopes, room, (closing, STANDS), Walled(J, p, *box), 0.5, widen)
    gaps_alone = BRAKES.rows(slopes, room, (closing, STANDS), NO_WALLS, 0.5, widen)
    as_gaps = np.vstack([J[:3], -J[:3]]), np.r_[p - low, high - p], (np.zeros(6), np.zeros(6))
    walls_alone = BRAKES.rows(*as_gaps, NO_WALLS, 0.5, widen)
    np.testing.assert_array_equal(rows.A, np.vstack([gaps_alone.A, walls_alone.A]))
    np.testing.assert_array_equal(rows.low, np.r_[gaps_alone.low, walls_alone.low])


def test_barriers_that_rates_break_are_named_by_place(gaps, rng):
    slopes, room, closing = gaps
    rows = BRAKES.rows(slopes, room, (closing, STANDS), NO_WALLS, 1.0, widen=False)
    for dq in rng.uniform(-1.0, 1.0, (50, 3)) * np.linspace(0.0, 1.0, 50)[:, None]:
        broken, any_broken = rows.broken(dq)
        np.testing.assert_array_equal(broken, rows.A @ dq < rows.low)
        assert any_broken == broken.any()


def test_an_arm_that_closes_so_fast_stands_before_its_room_is_used_up(gaps):
    slopes, room, closing = gaps
    rows = BRAKES.rows(slopes, room, (closing, STANDS), NO_WALLS, 1.0, widen=False)
    for slope, left, comes, speed in zip(slopes, room, closing, -rows.low, strict=True):
        if not slope.any() or speed <= 0.0:
            assert speed <= 1e-12
            continue
        # The joint rates with that speed and the least size, braked once the lag is over.
        dq = speed * np.abs(slope) / float(slope @ slope)
        braking_s = float((dq / ACCELERATION).max())
        way = speed * (BRAKES.lag(1.0) + 0.5 * braking_s) + comes * (BRAKES.lag(1.0) + braking_s)
        assert way < left
