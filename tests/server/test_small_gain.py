"""The rules for rate mode's loop, against the loop itself: a delayed linear one, stepped."""

from collections import deque

import pytest
from telerobot.config.schema.network import HandleSection, HandSection
from telerobot.server.reflection import ARM_S, GREATEST, HeldStick

STEP_S = 0.002


def ripple(stick, handle, hand, gain, delay_s, filter_s, seconds=12.0):
    """Return what is left of a contact's bounce in the last second, by its mean."""
    k = handle.spring + hand.stiffness
    b = handle.damping + handle.spring_damping + hand.damping
    history = deque([0.0] * (1 + round(delay_s / STEP_S)))
    x, v, arm, felt, forces = 1.0, 0.0, 0.0, 0.0, []
    for _ in range(round(seconds / STEP_S)):
        history.append(x)
        # The arm's answer to the stick, a first order; contact only pushes.
        arm += STEP_S / ARM_S * (max(0.0, history.popleft()) - arm)
        felt += (arm - felt) * (1.0 if filter_s <= 0 else STEP_S / (STEP_S + filter_s))
        push = k * (1.0 + gain) - k * gain * felt
        v += STEP_S * (push - k * x - b * v) / handle.mass
        x += STEP_S * v
        forces.append(arm)
    last = forces[-round(1.0 / STEP_S) :]
    return (max(last) - min(last)) / (sum(last) / len(last))


DELAYS_S = [0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5]


@pytest.fixture
def stick():
    return HeldStick.of(HandleSection(), HandSection())


@pytest.mark.parametrize("delay_s", DELAYS_S)
def test_below_the_bound_no_delay_makes_it_bounce(stick, delay_s):
    assert stick.bound == 0.6
    assert stick.filter_s(0.6, delay_s) == 0.0
    assert ripple(stick, HandleSection(), HandSection(), 0.6, delay_s, 0.0) < 0.05


@pytest.mark.parametrize("delay_s", DELAYS_S)
@pytest.mark.parametrize("gain", [0.7, 1.0, 2.0, GREATEST])
def test_above_it_the_filter_settles_what_bounces_without(stick, gain, delay_s):
    assert (
        ripple(stick, HandleSection(), HandSection(), gain, delay_s, stick.filter_s(gain, delay_s))
        < 0.05
    )
    if gain >= 2.0 and delay_s >= 0.1:
        assert ripple(stick, HandleSection(), HandSection(), gain, delay_s, 0.0) > 0.5


def test_a_stick_that_is_less_damped_has_a_lower_bound():
    loose = HeldStick.of(HandleSection(damping=0.5, spring_damping=0.0), HandSection(damping=5.0))
    assert loose.damping_ratio < 0.7
    assert loose.bound == 0.4


def test_the_filter_grows_with_gain_and_round_trip(stick):
    times = [stick.filter_s(g, rtt) for g, rtt in ((0.6, 0.5), (0.7, 0.1), (1.4, 0.1), (1.4, 0.5))]
    assert times == sorted(times)
    assert times[0] == 0.0 < times[1]
