from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from telerobot.config.schema.sources import ScheduleSection
from telerobot.server.control.arm import Arm as ArmControl
from telerobot.server.control.inputs import Intent, PathGoal
from telerobot.server.control.spatial import Pose
from telerobot.server.control.task.task import GAIN_TIME_S, Gains, Quantities
from telerobot.server.control.tick import Control

GAIN = {"joystick": np.ones(6), "position": np.full(6, 2.0), "force": np.full(6, 1e-3)}
NOTHING = Quantities(None, None, 0.0)


def schedule(source="joystick", by="contact_force", at=(10.0, 30.0), factor=(1.0, 0.2), **more):
    return ScheduleSection(source=source, by=by, at=at, factor=factor, **more)


def factor(one, **now):
    gains = Gains((one,), 0.01).scheduled(GAIN, lambda: NOTHING._replace(**now))
    return gains[one.source] / GAIN[one.source]


@pytest.fixture
def scheduled(pa10, start):
    """Start a run of the PA-10 under schedules, from `ready`."""

    def begin(*schedules):
        p = replace(pa10.p, schedules=schedules)
        return start(replace(pa10, p=p, control=Control([ArmControl(p, pa10.mechanism)])))

    return begin


# --- the tables -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("newtons", "expected"), [(0.0, 1.0), (10.0, 1.0), (20.0, 0.6), (30.0, 0.2), (500.0, 0.2)]
)
def test_between_its_points_a_table_is_straight_and_beyond_them_level(newtons, expected):
    np.testing.assert_allclose(factor(schedule(), contact_force=newtons), expected)


def test_each_axis_heeds_the_factor_as_much_as_it_is_told():
    one = schedule(axes=(1.0, 0.5, 0.0, 0.0, 0.0, 1.0))
    found = factor(one, contact_force=30.0)
    np.testing.assert_allclose(found, [0.2, 0.6, 1.0, 1.0, 1.0, 0.2])


def test_other_sources_keep_their_gains():
    gains = Gains((schedule(),), 0.01).scheduled(GAIN, lambda: NOTHING._replace(contact_force=30.0))
    assert gains["position"] is GAIN["position"]


def test_several_schedules_of_one_source_multiply():
    both = (schedule(), schedule(by="time", at=(0.0, 2.0), factor=(0.0, 1.0)))
    gains = Gains(both, 0.01).scheduled(GAIN, lambda: Quantities(20.0, None, 1.0))
    np.testing.assert_allclose(gains["joystick"], 0.6 * 0.5)


def test_a_force_that_is_not_known_counts_as_the_worst():
    np.testing.assert_allclose(factor(schedule(), contact_force=None), 0.2)
    np.testing.assert_allclose(factor(schedule(factor=(0.1, 0.9)), contact_force=None), 0.1)


def test_without_a_target_it_is_beyond_the_tables_end():
    slow_near = schedule(by="distance", at=(0.0, 0.1), factor=(0.3, 1.0))
    np.testing.assert_allclose(factor(slow_near, distance=None), 1.0)
    np.testing.assert_allclose(factor(slow_near, distance=0.05), 0.65)


@pytest.mark.parametrize(
    "wrong",
    [
        {"at": (10.0, 10.0)},
        {"at": (30.0, 10.0)},
        {"at": (10.0, 20.0, 30.0)},
        {"factor": (1.0, 1.5)},
        {"at": (10.0,), "factor": (1.0,)},
        {"source": "wind"},
        {"axes": (2.0, 1.0, 1.0, 1.0, 1.0, 1.0)},
    ],
)
def test_a_table_that_is_none_is_an_error(wrong):
    with pytest.raises(ValidationError):
        schedule(**wrong)


# --- in the tick ----------------------------------------------------------------------------------


def test_a_schedule_by_time_begins_anew_with_each_enable(scheduled, stick):
    run = scheduled(schedule(by="time", at=(0.0, 1.0), factor=(0.0, 1.0)))
    given = {"stick": stick(0.05, 0, 0, 0, 0, 0)}
    T = run.arm.p.period_s
    for _ in range(2):
        first = run.tick(**given)
        assert not first.task.gains["joystick"].any()
        output = run.go(0.8, **given)
        # A first-order lag behind a ramp of 1 /s lags by its time constant.
        lag = GAIN_TIME_S * (1.0 - np.exp(-0.8 / GAIN_TIME_S))
        assert output.task.gains["joystick"][0] == pytest.approx(0.8 - lag, abs=2 * T)
        run.go(0.5, intent=Intent.STOP)
        run.go(0.1, intent=Intent.HOLD)
    run.observe()


def test_a_schedule_by_force_softens_the_stick_in_contact(scheduled, stick):
    run = scheduled(schedule(at=(0.0, 20.0), factor=(1.0, 0.25)))
    run.set(gains=run.arm.gains(force=0.0))
    given = {"stick": stick(0, 0, 0.02, 0, 0, 0)}
    weight = run.arm.control.arms[0].weight(run.pose, run.settings)
    free = run.go(1.5, **given, wrench_sensor=weight)
    assert free.task.gains["joystick"] == pytest.approx(np.ones(6), abs=1e-2)
    pressing = weight + np.array([0.0, 0.0, 10.0, 0.0, 0.0, 0.0])
    half = run.go(1.5, **given, wrench_sensor=pressing)
    assert half.task.gains["joystick"] == pytest.approx(np.full(6, 0.625), abs=0.02)
    assert np.linalg.norm(half.twists["joystick"]) == pytest.approx(0.0125, rel=0.05)
    run.observe()


def test_a_schedule_by_distance_slows_the_approach_and_still_gets_there(scheduled):
    slow = schedule("position", "distance", (0.0, 0.1), (0.5, 1.0))
    run = scheduled(slow)
    goal = PathGoal(Pose(run.pose.R, run.pose.p + np.array([-0.1, 0.05, 0.05])), 1)
    output = run.go(0.05, goal=goal)
    far = output.task.gains["position"][0]
    output = run.go(8.0, goal=goal)
    assert far == pytest.approx(2.0, rel=0.01)
    assert output.task.gains["position"][0] == pytest.approx(1.0, abs=0.02)
    assert output.at_goal
    run.observe()


def test_whatever_a_schedule_says_gains_never_jump(scheduled, stick, rng):
    run = scheduled(
        schedule(at=(1.0, 1.001), factor=(1.0, 0.0)),
        schedule("force", at=(5.0, 5.001), factor=(0.0, 1.0)),
        schedule("position", "distance", (0.01, 0.0101), (0.0, 1.0)),
    )
    goal = PathGoal(Pose(run.pose.R, run.pose.p + np.array([-0.05, 0.05, 0.05])), 1)
    for _ in range(30):
        wrench = rng.normal(size=6) * 5.0 if rng.random() < 0.8 else None
        given = {"stick": stick(0.1, 0, 0, 0, 0.3, 0), "goal": goal, "wrench_sensor": wrench}
        run.go(0.15, **given)
    for source in ("joystick", "position", "force"):
        gains = np.array([o.task.gains[source] for o in run.outputs])
        most = 0.01 / GAIN_TIME_S * run.settings.gains[source]
        assert (np.abs(np.diff(gains, axis=0)) <= most + 1e-12).all()
    run.observe()


# --- ramps ----------------------------------------------------------------------------------------


def test_a_changed_gain_has_gone_a_part_in_a_time_constant_that_does_not_depend_on_the_period():
    for period_s in (0.01, 0.005):
        ramp, now, target = Gains((), period_s), {"force": np.zeros(6)}, {"force": np.ones(6)}
        for _ in range(round(GAIN_TIME_S / period_s)):
            now = ramp.ramped(now, target)
        np.testing.assert_allclose(now["force"], 1.0 - np.exp(-1.0))
        assert ramp.part == pytest.approx(1.0 - np.exp(-period_s / GAIN_TIME_S))
    assert GAIN_TIME_S == 0.15


def test_only_the_sources_that_are_named_get_there_at_once():
    now = {"force": np.ones(6), "joystick": np.ones(6)}
    target = {"force": np.zeros(6), "joystick": np.zeros(6)}
    found = Gains((), 0.01).ramped(now, target, ("force",))
    np.testing.assert_array_equal(found["force"], np.zeros(6))
    assert 0.9 < found["joystick"].min() < 1.0
    assert found is not target
    assert Gains((), 0.01).ramped(now, target, ("force", "joystick")) is target
