import numpy as np
import pinocchio as pin
import pytest
from telerobot.config.schema.sources import PositionSection
from telerobot.server.control.inputs import PathGoal
from telerobot.server.control.spatial import Pose, rotate_twist, rotation_exp, rotation_log
from telerobot.server.control.task.position import Position, PositionState
from telerobot.server.control.task.source import Granted

from .shown import SHAPING, A, T, shown
from .shown import granted as let_through

V, W = 0.2, 0.6
SPEED = np.array([V] * 3 + [W] * 3)
PATHS = PositionSection(speed=V, angular_speed=W)
GAIN, WORLD = np.full(6, 2.0), np.eye(3)


class Tool:
    """A tool that moves exactly as it is told, and what it was told."""

    def __init__(self, T_world_mrf):
        self.pose, self.source, self.state = T_world_mrf, Position(PATHS, SHAPING), PositionState()
        self.twist = np.zeros(6)
        self.twists, self.poses = [], [self.pose]

    def go(self, seconds, goal, granted=1.0, gain=GAIN, axes=WORLD, factor=1.0, push=None):
        for _ in range(round(seconds / T)):
            context = shown(
                goal=goal,
                T_world_mrf=self.pose,
                T_world_crf=Pose(axes, np.zeros(3)),
                twist=self.twist,
                speed_factor=factor,
            )
            twist, self.state = self.source.rate(context, self.state, gain)
            self.state = self.source.advance(self.state, let_through(granted))
            self.twists.append(twist)
            self.twist = granted * twist + (0.0 if push is None else push)
            turn = rotation_exp(T * self.twist[3:])
            self.pose = Pose(turn @ self.pose.R, self.pose.p + T * self.twist[:3])
            self.poses.append(self.pose)
        return self


@pytest.fixture
def target(random_pose):
    return PathGoal(random_pose(0.4), 1)


@pytest.fixture
def tool(random_pose):
    return Tool(random_pose(0.4))


def distance(a, b):
    return np.linalg.norm(a.p - b.p), np.linalg.norm(rotation_log(a.R.T @ b.R))


def speeds(tool):
    twists = np.array(tool.twists)
    return np.linalg.norm(twists[:, :3], axis=1), np.linalg.norm(twists[:, 3:], axis=1)


def test_the_tool_gets_to_the_target_and_says_so(tool, target):
    tool.go(0.5, target)
    assert not tool.state.at_goal
    tool.go(14.0, target)
    np.testing.assert_allclose(distance(tool.pose, target.T_world_target), 0.0, atol=1e-6)
    assert tool.state.at_goal
    np.testing.assert_allclose(tool.twists[-1], 0.0, atol=1e-6)


def test_from_rest_the_way_is_straight_and_turns_about_one_axis(tool, target):
    start, end = tool.pose, target.T_world_target
    span, axis = end.p - start.p, rotation_log(start.R.T @ end.R)
    shares = []
    for _ in range(1200):
        pose, _ = tool.go(T, target).state.path.now()
        along = (pose.p - start.p) @ span / (span @ span)
        shares.append(along)
        np.testing.assert_allclose(pose.p, start.p + along * span, atol=1e-9)
        turned = rotation_log(start.R.T @ pose.R)
        np.testing.assert_allclose(np.cross(turned, axis / np.linalg.norm(axis)), 0.0, atol=1e-7)
        assert np.linalg.norm(tool.pose.p - pose.p) < 3e-3
    assert (np.diff(shares) >= -1e-12).all()
    assert shares[-1] == pytest.approx(1.0)


def test_the_paths_twist_is_the_derivative_of_its_pose(tool, target):
    tool.go(0.3, target)
    for _ in range(20):
        path = tool.go(0.05, target).state.path
        _, twist = path.now()
        h = 1e-5
        ahead, behind = (
            type(path)(path.goal, path.profile.advanced(step)).now()[0] for step in (h, -h)
        )
        np.testing.assert_allclose((ahead.p - behind.p) / (2 * h), twist[:3], atol=1e-6)
        found = pin.log3(ahead.R @ behind.R.T) / (2 * h)
        np.testing.assert_allclose(found, twist[3:], atol=1e-6)


def test_speed_and_acceleration_stay_inside_the_cells(tool, target):
    tool.go(14.0, target)
    v, w = speeds(tool)
    assert v.max() <= 1.05 * V
    assert w.max() <= 1.05 * W
    change = np.abs(np.diff(np.array(tool.twists), axis=0)) / T
    assert (change <= 1.1 * A).all()


def test_a_goals_own_speed_and_the_speed_factor_slow_the_path(tool, target):
    slow = PathGoal(target.T_world_target, 1, speed=0.05)
    assert speeds(tool.go(6.0, slow))[0].max() == pytest.approx(0.05, rel=0.1)
    reduced = Tool(tool.poses[0]).go(6.0, target, factor=0.1)
    assert speeds(reduced)[0].max() <= 0.1 * V * 1.05
    assert speeds(reduced)[1].max() <= 0.1 * W * 1.05


def test_the_path_waits_for_a_tool_that_is_held_and_goes_on_with_it(tool, target):
    tool.go(0.6, target)
    waiting = tool.state.path.profile.elapsed_s
    tool.go(2.0, target, granted=0.0)
    assert tool.state.path.profile.elapsed_s == waiting
    tool.go(14.0, target)
    np.testing.assert_allclose(distance(tool.pose, target.T_world_target), 0.0, atol=1e-6)
    # Held or not, it came along the same line.
    start, end = tool.poses[0].p, target.T_world_target.p
    direction = (end - start) / np.linalg.norm(end - start)
    for pose in tool.poses:
        assert np.linalg.norm(np.cross(pose.p - start, direction)) < 3e-3


def test_releasing_the_stick_still_reaches_the_target(tool, target):
    tool.go(0.5, target)
    tool.go(1.0, target, push=np.array([0.1, -0.1, 0.2, 0.0, 0.4, 0.0]))
    assert distance(tool.pose, tool.state.path.now()[0])[0] > 0.05
    tool.go(14.0, target)
    assert tool.state.at_goal
    np.testing.assert_allclose(distance(tool.pose, target.T_world_target), 0.0, atol=1e-6)


def test_at_the_target_a_push_is_undone_no_faster_than_the_path(tool, target):
    tool.go(14.0, target)
    tool.go(1.0, target, push=np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0]))
    tool.twists.clear()
    tool.go(8.0, target)
    assert speeds(tool)[0].max() == pytest.approx(V, rel=1e-6)
    np.testing.assert_allclose(distance(tool.pose, target.T_world_target), 0.0, atol=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_a_new_target_in_full_motion_is_taken_up_without_a_jump(seed, random_pose):
    rng = np.random.default_rng(seed)
    first, second = PathGoal(random_pose(0.4), 1), PathGoal(random_pose(0.4), 2)
    tool = Tool(random_pose(0.4)).go(rng.uniform(0.3, 1.5), first).go(14.0, second)
    change = np.abs(np.diff(np.array(tool.twists), axis=0))
    # The rotation vector's rates are bounded; the turning rate's bound follows to a factor.
    assert (change[:, :3] <= 1.3 * A[:3] * T).all()
    assert (change[:, 3:] <= 2.0 * A[3:] * T).all()
    assert tool.state.at_goal


def test_the_same_goal_said_again_does_not_start_the_path_anew(tool, target):
    tool.go(0.6, target)
    elapsed = tool.state.path.profile.elapsed_s
    tool.go(T, PathGoal(target.T_world_target, target.serial))
    assert tool.state.path.profile.elapsed_s == pytest.approx(elapsed + T)


def test_an_axis_of_gain_zero_is_left_alone(tool, target, random_pose):
    axes = random_pose().R
    gain = np.array([2.0, 0.0, 2.0, 2.0, 2.0, 0.0])
    tool.go(2.0, target, gain=gain, axes=axes)
    own = np.array([rotate_twist(axes.T, twist) for twist in tool.twists])
    np.testing.assert_allclose(own[:, [1, 5]], 0.0, atol=1e-15)
    assert (np.abs(own[:, [0, 2, 3, 4]]).max(axis=0) > 0.01).all()


def test_without_a_goal_nothing_is_asked_for_and_nothing_remembered(tool, target):
    tool.go(0.5, target)
    tool.go(T, None)
    assert not tool.twists[-1].any()
    assert tool.state == PositionState()


def test_half_a_turn_is_no_trouble():
    tool = Tool(Pose.identity())
    goal = PathGoal(Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3)), 1)
    tool.go(12.0, goal)
    assert tool.state.at_goal


@pytest.mark.parametrize(("scale", "slid"), [(0.8, False), (0.5, True)])
def test_along_a_verified_stop_nothing_of_what_was_asked_for_is_granted(scale, slid):
    """What a barrier turned off its path is told all the same."""
    here = Pose.identity()
    goes = Granted.of(scale, 0.8, SPEED, here, stopped=False)
    assert (goes.share, goes.pace, goes.slid) == (scale, 0.8, slid)
    stops = Granted.of(scale, 0.8, SPEED, here, stopped=True)
    assert (stops.share, stops.pace, stops.slid) == (0.0, 0.0, slid)
