import numpy as np
import pytest
from telerobot.server.control.stop.limiter import Gate

from ..bounds import bounded

T = 0.01
BOUNDS = {"speed": 1.0, "acceleration": 50.0, "jerk": 20_000.0}
TIMES = T * np.arange(4)[::-1]


def gate(**bounds):
    V, A, J = ([b, 1e9] for b in {**dict.fromkeys(BOUNDS, 1e12), **bounds}.values())
    return Gate(bounded(-2.0, np.full(2, 2.0), A, J, V, names=("wrist", "elbow")), T)


def posture(wrist, elbow=0.0):
    return np.array([wrist, elbow])


def motion(name, value):
    """The last four postures, newest first, of a motion that is `value` in one derivative."""
    order = {"speed": 1, "acceleration": 2, "jerk": 3}[name]
    factor = {1: 1.0, 2: 0.5, 3: 1 / 6}[order]
    if order == 3:  # differences of t³/6 are exact about the middle of the four
        return [posture(value * factor * t**3) for t in TIMES - 1.5 * T]
    return [posture(value * factor * t**order) for t in TIMES]


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("name", "bound"), BOUNDS.items())
def test_a_step_just_beyond_a_bound_is_refused_by_name_and_one_just_inside_is_not(
    name, bound, sign
):
    newest, *sent = motion(name, 1.0009 * sign * bound)
    assert gate(**{name: bound}).refusal(newest, tuple(sent)) is None
    newest, *sent = motion(name, 1.0011 * sign * bound)
    refusal = gate(**{name: bound}).refusal(newest, tuple(sent))
    assert refusal is not None
    assert refusal.startswith(f"wrist: {name}")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("speed", "speed -2 beyond 1.001 rad/s"),
        ("acceleration", "acceleration -100 beyond 50.05 rad/s²"),
        ("jerk", "jerk -4e+04 beyond 2.002e+04 rad/s³"),
    ],
)
def test_a_refusal_tells_value_and_bound_in_units_of_the_bound(name, words):
    newest, *sent = motion(name, -2.0 * BOUNDS[name])
    assert gate(**{name: BOUNDS[name]}).refusal(newest, tuple(sent)) == f"wrist: {words}"


@pytest.mark.parametrize(("name", "roundings"), [("speed", 2), ("acceleration", 4), ("jerk", 8)])
def test_rounding_of_the_postures_is_allowed_for_and_no_more(name, roundings):
    """Each posture may be off by 1e-11: a difference of order k by 2^k times that."""
    rest = posture(0.0)
    still = gate(**{name: 0.0})
    assert still.refusal(posture(0.99e-11 * roundings), (rest, rest, rest)) is None
    refusal = still.refusal(posture(1.01e-11 * roundings), (rest, rest, rest))
    assert refusal is not None
    assert refusal.startswith(f"wrist: {name}")


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_bound_may_be_passed_by_rounding_and_no_more(side):
    at = posture(2.0 * side)
    assert gate().refusal(posture(side * (2.0 + 0.99e-11)), (at, at, at)) is None
    assert gate().refusal(posture(side * (2.0 + 1.01e-11)), (at, at, at)) is not None


def test_what_one_bound_refuses_the_others_do_not_mind():
    for name, bound in BOUNDS.items():
        newest, *sent = motion(name, 2 * bound)
        assert gate().refusal(newest, tuple(sent)) is None


@pytest.mark.parametrize("q", [-2.0, 2.0])
def test_a_bound_may_be_reached_and_not_passed(q):
    at = posture(0.0, q)
    assert gate().refusal(at, (at, at, at)) is None
    beyond = posture(0.0, q + np.copysign(1e-9, q))
    refusal = gate().refusal(beyond, (at, at, at))
    assert refusal is not None
    assert refusal.startswith("elbow: position")


def test_from_beyond_a_bound_the_way_back_is_open_and_the_way_out_is_not():
    at = posture(2.1)
    assert gate().refusal(at, (at, at, at)) is None
    assert gate().refusal(posture(2.0999), (at, at, at)) is None
    assert gate().refusal(posture(2.1001), (at, at, at)) is not None


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_a_number_is_refused_and_its_joint_named(value):
    rest = posture(0.0)
    refusal = gate(**BOUNDS).refusal(posture(0.0, value), (rest, rest, rest))
    assert refusal == f"elbow: command is {value}"


def test_the_joint_that_is_furthest_out_is_the_one_named():
    rest = posture(0.0)
    both = Gate(bounded(-2.0, rest + 2.0, 1.0, 1.0, 1.0, names=("a", "b")), T)
    assert both.refusal(posture(0.02, -0.03), (rest, rest, rest)).startswith("b: speed -3 ")
    assert both.refusal(posture(0.03, -0.03), (rest, rest, rest)).startswith("a: speed 3 ")
    assert both.refusal(posture(2.5, -2.5), (rest, rest, rest)).startswith("a: position 2.5")


def test_from_below_a_bound_the_way_back_is_open_and_the_way_out_is_not():
    at = posture(-2.1)
    assert gate().refusal(at, (at, at, at)) is None
    assert gate().refusal(posture(-2.0999), (at, at, at)) is None
    refusal = gate().refusal(posture(-2.1001), (at, at, at))
    assert refusal is not None
    assert refusal.startswith("wrist: position -2.1001")


def test_far_below_is_named_before_a_little_above():
    rest = posture(0.0)
    assert gate().refusal(posture(2.1, -2.5), (rest, rest, rest)).startswith("elbow: position")
    assert gate().refusal(posture(-2.5, 2.1), (rest, rest, rest)).startswith("wrist: position")


@pytest.mark.parametrize("age", [0, 1, 2])
def test_what_follows_something_that_is_not_a_number_is_refused(age):
    rest = posture(0.0)
    sent = [rest, rest, rest]
    sent[age] = posture(0.0, np.nan)
    assert gate(**BOUNDS).refusal(rest, tuple(sent)) is not None
    sent[age] = posture(np.nan, 0.0)
    assert gate(**BOUNDS).refusal(rest, tuple(sent)) is not None
