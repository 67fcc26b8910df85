"""A jam is force against what is asked for without any progress; it is told once."""

from types import SimpleNamespace

import numpy as np
import pytest
from telerobot.server.control.spatial import Pose, rotation_exp
from telerobot.server.perception.contact import JAMMED_S, PRESSED_N, JamMonitor

T, SPEED = 0.01, 0.004
GRASPS = np.array([[0.0, 0.4, 0.0], [0.0, -0.4, 0.0]])
ALONG = np.array([SPEED, 0.0, 0.0])


class Told(list):
    def __init__(self):
        super().__init__()
        self.details = []

    def warning(self, name, detail, **values):
        self.append((name, values))
        self.details.append(detail)

    info = warning


@pytest.fixture
def told():
    return Told()


@pytest.fixture
def monitor(told):
    return JamMonitor(T, told)


def play(
    monitor, seconds, asked=ALONG, force=12.0, goes=0.0, at=None, aside=0.0, lever=0.005, turns=0.0,
    turning=0.0, limits=(),
):  # fmt: skip
    """Ask for a velocity, go a part of it, press along x with a force; return where it came to.

    It is answered from `aside` by a part of that, at a `lever` from the MRF. About z it `turns`,
    where a `turning` is asked for [rad/s].
    """
    at = np.zeros(3) if at is None else at
    for k in range(round(seconds / T)):
        u = asked(k * T) if callable(asked) else asked
        at = at + goes * T * u
        wrench = None if force is None else force * np.array([1.0, aside, 0.0, 0.0, 0.0, lever])
        twists = {"joystick": np.array([*u, 0.0, 0.0, turning]), "force": -np.ones(6)}
        pose = Pose(rotation_exp(np.array([0.0, 0.0, k * T * turns])), at)
        monitor.update(
            SimpleNamespace(wrench=wrench, twists=twists, T_world_mrf_measured=pose, limits=limits)
        )
    return at


def test_it_is_told_once_with_force_and_ways_after_its_time(monitor, told):
    play(monitor, JAMMED_S - 0.2)
    assert told == []
    play(monitor, 5.0)
    ((name, values),) = told
    assert name == "jammed"
    assert monitor.jammed
    assert values["force_n"] == pytest.approx(12.0)
    assert values["way_m"] == 0.0
    assert values["asked_m"] == pytest.approx(SPEED * JAMMED_S)


def test_a_motion_that_goes_on_is_none_however_hard_it_presses(monitor, told):
    play(monitor, 5.0, force=100.0, goes=0.3)
    assert told == []


def test_what_holds_it_up_without_force_is_no_contact(monitor, told):
    play(monitor, 5.0, force=0.5 * PRESSED_N)
    assert told == []


def test_pressing_with_a_stick_at_rest_is_none(monitor, told):
    play(monitor, 5.0, asked=np.zeros(3))
    assert told == []


def test_pulling_away_from_what_is_pressed_is_none(monitor, told):
    play(monitor, 5.0, asked=-ALONG)
    assert told == []


def test_after_progress_the_next_one_is_told_anew(monitor, told):
    at = play(monitor, 3.0)
    at = play(monitor, 3.0, goes=1.0, at=at)
    assert not monitor.jammed
    play(monitor, 3.0, at=at)
    assert len(told) == 2


def test_without_a_reading_nothing_is_known(monitor, told):
    play(monitor, 1.5)
    play(monitor, 0.2, force=None)
    play(monitor, 1.5)
    assert told == []


@pytest.mark.parametrize("force", [None, 0.0], ids=["no sensor", "sensor"])
def test_what_only_the_leash_tells_of_is_told_with_the_joints(monitor, told, force):
    play(monitor, JAMMED_S - 0.2, force=force, limits=("press", "leash:s2", "leash:e1"))
    play(monitor, JAMMED_S + 0.2, force=force, limits=("leash:s2",))
    assert [name for name, _ in told] == ["held_up"]
    assert "with s2 far behind the command," in told.details[0]
    assert not monitor.jammed


def test_a_leash_that_lets_the_tool_get_on_holds_nothing_up(monitor, told):
    at = play(monitor, 5.0, force=0.0, goes=0.5, limits=("leash:s2",))
    play(monitor, 1.5, force=0.0, at=at, limits=("leash:s2",))
    play(monitor, 0.2, force=0.0, at=at)
    play(monitor, 1.5, force=0.0, at=at, limits=("leash:s2",))
    assert told == []


@pytest.mark.parametrize(
    ("aside", "lever", "name"),
    [(0.0, 0.0, "held_up"), (0.1, 0.001, "held_up"), (0.0, -0.004, "jammed"), (0.5, 0.0, "jammed")],
    ids=["wall", "nearly", "on an edge", "from the side"],
)
def test_a_push_straight_on_a_plain_wall_is_no_jam_and_one_on_an_edge_is(
    monitor, told, aside, lever, name
):
    play(monitor, 5.0, aside=aside, lever=lever)
    assert [said for said, _ in told] == [name]
    assert monitor.jammed is (name == "jammed")


def test_a_wall_whose_edge_the_tool_slips_onto_is_a_jam_from_then_on(monitor, told):
    at = play(monitor, 3.0, lever=0.0)
    play(monitor, 3.0, at=at, lever=0.01)
    assert [name for name, _ in told] == ["held_up", "jammed"]


def test_whatever_a_payload_presses_on_is_a_jam(told):
    play(JamMonitor(T, told, GRASPS), 3.0, lever=0.0)
    assert [name for name, _ in told] == ["jammed"]


def test_a_payload_that_turns_about_one_end_is_a_jam_there(told):
    """Its middle goes on at half the speed that is asked for; one end stands."""
    turns = 0.5 * SPEED / 0.4
    play(JamMonitor(T, told, GRASPS), JAMMED_S - 0.2, goes=0.5, turns=turns)
    assert told == []
    play(JamMonitor(T, told, GRASPS), JAMMED_S + 0.2, goes=0.5, turns=turns)
    ((name, values),) = told
    assert name == "jammed"
    assert values["way_m"] == pytest.approx(0.0, abs=1e-4)
    assert values["asked_m"] == pytest.approx(SPEED * JAMMED_S)


@pytest.mark.parametrize("turns", [1.0, -1.0, 0.5])
def test_a_payload_that_turns_as_it_is_asked_to_is_none(told, turns):
    turning = turns * 0.5 * SPEED / 0.4
    play(JamMonitor(T, told, GRASPS), 5.0, goes=1.0, turns=turning, turning=turning)
    assert told == []


def test_a_tool_that_turns_as_it_goes_on_is_none(monitor, told):
    play(monitor, 5.0, goes=0.5, turns=0.5 * SPEED / 0.4)
    assert told == []
