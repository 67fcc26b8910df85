"""Giving way after a touch: back along the way, where nothing else pushes, inside the leash."""

import numpy as np
import pytest
from telerobot.server.control.hold import FASTEST, SLOWEST, STEP, Retreat
from telerobot.server.control.inputs import Pushed

T = 0.01
LEASH = 0.1
BOUND = np.array([3.0, 3.0])
FREE, SEEN = np.zeros(2), (30.0, 0.0)


J = np.eye(6, 2)
"""The sensor sees joint torques as forces."""


def push(*torque, seen=(0.0, 0.0), seen_before=(0.0, 0.0), **more):
    told = {"touched": True, "lasting": True, "free": FREE, **more}
    wrench, before = J @ np.array(seen), J @ np.array(seen_before)
    return Pushed(
        np.array(torque), FREE, BOUND, wrench=wrench, steady=wrench, free_wrench=before, **told
    )


def came(retreat, speed=0.1, seconds=2.0, turn_s=None):
    """Return state, command and time after a motion of joint 0, from `turn_s` on of joint 1."""
    state, q = retreat.start, np.zeros(2)
    for k in range(round(seconds / T)):
        turned = turn_s is not None and k * T >= turn_s
        q = q + speed * T * (np.array([0.0, 1.0]) if turned else np.array([1.0, 0.0]))
        state, dq = retreat.step(state, q, np.zeros(2), J, None, k * T, False)
        assert not dq.any()
    return state, q, seconds


def held(retreat, state, q, time_s, pushed, asked=FREE, seconds=5.0):
    """Return the commands of a HOLD; `pushed` is told the command and tells the estimate."""
    way = [q]
    for k in range(round(seconds / T)):
        state, dq = retreat.step(state, q, asked, J, pushed(q), time_s + k * T, True)
        q = q + T * dq
        way.append(q)
    return state, np.array(way)


@pytest.fixture
def retreat():
    return Retreat(LEASH, T)


def test_the_arm_goes_back_to_where_it_was_free_and_no_further(retreat):
    state, q, now = came(retreat)
    state, way = held(retreat, state, q, now, lambda q: push(0.0, 0.0, lasting=False))
    back = q[0] - way[-1, 0]
    assert abs(back - 0.2 * 0.1) <= STEP  # the last 0.2 s
    assert np.diff(way[:, 0]).max() <= 0.0
    assert state.rate == 0.0


def test_it_goes_on_back_while_it_is_pushed_and_ends_with_the_push(retreat):
    state, q, now = came(retreat)
    state, way = held(retreat, state, q, now, lambda at: push(-200.0 * max(0.0, at[0] - 0.15), 0.0))
    assert 0.15 < way[-1, 0] < 0.162
    assert np.abs(np.diff(way, axis=0)).max() <= FASTEST * T


def test_it_follows_the_way_round_a_corner(retreat):
    state, q, now = came(retreat, turn_s=1.7)  # 0.03 rad of joint 1 are the newest
    state, way = held(retreat, state, q, now, lambda at: push(-9.0, -9.0))
    corner = np.array([0.17, 0.0])
    assert np.abs(way - corner).max(axis=1).min() < 3e-3
    assert way[-1, 0] < 0.13


@pytest.mark.parametrize("turn_s", [1.7, 0.0], ids=["the newest part", "the whole way"])
def test_a_joint_that_is_held_up_stands_and_the_other_gives_way_inside_the_leash(retreat, turn_s):
    state, q, now = came(retreat, turn_s=turn_s)
    start, held_up = q, np.array([0.0, -1.0])
    for k in range(200):
        pushed, at_s = push(-9.0, 0.0), now + k * T
        state, dq = retreat.step(state, q, FREE, J, pushed, at_s, True, held_up=held_up)
        q = q + T * dq
    assert q[1] == start[1]
    assert 0.02 < start[0] - q[0] <= LEASH


def test_a_joint_that_sweeps_is_no_part_of_the_way_and_stands():
    retreat = Retreat(LEASH, T, gives_way=np.array([True, False]))
    state, q = retreat.start, np.zeros(2)
    for k in range(200):
        q = np.array([0.1 * T * k, np.sin(0.2 * k)])
        state, _ = retreat.step(state, q, np.zeros(2), J, None, k * T, False)
    state, way = held(retreat, state, q, 2.0, lambda at: push(-200.0 * max(0.0, at[0] - 0.15), 5.0))
    assert 0.15 < way[-1, 0] < 0.162
    assert np.ptp(way[:, 1]) == 0.0


def test_a_hard_push_off_the_way_is_given_way_to_quicker_than_a_gentle_one(retreat):
    rates = {}
    for torque in (3.0, 9.0, 90.0):
        state, q, now = came(retreat)
        state, way = held(retreat, state, q, now, lambda at, t=torque: push(0.0, t), seconds=0.7)
        rates[torque] = float(np.diff(way[:, 1]).max()) / T
    assert rates[3.0] == pytest.approx(SLOWEST)
    assert SLOWEST < rates[9.0] < rates[90.0]
    assert rates[90.0] == pytest.approx(FASTEST)


@pytest.mark.parametrize("seen", [False, True])
def test_it_does_not_go_back_into_another_push(retreat, seen):
    state, q, now = came(retreat)

    def met(at):
        behind = 200.0 * max(0.0, q[0] - 0.008 - at[0])
        return push(0.0, 0.0, seen=(behind, 0.0)) if seen else push(behind, 0.0)

    state, way = held(retreat, state, q, now, met)
    assert way[-1, 0] > q[0] - 0.03 - 0.01  # bound / stiffness, and how long it has to last
    assert state.rate == 0.0


def test_a_push_that_does_not_end_takes_the_leash_and_no_more(retreat):
    state, q, now = came(retreat)
    state, way = held(retreat, state, q, now, lambda at: push(-50.0, 0.0), seconds=10.0)
    assert 0.95 * LEASH < np.abs(way - q).max() <= LEASH
    assert state.rate == 0.0


def test_a_joint_at_the_end_of_its_leash_stands_and_the_other_gives_way_further(retreat):
    state, q, now = came(retreat)

    def met(at):
        return push(-50.0, -200.0 * max(0.0, at[1] + 0.06))

    state, way = held(retreat, state, q, now, met, seconds=10.0)
    assert 0.95 * LEASH < q[0] - way[-1, 0] <= LEASH
    assert met(way[-1]).external[1] > -BOUND[1]
    assert way[-1, 1] > -0.06


def test_the_stops_own_way_takes_nothing_off_the_leash(retreat):
    """At 1.5 rad/s a stop goes further beyond contact than the leash is long."""
    rate = np.array([1.5, 0.0])
    state, q, now = came(retreat, speed=1.5, seconds=0.5)
    q = felt = q + T * rate
    while rate[0] > 0.0:
        state, _ = retreat.step(state, q, FREE, J, push(-50.0, 0.0), now, False)
        rate = rate - np.array([10.0 * T, 0.0])
        q, now = q + T * np.maximum(rate, 0.0), now + T
    assert q[0] - felt[0] > LEASH
    state, way = held(retreat, state, q, now, lambda at: push(-50.0, 0.0))
    assert felt[0] - LEASH <= way[-1, 0] < felt[0] - 0.9 * LEASH
    back = int(np.argmax(way[:, 0] < felt[0]))
    assert 0 < back * T < 0.7


def test_where_the_push_leads_off_the_path_it_goes_there_and_never_forward(retreat):
    state, q, now = came(retreat, seconds=4.0)

    def aside(at):
        return push(2.0, -400.0 * max(0.0, at[1] + 0.03))

    state, way = held(retreat, state, q, now, aside)
    assert -0.032 < way[-1, 1] < -0.02
    assert way[:, 0].max() <= q[0] + 1e-9


def test_what_was_felt_before_the_touch_leads_nowhere(retreat):
    """A payload of which nobody told weighs before and after: the arm may lie on what is below."""
    state, q, now = came(retreat)
    load = np.array([0.0, 30.0])
    state, way = held(retreat, state, q, now, lambda at: push(*load, free=load))
    assert np.abs(way[:, 1]).max() < 1e-9


def test_an_arm_that_stood_and_is_not_pushed_any_more_stays(retreat):
    state, q, now = came(retreat)
    for _ in range(100):
        now += T
        state, _ = retreat.step(state, q, FREE, J, None, now, False)
    state, way = held(retreat, state, q, now, lambda at: push(0.0, 0.0, lasting=False))
    assert np.abs(way - q).max() == 0.0


def test_a_tool_that_a_wrong_load_hangs_on_lets_go_of_what_it_met_since(retreat):
    state, q, now = came(retreat, seconds=4.0)
    load = np.array([0.0, -50.0])

    def met(at):
        wall = np.array([-900.0 * max(0.0, at[0] - 0.35), 0.0])
        return push(0.0, 0.0, seen=load + wall, seen_before=load, tool_bound=10.0)

    state, way = held(retreat, state, q, now, met)
    assert way[-1, 0] < 0.35 + 10.0 / 900.0
    assert way[-1, 0] > 0.33
    assert np.abs(way[:, 1]).max() < 1e-9


def test_a_joint_that_its_way_back_would_press_on_is_left_out(retreat):
    """A straight way of the tool takes one joint forth and another back."""
    state, q = retreat.start, np.zeros(2)
    for k in range(300):
        q = q + T * np.array([0.1, 0.05])
        state, _ = retreat.step(state, q, FREE, J, None, k * T, False)

    def met(at):
        force = 900.0 * max(0.0, at[0] - 0.25)
        return push(0.0, 0.0, seen=(-force, force), tool_bound=10.0)

    state, way = held(retreat, state, q, 3.0, met)
    assert way[-1, 0] < 0.25 + 10.0 / 900.0
    pressed = way[:, 0] > 0.25 + 10.0 / 900.0
    assert np.abs(way[pressed, 1] - q[1]).max() < 1e-9


@pytest.mark.parametrize(
    ("pushed", "goes"),
    [
        (push(-9.0, 0.0), False),
        (push(0.0, 0.0, lasting=False, seen=SEEN, seen_before=SEEN), False),
        (push(0.0, 0.0, lasting=False, seen=SEEN), True),
    ],
    ids=["unseen contact", "a wrong payload", "contact that came with the touch"],
)
def test_bleeding_off_goes_forward_only_to_relieve_contact_that_came_with_the_touch(
    retreat, pushed, goes
):
    state, q, now = came(retreat)
    asked = np.array([SLOWEST, 0.0])
    state, _ = held(retreat, state, q, now, lambda at: push(0.0, 0.0, lasting=False))
    _, dq = retreat.step(state, state.q, asked, J, pushed, now + 5.0, True)
    assert (dq[0] > 0.0) == goes


def test_without_a_touch_bleeding_off_stops_at_what_pushes_unseen(retreat):
    state, q, now = came(retreat)
    asked = np.array([SLOWEST, 0.0])
    _, free = retreat.step(state, q, asked, J, push(0.0, 0.0, touched=False), now, True)
    _, into = retreat.step(state, q, asked, J, push(-9.0, 0.0, touched=False), now, True)
    assert free[0] == SLOWEST
    assert into[0] == 0.0


def test_what_force_control_relieved_is_no_way_to_go_back_on(retreat):
    """Beside a jog it leads out of contact: back along that would press on again."""
    state, q, now = came(retreat)
    off = np.array([-0.1, 0.1])
    for k in range(10):
        q = q + T * off
        state, _ = retreat.step(state, q, np.zeros(2), J, None, now + k * T, False, True)
    _, way = held(retreat, state, q, now + 0.1, lambda q: push(0.0, 0.0, lasting=False))
    assert np.diff(way[:, 0]).max() <= 1e-9
    np.testing.assert_allclose(way[-1], [0.2 - 0.2 * 0.1, 0.0], atol=1.5 * STEP)
