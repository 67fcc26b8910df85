"""An axis of the tool that looks at a point: where it turns to in closed form, and what is free."""

import numpy as np
import pytest
from telerobot.config.schema.sources import PointAtSection
from telerobot.server.control.scene import Body, Moved
from telerobot.server.control.spatial import Pose, rotation_exp
from telerobot.server.control.task.source import About, Redefined
from telerobot.server.control.task.sources import PointAt

from .shown import SHAPING, A, J, T, shown

POINT = np.array([0.4, -0.1, 0.3])
AXIS = np.array([1.0, 2.0, -2.0]) / 3.0
GAIN = np.array([0.0, 0.0, 0.0, 1.5, 1.5, 1.5])


def looking(**section):
    given = {"point": tuple(POINT), "tool_axis": tuple(AXIS), "angular_speed": 10.0}
    return PointAt(PointAtSection(**{**given, **section}), SHAPING)


def settled(source, pose, gain=GAIN, **said):
    """Return what the source asks for once its shaping is through."""
    state = source.idle()
    for _ in range(300):
        rate, state = source.rate(shown(T_world_mrf=pose, **said), state, gain)
    return rate


def sight(pose, point=POINT):
    way = point - pose.p
    return way / np.linalg.norm(way)


def test_the_axis_is_turned_to_the_point_by_the_shortest_arc_and_the_tool_stays(random_pose):
    for _ in range(20):
        pose = random_pose(1.0)
        rate = settled(looking(), pose)
        assert not rate[:3].any()
        turn = rate[3:] / 1.5
        np.testing.assert_allclose(rotation_exp(turn) @ pose.R @ AXIS, sight(pose), atol=1e-8)
        assert np.linalg.norm(turn) == pytest.approx(
            np.arccos(np.clip(sight(pose) @ pose.R @ AXIS, -1.0, 1.0)), abs=1e-8
        )


def test_how_the_tool_turns_about_its_line_of_sight_is_left_to_others(random_pose):
    pose = random_pose(1.0)
    assert abs(settled(looking(), pose)[3:] @ pose.R @ AXIS) < 1e-9


def aimed(p):
    """Return a pose at p whose axis looks at the point."""
    return Pose(turned_to(sight(Pose(np.eye(3), p))), p)


def turned_to(way):
    """Return axes (3, 3) in which AXIS leads along a unit vector."""
    across = np.cross(AXIS, way)
    sine = np.linalg.norm(across)
    return rotation_exp(across / sine * np.arctan2(sine, AXIS @ way))


def test_a_tool_that_goes_past_turns_as_fast_as_its_line_of_sight(rng):
    h = 1e-6
    for _ in range(10):
        p, v = POINT + rng.normal(size=3), 0.2 * rng.normal(size=3)
        twist = np.concatenate([v, rng.normal(size=3)])
        rate = settled(looking(), aimed(p), twist=twist)
        ahead, behind = (sight(Pose(np.eye(3), p + s * h * v)) for s in (1.0, -1.0))
        turning = np.cross(sight(aimed(p)), (ahead - behind) / (2.0 * h))
        np.testing.assert_allclose(rate[3:], turning, atol=1e-6)


def test_what_is_fed_forward_fades_with_the_gain():
    pose, twist = aimed(POINT + np.array([0.0, 1.0, 0.3])), np.array([0.2, 0.0, 0.0, 0, 0, 0])
    sizes = [
        np.linalg.norm(settled(looking(), pose, gain * np.sign(GAIN), twist=twist))
        for gain in (2.0, 0.5, 0.25, 1e-6)
    ]
    np.testing.assert_allclose(np.array(sizes) / sizes[0], [1.0, 1.0, 0.5, 2e-6], rtol=1e-3)


def test_a_point_on_a_carrier_is_followed_as_it_moves(random_pose, rng):
    carrier = Body(random_pose(0.3), 0.1 * rng.normal(size=6))
    moved = Moved(Body.standing(Pose.identity()), carrier, Pose.identity())
    p, h = np.array([1.5, 0.3, -0.8]), 1e-6
    point = carrier.T.p + carrier.T.R @ POINT
    pose = Pose(turned_to((point - p) / np.linalg.norm(point - p)), p)
    velocity = carrier.twist_at(point)[:3]
    rate = settled(looking(relative_to="carrier"), pose, moved=moved)
    ahead, behind = (sight(pose, point + s * h * velocity) for s in (1.0, -1.0))
    turning = np.cross(sight(pose, point), (ahead - behind) / (2.0 * h))
    np.testing.assert_allclose(rate[3:], turning, atol=1e-6)


def test_what_the_ground_turns_by_is_not_asked_for_twice():
    p = POINT + np.array([0.0, 1.0, 0.0])
    base = Body(Pose.identity(), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.4]))
    moved = Moved(base, Body.standing(Pose.identity()), Pose.identity())
    # A tool that stands still in World: seen from Base that is how World goes.
    still = moved.carries("world", p)
    found = settled(looking(), aimed(p), moved=moved, carried=still, twist=still)
    np.testing.assert_allclose(found[3:], 0.0, atol=1e-9)


def test_near_the_point_it_lets_go():
    away = np.array([1.0, 0.0, 0.0])
    sizes = [
        np.linalg.norm(settled(looking(nearest=0.2), Pose(np.eye(3), POINT + d * away)))
        for d in (0.5, 0.2, 0.15, 0.1, 1e-9, 0.0)
    ]
    np.testing.assert_allclose(np.array(sizes) / sizes[0], [1.0, 1.0, 0.5, 0.0, 0.0, 0.0])


def test_it_turns_no_faster_than_its_speed_and_reduced_speed_slows_it(random_pose):
    pose = random_pose(1.0)
    source = looking(angular_speed=0.1)
    assert np.linalg.norm(settled(source, pose)) == pytest.approx(0.1)
    assert np.linalg.norm(settled(source, pose, speed_factor=0.2)) == pytest.approx(0.02)


def test_a_tool_that_looks_the_other_way_is_turned_around():
    pose = Pose(np.eye(3), POINT + AXIS)
    assert np.linalg.norm(settled(looking(), pose)[3:]) == pytest.approx(1.5 * np.pi, rel=1e-6)


def test_about_an_axis_without_gain_it_asks_for_nothing(random_pose):
    rate = settled(looking(), random_pose(1.0), GAIN * [0, 0, 0, 1, 0, 1], twist=np.ones(6))
    assert rate[4] == 0.0
    assert rate[3] != 0.0 != rate[5]


def test_however_the_point_jumps_its_rate_is_inside_the_shaping(rng):
    source, rates = looking(relative_to="carrier"), [np.zeros(6)] * 2
    state = source.idle()
    for _ in range(20):
        carrier = Body.standing(Pose(np.eye(3), rng.uniform(-0.3, 0.3, 3)))
        moved = Moved(Body.standing(Pose.identity()), carrier, Pose.identity())
        for _ in range(rng.integers(1, 30)):
            rate, state = source.rate(shown(moved=moved), state, GAIN)
            rates.append(rate)
    assert (np.abs(np.diff(rates, axis=0)) <= A * T * (1 + 1e-6)).all()
    assert (np.abs(np.diff(rates, 2, axis=0)) <= J * T**2 * (1 + 1e-6)).all()


def test_the_same_turn_about_a_new_mrf_is_owed_as_what_the_tool_did_before(random_pose, rng):
    """Turning goes on about another point: the body's motion before, told there, less that now."""
    source, lever = looking(), np.array([0.1, -0.2, 0.05])
    twist = np.concatenate([np.zeros(3), rng.normal(size=3)])
    about = About(Pose.identity(), Pose.identity(), None, "world", np.eye(3), 0, {})
    owed = source.jump(
        shown(), Redefined(about, lever, lever, False, True), source.idle(), GAIN, twist
    )
    np.testing.assert_allclose(owed, [*np.cross(twist[3:], lever), 0.0, 0.0, 0.0])
    same = Redefined(about, None, np.zeros(3), False, True)
    assert source.jump(shown(), same, source.idle(), GAIN, twist) is None
