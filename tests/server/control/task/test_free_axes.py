"""A task whose axes are left free while it runs: goals, speed bounds, what barriers spare."""

from dataclasses import replace

import numpy as np
import pytest
from telerobot.config.schema.null_space import OBJECTIVES
from telerobot.config.schema.sources import PositionSection
from telerobot.server.control.arm import Arm as ArmControl
from telerobot.server.control.axes import FREE_TIME_S, HeldAxes, holding
from telerobot.server.control.bodies.rates import ArmTick
from telerobot.server.control.inputs import Inputs, Intent, ObjectiveGains, PathGoal
from telerobot.server.control.spatial import Pose, rotation_exp
from telerobot.server.control.stop.limiter import Commanded
from telerobot.server.control.task.position import Position
from telerobot.server.control.tick import Control

from .shown import SHAPING, shown


def goal_of(run, shift=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)):
    """Return a goal away from the tool, in its own axes."""
    T = run.pose
    return PathGoal(T @ Pose(rotation_exp(np.array(turn)), np.array(shift)), 1)


def pulls(run, towards=None, **gains):
    """Return the gains of the objectives, zero for all that are not named."""
    none = dict.fromkeys(OBJECTIVES, 0.0)
    return ObjectiveGains({**none, **gains}, run.q if towards is None else towards)


def off(run, T, axis=2):
    """Return how far the tool is from a pose: its place, and one of its axes [rad]."""
    now = run.pose
    return np.linalg.norm(now.p - T.p), np.arccos(min(1.0, now.R[:, axis] @ T.R[:, axis]))


def test_a_goal_is_reached_when_the_axes_that_are_held_are_there(pa10, start):
    run = start(pa10)
    run.set(held=holding(("rz",)), objectives=pulls(run))
    goal = goal_of(run, (0.05, -0.03, 0.02), (0.1, 0.15, 1.2))
    output = run.go(6.0, goal=goal)
    assert output.at_goal
    place, tilt = off(run, goal.T_world_target)
    assert place < 5e-4
    assert tilt < 1e-3
    # About its own z it went where the joints went: not to the goal, and not nowhere.
    spun = (run.pose.R.T @ goal.T_world_target.R)[1, 0]
    assert abs(spun) > 0.3
    run.set(held=None)
    assert not run.go(0.05, goal=goal).at_goal
    assert run.go(6.0, goal=goal).at_goal
    assert off(run, goal.T_world_target, 0)[1] < 1e-3
    run.observe()


@pytest.mark.parametrize("about", [0.5, 3.1, -3.1])
def test_a_tool_that_tilts_is_led_back_the_shortest_way_however_far_it_has_spun(about):
    """Nearly half a turn about z: the logarithm of all of it would hardly tell the tilt."""
    source = Position(PositionSection(), SHAPING)
    target, tilt = Pose.identity(), np.array([0.02, -0.01, 0.0])
    goal, gain = PathGoal(target, 1), np.full(6, 2.0)
    state = source.rate(shown(goal=goal, T_world_mrf=target), source.idle(), gain)[1]
    R = rotation_exp(-tilt) @ rotation_exp(np.array([0.0, 0.0, about]))
    context = shown(goal=goal, T_world_mrf=Pose(R, np.zeros(3)), T_world_wrist=Pose(R, np.zeros(3)))
    held = HeldAxes.of(holding(("rz",)), R, (5, 5))
    rate, _ = source.rate(context._replace(held=held), state, gain)
    np.testing.assert_allclose(rate, [0.0, 0.0, 0.0, *(2.0 * tilt)], atol=1e-9)


def test_position_control_asks_nothing_along_a_free_axis(pa10, start):
    run = start(pa10)
    run.set(held=holding(("x", "rz")))
    goal = goal_of(run, (0.1, 0.05, 0.0), (0.0, 0.2, 0.5))
    for _ in range(50):
        k = pa10.mechanism.kinematics(run.memory.commanded.motion.q, run.settings.T_wrist_mrf)
        output, R = run.tick(goal=goal), k.T_world_mrf.R
        asked = np.concatenate(
            [
                R.T @ output.twists["position"][:3],
                R.T @ output.twists["position"][3:],
            ]
        )
        assert np.abs(asked[[0, 5]]).max() < 1e-12
    assert np.abs(asked[[1, 4]]).max() > 1e-3


def test_what_is_asked_along_a_free_axis_takes_no_part_of_the_tools_speed(pa10):
    """Thrice the tool's greatest speed along x, and slowly along z, with x free."""
    arm, q, most = pa10.control.arms[0], pa10.posture("ready"), pa10.p.limits.speed
    k = pa10.mechanism.kinematics(q, pa10.settings.T_wrist_mrf)
    held = HeldAxes.of(holding(("x",)), k.T_world_mrf.R, (5, 5))
    along = np.concatenate([k.T_world_mrf.R @ np.array([3.0 * most, 0.0, 0.05]), np.zeros(3)])
    inputs = Inputs(0.0, Intent.MOVE, q, pa10.settings, at_posture=True)
    told = Commanded.at_rest(q)
    tick = ArmTick(
        inputs, k, k.T_world_wrist, np.zeros(7), told, held=held, settled=True,
        twists={"joystick": along},
    )  # fmt: skip
    tick.objectives = arm.redundancy.objectives
    found = arm.resolved(tick)
    assert found.scale == 1.0
    assert found.limits == ()
    for twist in (found.twist, held.part(k.J @ found.dq_asked)):
        np.testing.assert_allclose(k.T_world_mrf.R.T @ twist[:3], [0.0, 0.0, 0.05], atol=1e-9)


def test_self_motion_takes_the_tool_along_a_free_axis_no_faster_than_it_may_go(pa10, start):
    p = replace(pa10.p, limits=pa10.p.limits.model_copy(update={"speed": 0.1}))
    run = start(replace(pa10, p=p, control=Control([ArmControl(p, pa10.mechanism)])))
    away = run.q + np.array([0.0, 0.6, 0.0, -1.0, 0.0, 0.6, 0.0])
    run.set(held=holding(("x", "y", "z")), objectives=pulls(run, away, posture=10.0))
    before, bounded, speeds = run.pose.p, False, []
    for _ in range(150):
        output = run.tick()
        speeds.append(np.linalg.norm(run.pose.p - before) / p.period_s)
        before, bounded = run.pose.p, bounded or "tool_speed" in output.limits
    assert bounded
    assert 0.09 < max(speeds) < 0.102


def test_axes_are_let_go_and_held_again_without_a_jump_of_joint_rates(pa10, start, stick):
    """Under a stick and a strong pull: joint rates change as little as joints may accelerate."""
    run = start(pa10)
    away = run.q + np.array([0.3, 0.2, -0.4, 0.3, 0.5, -0.3, 0.8])
    run.set(objectives=pulls(run, away, posture=1.0), gains=pa10.gains(joystick=1.0))
    push = stick(0.0, 0.05, 0.02, 0.0, 0.1, 0.0)
    asked = []
    for held in (None, holding(("rx", "rz")), holding(("y",)), None):
        run.set(held=held)
        for _ in range(80):
            output = run.tick(stick=push)
            asked.append(output.found.self_motion.dq)
        assert (output.task.held is None) if held is None else output.task.held is held
    steps = np.abs(np.diff(np.array(asked), axis=0))[1:].max()
    assert steps < 0.12 * np.abs(asked).max()
    run.observe()


def test_axes_are_let_go_at_once_where_nothing_moves(pa10, start):
    run = start(pa10)
    run.set(held=holding(("rz",)))
    assert run.tick(intent=Intent.HOLD).task.held[5] == 0.0
    run.set(held=None)
    output = run.tick()
    assert output.task.held[5] == pytest.approx(pa10.p.period_s / FREE_TIME_S)


def test_the_axes_of_another_mrf_are_that_frames_own(pa10, start, stick):
    run = start(pa10)
    turned = Pose(rotation_exp(np.array([0.0, 0.5 * np.pi, 0.0])), np.zeros(3))
    there = run.settings.T_wrist_mrf @ turned
    objectives = pulls(run)
    run.set(held=holding(("z",)), T_wrist_mrf=there, objectives=objectives)
    along = run.pose.R[:, 2]
    output = run.go(0.3, stick=stick(*(0.05 * along), 0.0, 0.0, 0.0))
    np.testing.assert_allclose(output.twist, 0.0, atol=1e-12)


def test_the_place_of_another_mrf_stands_while_the_tool_turns_about_it(pa10, start):
    run = start(pa10)
    there = run.settings.T_wrist_mrf @ Pose(np.eye(3), np.array([0.2, 0.0, 0.1]))
    away = run.q + np.array([0.3, 0.2, -0.4, 0.3, 0.5, -0.3, 0.8])
    run.set(held=holding(("rx", "ry", "rz")), T_wrist_mrf=there)
    run.set(objectives=pulls(run, away, posture=1.0))
    before = run.pose
    run.go(1.0)
    assert np.linalg.norm(run.pose.p - before.p) < 1e-3
    assert np.abs(run.pose.R - before.R).max() > 0.1


def test_barriers_spare_the_path_of_what_is_held_alone(pa10):
    """Before the programme: of the tool's path there is left what the task holds of it."""
    arm, q = pa10.control.arms[0], pa10.posture("ready")
    told = pa10.control.seed(q)
    settings = replace(pa10.settings, held=holding(("y", "rx")))
    inputs = Inputs(0.0, Intent.MOVE, q, settings)
    tick = arm.solve(told.arms[0], told.commanded, inputs)
    arm.before_barriers(tick, True)
    k = tick.kinematics
    R = np.kron(np.eye(2), k.T_world_mrf.R)
    expected = R @ np.diag([1, 0, 1, 0, 1, 1]) @ R.T @ k.J
    np.testing.assert_allclose(tick.path, expected, atol=1e-12)
