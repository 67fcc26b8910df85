"""Routes, timed twists and moving targets, followed by a tool that moves as it is told."""

import numpy as np
import pytest
from telerobot.config.schema.sources import PositionSection
from telerobot.server.control.inputs import PathGoal, Pursuit, Route, TwistRoute, TwistSegment
from telerobot.server.control.spatial import Pose, pose_error, rotation_exp, rotation_log
from telerobot.server.control.task.position import Position, PositionState

from .shown import SHAPING, A, T, shown
from .shown import granted as let_through

V, W = 0.2, 0.6
SPEED = np.array([V] * 3 + [W] * 3)
PATHS = PositionSection(speed=V, angular_speed=W)
GAIN = np.full(6, 2.0)
PUSH = np.array([0.0, 0.0, 0.15, 0.0, 0.3, 0.0])
CORNERS = ((0.1, 0.0, 0.0), (0.1, 0.1, 0.0), (0.0, 0.1, 0.05))


class Tool:
    """A tool that moves exactly as it is told, pushed aside by a stick now and then."""

    def __init__(self, pose=None):
        self.pose = pose or Pose.identity()
        self.source, self.state = Position(PATHS, SHAPING), PositionState()
        self.twist = np.zeros(6)
        self.twists, self.poses, self.said = [self.twist], [self.pose], []

    def go(self, seconds, goal, granted=1.0, factor=1.0, paused=False, push=None):
        for _ in range(round(seconds / T)):
            context = shown(
                goal=goal,
                T_world_mrf=self.pose,
                twist=self.twist,
                speed_factor=factor,
                paused=paused,
            )
            twist, self.state = self.source.rate(context, self.state, GAIN)
            self.state = self.source.advance(self.state, let_through(granted))
            self.twists.append(twist)
            self.said.append(self.state.progress)
            self.twist = granted * twist + (0.0 if push is None else push)
            self.pose = Pose(
                rotation_exp(T * self.twist[3:]) @ self.pose.R, self.pose.p + T * self.twist[:3]
            )
            self.poses.append(self.pose)
        return self

    @property
    def points(self):
        return np.array([pose.p for pose in self.poses])


def route(blend=0.0, speed=None, serial=1, corners=CORNERS):
    legs = (PathGoal(Pose(np.eye(3), np.array(c)), serial, speed) for c in corners)
    return Route(tuple(legs), serial, blend)


def nearest(tool, corner):
    return np.linalg.norm(tool.points - np.array(corner), axis=1).min()


def smooth(tool, slack=1.3):
    """The twist never jumps: its steps are those of the bounded acceleration."""
    steps = np.abs(np.diff(np.array(tool.twists), axis=0))
    assert (steps <= slack * A * T + 1e-9).all()


# --- routes ---------------------------------------------------------------------------------------


def test_without_blending_the_tool_stands_on_every_waypoint():
    tool = Tool().go(8.0, route())
    for corner in CORNERS:
        assert nearest(tool, corner) < 5e-4
    speeds = np.linalg.norm(np.diff(tool.points, axis=0), axis=1) / T
    turns = np.flatnonzero(np.diff([said.leg for said in tool.said]))
    assert [bool(speeds[i - 10 : i + 10].min() < 0.01) for i in turns] == [True, True]
    assert tool.state.at_goal
    smooth(tool)


def test_with_blending_it_passes_near_them_without_stopping_and_sooner():
    stopping, passing = Tool().go(8.0, route()), Tool().go(8.0, route(blend=0.03))
    for corner in CORNERS[:-1]:
        assert 1e-3 < nearest(passing, corner) < 0.03
    until = next(i for i, said in enumerate(passing.said) if said.leg == 2)
    speeds = np.linalg.norm(np.diff(passing.points, axis=0), axis=1) / T
    assert speeds[30:until].min() > 0.04
    assert passing.state.at_goal

    def arrived(tool):
        away = np.linalg.norm(tool.points - np.array(CORNERS[-1]), axis=1)
        return int(np.argmax(away < 1e-3))

    assert arrived(passing) < arrived(stopping)
    smooth(passing)


def test_each_leg_has_a_speed_of_its_own():
    speeds = (0.05, 0.15, 0.1)
    legs = tuple(
        PathGoal(Pose(np.eye(3), np.array(c)), 1, s) for c, s in zip(CORNERS, speeds, strict=True)
    )
    tool = Tool().go(9.0, Route(legs, 1))
    moved = np.linalg.norm(np.array(tool.twists)[1:, :3], axis=1)
    for leg, speed in enumerate(speeds):
        during = [m for m, said in zip(moved, tool.said, strict=True) if said.leg == leg]
        assert max(during) == pytest.approx(speed, rel=0.1)


def test_progress_counts_legs_and_their_time():
    tool = Tool().go(8.0, route())
    legs = [said.leg for said in tool.said]
    assert sorted(set(legs)) == [0, 1, 2]
    assert (np.diff(legs) >= 0).all()
    whole = [said.leg + said.part for said in tool.said]
    assert (np.diff(whole) >= -1e-12).all()
    assert whole[-1] == 3.0
    assert {said.legs for said in tool.said} == {3}


def test_a_pause_holds_the_tool_and_resuming_goes_on_along_the_same_line():
    undisturbed = Tool().go(8.0, route())
    tool = Tool().go(0.5, route()).go(2.0, route(), paused=True)
    assert tool.said[-1].pace == 0.0
    np.testing.assert_allclose(tool.twists[-1], 0.0, atol=1e-3)
    assert not tool.state.at_goal
    tool.go(8.0, route())
    assert tool.state.at_goal
    for point in tool.points[::5]:
        assert np.linalg.norm(undisturbed.points - point, axis=1).min() < 4e-3
    smooth(tool)


def test_a_stick_shifts_a_paused_path_and_release_returns_to_it():
    tool = Tool().go(0.5, route()).go(1.5, route(), paused=True)
    at = tool.pose
    tool.go(0.5, route(), paused=True, push=PUSH)
    assert np.linalg.norm(tool.pose.p - at.p) > 0.03
    tool.go(6.0, route(), paused=True)
    np.testing.assert_allclose(pose_error(at, tool.pose), 0.0, atol=1e-3)


def test_a_stick_shifts_a_route_and_release_still_reaches_every_later_waypoint():
    tool = Tool().go(0.3, route()).go(0.6, route(), push=PUSH).go(9.0, route())
    assert nearest(tool, CORNERS[2]) < 5e-4
    assert tool.state.at_goal


def test_a_route_waits_for_a_tool_that_is_held():
    tool = Tool().go(0.5, route())
    said = tool.said[-1]
    tool.go(3.0, route(), granted=0.0)
    assert tool.said[-1] == said
    assert tool.go(8.0, route()).state.at_goal


@pytest.mark.parametrize("blend", [0.0, 0.03])
def test_no_leg_ends_while_a_barrier_has_the_tool_off_its_path(blend):
    aside, other = Tool().go(0.3, route(blend)), Tool().go(0.3, route(blend))
    for tool, slid in ((aside, True), (other, False)):
        for _ in range(300):  # the path goes on, the tool stands
            context = shown(goal=route(blend), T_world_mrf=tool.pose)
            _, tool.state = tool.source.rate(context, tool.state, GAIN)
            tool.state = tool.source.advance(tool.state, let_through(slid=slid))
    assert aside.state.leg == 0
    assert other.state.leg == 2
    aside.go(8.0, route(blend))
    assert nearest(aside, CORNERS[0]) < 5.1e-3 + blend
    assert aside.state.at_goal


@pytest.mark.parametrize("seed", range(6))
def test_another_route_in_full_motion_is_taken_up_without_a_jump(seed, random_pose):
    rng = np.random.default_rng(seed)
    other = route(0.02, None, 2, rng.uniform(-0.1, 0.1, (4, 3)))
    tool = Tool().go(rng.uniform(0.2, 2.0), route(blend=0.02)).go(10.0, other)
    assert tool.state.at_goal
    smooth(tool)


def test_taking_a_route_up_again_goes_on_with_its_leg():
    tool = Tool().go(1.0, route())
    assert tool.said[-1].leg == 1
    again = Route(route().legs, 1, attempt=1)
    tool.go(8.0, again)
    assert min(said.leg for said in tool.said[100:]) == 1
    assert tool.state.at_goal


# --- timed twists ---------------------------------------------------------------------------------


def twists(*segments, serial=1, moving_axes=False):
    made = tuple(TwistSegment(np.array(twist), duration) for twist, duration in segments)
    return TwistRoute(made, serial, moving_axes)


LINE = ((0.1, 0, 0, 0, 0, 0), 1.0), ((0, -0.05, 0, 0, 0, 0.2), 2.0)


@pytest.mark.parametrize("factor", [1.0, 0.4])
def test_twists_go_as_far_as_their_times_say_at_any_speed_factor(factor):
    goal = twists(*LINE)
    tool = Tool().go(4.0 / factor, goal, factor=factor)
    np.testing.assert_allclose(tool.pose.p, [0.1, -0.1, 0.0], atol=3e-3)
    np.testing.assert_allclose(rotation_log(tool.pose.R), [0.0, 0.0, 0.4], atol=6e-3)
    assert tool.state.at_goal
    assert tool.said[-1].leg + tool.said[-1].part == 2.0
    np.testing.assert_allclose(tool.twists[-1], 0.0, atol=1e-3)
    smooth(tool)


def test_in_moving_axes_a_turning_tool_runs_in_a_circle():
    radius, rate = 0.1, 0.5
    goal = twists(((radius * rate, 0, 0, 0, 0, rate), 2 * np.pi / rate), moving_axes=True)
    tool = Tool().go(2 * np.pi / rate + 1.0, goal)
    # To the left of where it starts, in the direction of its turn.
    centre = np.array([0.0, radius, 0.0])
    away = np.linalg.norm(tool.points - centre, axis=1)
    np.testing.assert_allclose(away, radius, atol=6e-3)
    np.testing.assert_allclose(tool.pose.p, 0.0, atol=6e-3)


def test_twists_pause_and_a_stick_shifts_them_and_they_end_where_they_would():
    goal = twists(*LINE)
    tool = Tool().go(0.6, goal).go(1.5, goal, paused=True)
    at = tool.pose
    np.testing.assert_allclose(tool.twists[-1], 0.0, atol=1e-3)
    tool.go(0.4, goal, paused=True, push=PUSH).go(5.0, goal, paused=True)
    np.testing.assert_allclose(pose_error(at, tool.pose), 0.0, atol=2e-3)
    tool.go(6.0, goal)
    np.testing.assert_allclose(tool.pose.p, [0.1, -0.1, 0.0], atol=5e-3)
    smooth(tool)


# --- a target that moves --------------------------------------------------------------------------


def test_a_target_that_jumps_is_pursued_without_one():
    tool = Tool()
    for i in range(4):
        target = Pose(rotation_exp(np.array([0.0, 0.1 * i, 0.0])), np.array([0.04 * i, 0.0, 0.0]))
        tool.go(0.3, Pursuit(target, 1))
    smooth(tool)
    tool.go(3.0, Pursuit(target, 1))
    np.testing.assert_allclose(pose_error(target, tool.pose), 0.0, atol=1e-4)


def test_a_target_at_a_steady_speed_is_followed_closely():
    tool, lag = Tool(), []
    for i in range(300):
        target = Pose(np.eye(3), np.array([0.1 * T * i, 0.0, 0.0]))
        tool.go(T, Pursuit(target, 1))
        lag.append(target.p[0] - tool.pose.p[0])
    assert max(lag) < 0.02
    speeds = np.array(tool.twists)[150:, 0]
    np.testing.assert_allclose(speeds, 0.1, atol=0.02)
    smooth(tool)


def test_without_a_target_the_reference_comes_to_rest_and_stays():
    tool = Tool()
    for i in range(100):
        tool.go(T, Pursuit(Pose(np.eye(3), np.array([0.15 * T * i, 0.0, 0.0])), 1))
    tool.go(1.0, Pursuit(None, 1))
    at = tool.pose
    tool.go(2.0, Pursuit(None, 1))
    np.testing.assert_allclose(pose_error(at, tool.pose), 0.0, atol=2e-3)
    np.testing.assert_allclose(tool.twists[-1], 0.0, atol=1e-3)
    smooth(tool)


def test_a_pursuit_keeps_the_paths_speed():
    far = Pose(np.eye(3), np.array([0.3, -0.3, 0.1]))
    tool = Tool().go(5.0, Pursuit(far, 1))
    v = np.linalg.norm(np.array(tool.twists)[:, :3], axis=1)
    assert v.max() <= 1.25 * V
    assert v.max() > 0.7 * V
    np.testing.assert_allclose(pose_error(far, tool.pose), 0.0, atol=1e-4)


@pytest.mark.parametrize("far", [0.3, 100.0])
def test_a_path_at_next_to_no_speed_is_planned_all_the_same(far):
    """It would take months: planning works in hours."""
    goal = PathGoal(
        Pose(rotation_exp(np.array([0.0, 0.0, 3.0])), np.array([far, 0.0, 0.0])), 1, 1e-4
    )
    tool = Tool().go(2.0, goal, factor=0.01)
    smooth(tool)
    assert 0.0 < tool.points[-1, 0] <= far * 2.0 / 4000.0
