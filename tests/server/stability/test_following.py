"""How stiff a hand may be, and whether the torque law is stable: against loops run in time."""

import re
from collections import deque

import numpy as np
import pytest
from telerobot.config.load import Cell, altered, load_cell
from telerobot.config.schema.mechanism import TorqueSection
from telerobot.server.stability.judgement import LoopBounds
from telerobot.server.stability.loops import delays, spectral_radius, stiffest_hand

T = 0.01


@pytest.fixture(scope="module")
def cell() -> Cell:
    return load_cell("pa10_hand")


def in_mode(cell: Cell, mode: str) -> Cell:
    return altered(cell, {"mechanism.operation_mode": mode})


def swings(stiffness: float, delay_s: float, dt: float = 1e-4) -> bool:
    """Let a mass of 1 kg with 20 N·s/m swing on a late spring; return whether it builds up."""
    late = deque([0.0] * round(delay_s / dt), maxlen=round(delay_s / dt))
    x, v, peaks = 1e-3, 0.0, []
    for k in range(60_000):
        pull = late[0]
        late.append(x)
        v += dt * (-stiffness * pull - 20.0 * v)
        x += dt * v
        if k % 10_000 == 0:
            peaks.append(0.0)
        peaks[-1] = max(peaks[-1], abs(x))
    return peaks[-1] > peaks[1]


@pytest.mark.parametrize("mode", ["csp", "cst"])
def test_a_hand_stiffer_than_the_bound_makes_the_loop_swing(cell: Cell, mode: str) -> None:
    cell = in_mode(cell, mode)
    delay_s, bound = sum(delays(cell).values()) * T, stiffest_hand(cell)
    assert not swings(0.95 * bound, delay_s)
    assert swings(1.05 * bound, delay_s)


def test_a_stated_lag_makes_the_arm_later_and_the_hand_softer(cell: Cell) -> None:
    torque = in_mode(cell, "cst")
    lag = cell.config.torque.lag_s
    assert sum(delays(torque).values()) - sum(delays(cell).values()) == pytest.approx(0.5 + lag / T)
    assert stiffest_hand(torque) < stiffest_hand(cell)


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        ((1.5, 1, 1, 0, 0, 0), r"gain\[0\] = 1.5: a share"),
        ((1, -0.1, 1, 0, 0, 0), r"gain\[1\] = -0.1: a share"),
    ],
)
def test_following_more_than_there_is_is_refused(cell: Cell, gain, words) -> None:
    refusal = LoopBounds(cell).gain("following", gain).refusal
    assert refusal is not None
    assert re.search(words, refusal)


def test_following_a_hand_that_is_too_stiff_is_refused(cell: Cell) -> None:
    stiff = altered(cell, {"sources.following.stiffest_hand": 5000.0})
    assert "5000 N/m" in (LoopBounds(stiff).gain("following", (1, 1, 1, 0, 0, 0)).refusal or "")
    assert LoopBounds(cell).gain("following", (1, 1, 1, 0, 0, 0)).refusal is None


# --- the torque law ----------------------------------------------------------------------------


def grows(gains: TorqueSection, ratio: float) -> bool:
    """Run the law's axis in time, as its docstring says it; return whether errors build up."""
    x, v, sent, acted, expected, sizes = 1.0, 0.0, 0.0, 0.0, 0.0, []
    for _ in range(4000):
        expected += T * acted
        r = gains.observer * (v - expected) / (1.0 + gains.observer * T)
        expected += T * r
        ahead_v = v + T * (sent + r)
        ahead_x = x + T * (v + 0.5 * T * (sent + r))
        ask = -gains.stiffness * ahead_x - gains.damping * ahead_v - r
        x, v = x + T * (v + 0.5 * T * sent / ratio), v + T * sent / ratio
        sent, acted = ask, sent
        sizes.append(abs(x) + abs(v))
        if sizes[-1] > 1e6:
            return True
    return max(sizes[-100:]) > 1e-2


@pytest.mark.parametrize("ratio", [0.25, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("observer", [0.0, 10.0, 60.0])
@pytest.mark.parametrize("damping", [20.0, 60.0, 140.0])
def test_poles_inside_the_circle_are_errors_that_die_out(ratio, observer, damping) -> None:
    gains = TorqueSection(stiffness=0.25 * damping**2, damping=damping, observer=observer)
    radius = spectral_radius(gains, T, ratio)
    if abs(radius - 1.0) > 5e-3:
        assert grows(gains, ratio) == (radius > 1.0)


def test_the_shipped_gains_are_stable_with_half_and_twice_the_inertia(cell: Cell) -> None:
    radii = [spectral_radius(cell.config.torque, T, ratio) for ratio in (0.5, 1.0, 2.0)]
    assert np.max(radii) < 0.97
