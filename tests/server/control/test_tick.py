import pickle
from dataclasses import replace

import numpy as np
import pytest
from telerobot.config.schema.sources import SOURCES
from telerobot.server.control.arm import Arm as ArmControl
from telerobot.server.control.inputs import Inputs, Intent, PathGoal, ViewGoal
from telerobot.server.control.spatial import Pose, rotation_rpy
from telerobot.server.control.tick import Control

FORWARD = (0.1, 0.0, 0.0, 0.0, 0.0, 0.0)


def goal(pose, xyz=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0), serial=1):
    """A target that is so far from a pose, in World axes."""
    return PathGoal(Pose(rotation_rpy(*rpy) @ pose.R, pose.p + np.array(xyz)), serial)


def view(run, xyz, rpy):
    """A desired view that would have the Wrist so far from where it is, in World axes."""
    wrist = run.pose @ run.settings.T_wrist_mrf.inverse()
    turned = Pose(rotation_rpy(*rpy) @ wrist.R, wrist.p + np.array(xyz))
    return ViewGoal(Pose.identity(), turned)


def everything_at_once(run, stick):
    """Inputs of a tick with every source busy."""
    return {
        "stick": stick(0.02, -0.03, 0.01, 0.1, 0.0, -0.1),
        "goal": goal(run.pose, (-0.05, 0.05, 0.05), (0.1, 0.2, 0.0)),
        "view": view(run, (0.03, -0.04, 0.02), (0.0, 0.1, 0.1)),
        "wrench_sensor": np.array([3.0, -2.0, 12.0, 0.1, 0.2, -0.1]),
        "wrench_desired": np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0]),
    }


# --- the sum --------------------------------------------------------------------------------------


def test_the_twist_is_the_sum_of_every_sources(run, stick):
    inputs = everything_at_once(run, stick)
    for _ in range(100):
        output = run.tick(**inputs)
        assert set(output.twists) == {*SOURCES, "frames"}
        total = sum(output.twists.values())
        np.testing.assert_allclose(output.twist, total, rtol=0, atol=1e-16)
    assert not output.twists.pop("frames").any()  # nothing moves, nothing was redefined
    busy = {"joystick", "position", "vision", "force"}
    for off in set(SOURCES) - busy:
        assert not output.twists.pop(off).any()
    assert all(np.linalg.norm(twist) > 1e-3 for twist in output.twists.values())


def test_the_tool_moves_as_the_sum_says(run, stick):
    inputs = everything_at_once(run, stick)
    run.go(0.6, **inputs)
    J = run.arm.mechanism.kinematics(run.memory.commanded.motion.q, run.settings.T_wrist_mrf).J
    output = run.tick(**inputs)
    np.testing.assert_allclose(J @ output.dq, output.twist, atol=5e-3)
    run.observe()


def test_a_source_whose_gains_are_zero_adds_nothing(run, stick):
    run.set(gains=run.arm.gains(position=0.0, force=0.0))
    output = run.go(0.3, **everything_at_once(run, stick))
    assert output.twists["joystick"].any()
    assert not output.twists["position"].any()
    assert not output.twists["force"].any()


def test_a_person_nudges_an_automatic_motion_which_still_reaches_its_target(run, stick):
    target = goal(run.pose, (-0.1, 0.1, 0.05))
    run.go(0.3, goal=target)
    run.go(0.5, goal=target, stick=stick(0.0, 0.0, 0.15, 0.0, 0.0, 0.0))
    output = run.go(6.0, goal=target)
    assert output.at_goal
    np.testing.assert_allclose(run.pose.p, target.T_world_target.p, atol=1e-3)
    run.observe()


# --- purity ---------------------------------------------------------------------------------------


def bits(output):
    return output.q.tobytes(), output.dq.tobytes(), output.twist.tobytes(), output.limits


def test_the_same_inputs_give_the_same_bits_whatever_was_computed_in_between(run, stick, rng):
    inputs = everything_at_once(run, stick)
    run.go(0.2, **inputs)
    memory, control = run.memory, run.arm.control
    kept = pickle.dumps((memory.commanded, memory.arms[0].wrist))
    given = Inputs(0.0, Intent.MOVE, memory.commanded.sent[1], run.settings, **inputs)
    first_memory, (first,) = control.tick(memory, (given,))
    other = control.seed(run.arm.random_posture(rng))
    for factor in (0.3, 1.0):
        settings = replace(run.settings, speed_factor=factor)
        other, _ = control.tick(other, (replace(given, settings=settings),))
    again_memory, (again,) = control.tick(memory, (given,))
    _, (fresh,) = Control([ArmControl(run.arm.p, run.arm.mechanism)]).tick(memory, (given,))
    assert bits(first) == bits(again) == bits(fresh)
    assert pickle.dumps(first_memory.commanded) == pickle.dumps(again_memory.commanded)
    # Nor was anything that went in written to.
    assert pickle.dumps((memory.commanded, memory.arms[0].wrist)) == kept


# --- changes while running ------------------------------------------------------------------------


@pytest.mark.parametrize("source", ["joystick", "position", "force"])
def test_a_source_is_switched_off_and_on_in_full_motion_without_a_jump(run, stick, source):
    inputs = everything_at_once(run, stick)
    run.go(0.5, **inputs)
    before = run.outputs[-1].twists[source]
    run.set(gains=run.arm.gains(**{source: 0.0}))
    after = run.tick(**inputs).twists[source]
    assert np.linalg.norm(after - before) < 0.15 * np.linalg.norm(before)
    run.go(3.0, **inputs)
    np.testing.assert_allclose(run.outputs[-1].twists[source], 0.0, atol=1e-5)
    run.set(gains=run.arm.gains())
    run.go(1.0, **inputs)
    run.observe()


def test_gains_frames_and_speed_change_in_full_motion_without_a_jump(run, stick, rng):
    inputs = everything_at_once(run, stick)
    for _ in range(12):
        run.set(
            gains=run.arm.gains(joystick=rng.uniform(0, 1), position=rng.uniform(0, 4, 6)),
            T_wrist_mrf=Pose(rotation_rpy(*rng.uniform(-1, 1, 3)), rng.uniform(-0.1, 0.2, 3)),
            T_world_crf=Pose(rotation_rpy(*rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 3)),
            speed_factor=rng.choice([0.1, 0.5, 1.0]),
        )
        run.go(0.2, **inputs)
    run.observe()


@pytest.mark.parametrize("factor", [0.05, 0.25])
def test_the_speed_factor_slows_joints_and_tool_alike(run, stick, factor):
    fast = stick(-1.0, 0.5, 0.0, 0.0, 0.0, 0.5)
    run.set(speed_factor=factor)
    for _ in range(100):
        output = run.tick(stick=fast)
        J = run.arm.mechanism.kinematics(output.q, run.settings.T_wrist_mrf).J
        assert (np.abs(output.dq) <= factor * run.arm.p.joints.velocity * 1.0001).all()
        assert np.linalg.norm((J @ output.dq)[:3]) <= factor * run.arm.p.limits.speed * 1.02
    assert np.linalg.norm((J @ output.dq)[:3]) > 0.5 * factor * run.arm.p.limits.speed
    run.observe()


@pytest.mark.parametrize("factor", [0.1, 0.5])
def test_the_speed_factor_softens_acceleration_too(run, factor):
    run.set(speed_factor=factor)
    for rates in (
        run.arm.p.joints.velocity,
        -run.arm.p.joints.velocity,
        0 * run.arm.p.joints.velocity,
    ):
        run.go(0.4, jog=rates)
    accelerations = np.abs(np.diff(run.sent, 2, axis=0)) / run.arm.p.period_s**2
    assert (accelerations <= factor * run.arm.p.joints.acceleration * (1 + 1e-6) + 1e-6).all()
    assert (accelerations.max(axis=0) > 0.5 * factor * run.arm.p.joints.acceleration).any()


def test_the_tool_keeps_its_speed_bounds_whatever_is_asked(run, stick):
    limits = run.arm.p.limits
    for twist in ((3.0, 2.0, 0, 0, 0, 0), (0, 0, 0, 4.0, 4.0, 0), (-3.0, 0, 0, 0, 5.0, 0)):
        output = run.go(0.4, stick=stick(*twist))
        assert "tool_speed" in output.limits
        for output in run.outputs[-40:]:
            granted = output.granted * output.twist
            assert np.linalg.norm(granted[:3]) <= limits.speed * (1 + 1e-9)
            assert np.linalg.norm(granted[3:]) <= limits.angular_speed * (1 + 1e-9)
        run.go(0.5)
    run.observe()


# --- what each intent means -----------------------------------------------------------------------


def test_seeding_puts_the_command_where_the_joints_are(run, stick):
    run.go(0.3, stick=stick(*FORWARD))
    measured = run.q + 0.01
    output = run.tick(intent=Intent.SEED, q_measured=measured, stick=stick(*FORWARD))
    np.testing.assert_array_equal(output.q, measured)
    assert output.at_rest
    assert output.refusal is None
    assert not run.memory.arms[0].task.states["joystick"].motion.dq.any()


def test_a_drive_that_is_already_on_keeps_its_command_while_the_others_follow_their_joints(run):
    energised = np.arange(run.arm.p.n) % 2 == 0
    measured = run.q + 0.003
    output = run.tick(intent=Intent.SEED, q_measured=measured, energised=energised)
    np.testing.assert_array_equal(output.q, np.where(energised, run.q, measured))


def test_stop_runs_out_along_the_verified_stop_and_then_is_at_rest(run, stick):
    run.go(0.5, stick=stick(-0.3, 0.1, 0.0, 0.0, 0.0, 0.3))
    stop = run.memory.commanded.stop
    assert stop.to_go_s > 0.05
    for i in range(1, 200):
        output = run.tick(intent=Intent.STOP, stick=stick(*FORWARD))
        if output.at_rest:
            break
        np.testing.assert_allclose(output.q, stop.at(i * run.arm.p.period_s).q, atol=1e-12)
    assert output.at_rest
    assert i * run.arm.p.period_s <= stop.to_go_s + run.arm.p.period_s
    run.observe()


def test_hold_stands_whatever_is_asked(run, stick):
    inputs = everything_at_once(run, stick) | {"wrench_sensor": None}
    run.go(0.3, **inputs)
    run.go(1.0, intent=Intent.STOP)
    at = run.sent[-1]
    output = run.go(0.5, intent=Intent.HOLD, **inputs)
    np.testing.assert_array_equal(output.q, at)
    assert output.at_rest
    assert not output.twist.any()


def test_going_on_after_hold_begins_from_rest_where_the_arm_was_held(run, stick):
    target = goal(run.pose, (-0.1, 0.05, 0.05))
    run.go(0.4, goal=target)
    run.go(1.0, intent=Intent.STOP)
    run.go(0.5, intent=Intent.HOLD)
    output = run.go(5.0, goal=target)
    assert output.at_goal
    run.observe()


# --- postures and joints --------------------------------------------------------------------------


def test_a_posture_is_reached_by_all_joints_and_reported(arm, start, rng):
    ready = arm.posture("ready")
    run, posture = start(arm), ready + rng.uniform(-0.3, 0.3, arm.p.n)
    assert not run.tick(posture=posture).at_goal
    output = run.go(6.0, posture=posture)
    assert output.at_goal
    np.testing.assert_allclose(output.q, posture, atol=3e-4)
    run.observe()


def test_a_posture_is_approached_along_a_straight_line_of_joints(arm, start):
    run = start(arm)
    way = np.array([0.3, 0.2, -0.2, 0.25, 0.1, -0.3, 0.2])[: arm.p.n]
    for _ in range(400):
        moved = run.tick(posture=run.q + way).q - run.q
        aside = moved - (moved @ way) / (way @ way) * way
        assert np.linalg.norm(aside) < 0.05 * np.linalg.norm(way)


def test_a_posture_is_the_way_out_of_full_stretch(arm, start):
    """Every joint at zero is singular in either arm."""
    run = start(arm, np.clip(np.zeros(arm.p.n), arm.p.joints.lower, arm.p.joints.upper))
    output = run.go(8.0, posture=arm.posture("ready"))
    assert output.at_goal
    run.observe()


def test_a_jog_moves_its_joint_alone(arm, start):
    for joint in range(arm.p.n):
        run, rates = start(arm), np.zeros(arm.p.n)
        rates[joint] = -0.2
        output = run.go(0.4, jog=rates)
        np.testing.assert_array_equal(np.delete(output.q, joint), np.delete(run.q, joint))
        assert output.q[joint] < run.q[joint] - 0.04
        assert output.dq[joint] == pytest.approx(-0.2, rel=1e-6)
        run.observe()


def test_a_joint_at_full_speed_is_not_said_to_be_at_its_leash(arm, start, rng):
    """The joint speed is the only bound here, and rounding of it is no other."""
    limits = arm.p.limits.model_copy(update={"speed": 10.0, "angular_speed": 20.0})
    run = start(
        replace(arm, control=Control([ArmControl(replace(arm.p, limits=limits), arm.mechanism)]))
    )
    for _ in range(200):
        output = run.tick(jog=rng.uniform(-3, 3, run.arm.p.n) * run.arm.p.joints.velocity)
        assert [name for name in output.limits if name.startswith("leash")] == []


def test_a_jog_stops_at_the_joints_limit(arm, start):
    run = start(arm)
    for joint in (2, 3):
        rates = np.zeros(arm.p.n)
        rates[joint] = 0.9 * arm.p.joints.velocity[joint]
        output = run.go(8.0, jog=rates)
        if arm.p.joints.upper[joint] < 3.0:
            assert output.q[joint] == pytest.approx(arm.p.joints.upper[joint], abs=2e-3)
            assert f"joint_limit:{arm.p.joints.names[joint]}" in output.limits
    run.observe()


# --- the leash ------------------------------------------------------------------------------------


def behind(run, joint, error):
    """Where the joints are when one of them hangs behind its command."""
    lag = np.zeros(run.arm.p.n)
    lag[joint] = error
    return run.memory.commanded.sent[1] - lag


@pytest.mark.parametrize("joint", [0, 3])
def test_at_the_end_of_its_leash_a_command_goes_no_further_and_may_come_back(run, joint):
    rates = np.zeros(run.arm.p.n)
    rates[joint] = 0.2
    leash = run.arm.p.joints.leash[joint]
    run.go(0.4, jog=rates)
    for _ in range(40):
        output = run.tick(jog=rates, q_measured=behind(run, joint, leash))
    assert abs(output.dq[joint]) < 1e-9
    assert f"leash:{run.arm.p.joints.names[joint]}" in output.limits
    for _ in range(40):
        output = run.tick(jog=-rates, q_measured=behind(run, joint, leash))
    assert output.dq[joint] == pytest.approx(-0.2, rel=1e-6)
    assert output.error[joint] == pytest.approx(leash)
    run.observe()


def test_near_its_leash_a_command_slows(run):
    rates = np.zeros(run.arm.p.n)
    rates[0] = 0.9 * run.arm.p.joints.velocity[0]
    for _ in range(100):
        output = run.tick(jog=rates, q_measured=behind(run, 0, 0.75 * run.arm.p.joints.leash[0]))
    assert output.dq[0] == pytest.approx(0.5 * run.arm.p.joints.velocity[0], rel=1e-3)
