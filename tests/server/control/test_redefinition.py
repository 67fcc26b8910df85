"""A new MRF or CRF is the same motion of the tool, whatever asks for it; judged at the Wrist."""

import numpy as np
import pytest
from telerobot.server.control.inputs import (
    PathGoal,
    Pursuit,
    Route,
    TwistRoute,
    TwistSegment,
    ViewGoal,
)
from telerobot.server.control.scene import Body, Moved
from telerobot.server.control.spatial import Pose, pose_error, rotation_rpy, sizes

ONCE, OFTEN = [60], list(range(60, 140, 3))
TICKS = 180
TURNED = Pose(rotation_rpy(0.0, 0.0, np.pi / 2), np.zeros(3))
SHIFTED = Pose(rotation_rpy(0.3, 1.2, -0.4), np.array([0.15, -0.08, 0.3]))
LENS = Pose(rotation_rpy(0.1, -0.2, 1.5), np.array([-0.07, 0.02, 0.03]))
OFF = dict.fromkeys(("joystick", "position", "vision", "force", "following"), np.zeros(6))
GAINS = {
    "joystick": np.ones(6),
    "position": np.repeat([2.0, 1.5], 3),
    "vision": np.ones(6),
    "force": np.repeat([7e-4, 0.03], 3),
    "following": np.repeat([1.0, 0.0], 3),
}


def away(T, xyz, rpy):
    return Pose(rotation_rpy(*rpy) @ T.R, T.p + np.array(xyz))


def asked(run, stick, which, tick):
    """Return inputs for a tick by which the sources named move the tool, from tick 20 on."""
    begin = run.begin
    given = {"T_wrist_goal": run.arm.settings.T_wrist_mrf}
    if tick < 20:
        return given
    if "joystick" in which:
        given["stick"] = stick(*((0.02, 0.05, -0.03) if tick < 110 else (0, 0, 0)), 0, 0, 0)
    if "position" in which:
        given["goal"] = PathGoal(away(begin, (0.05, -0.04, 0.06), (0.2, 0.15, -0.3)), 1)
    if "route" in which:
        legs = (
            PathGoal(away(begin, (0.03, 0.0, 0.02), (0.1, 0.1, 0.0)), 1),
            PathGoal(away(begin, (0.0, -0.04, 0.02), (0.0, 0.2, 0.1)), 1),
        )
        given["goal"] = Route(legs, 1, 0.01)
    if "twists" in which:
        given["goal"] = TwistRoute((TwistSegment(np.array([0.03, 0, 0.02, 0.1, 0.2, 0]), 1.0),), 1)
    if "vision" in which:
        lens = begin @ run.arm.settings.T_wrist_mrf.inverse() @ LENS
        given["view"] = ViewGoal(LENS, away(lens, (0.02, 0.03, 0.01), (0.05, -0.1, 0.1)))
    if "following" in which and tick < 120:
        given["wrench_sensor"] = run.weight + np.array([-3.0, 4.0, 2.0, 0.1, 0.0, 0.0])
    return given


def played(arm, start, stick, which, at=(), frame="mrf", other=SHIFTED):
    """Return the Wrist's pose in every tick; at some ticks a frame is redefined to and fro."""
    run = start(arm)
    gains = {name: GAINS[name] if name in which else OFF[name] for name in GAINS}
    if {"route", "twists"} & set(which):
        gains["position"] = GAINS["position"]
    run.set(gains=gains)
    run.begin = run.pose
    run.weight = arm.control.arms[0].weight(run.pose, run.settings)
    mrf, poses, redefined = run.settings.T_wrist_mrf, [], 0
    for tick in range(TICKS):
        if tick in at:
            redefined += 1
            to = other if redefined % 2 else Pose.identity()
            new = {"T_wrist_mrf": mrf @ to} if frame == "mrf" else {"T_world_crf": to}
            run.set(redefined=redefined, **new)
        given = asked(run, stick, which, tick)
        run.tick(**{"wrench_sensor": run.weight, **given})
        poses.append(arm.mechanism.pose_wrist(run.memory.commanded.motion.q))
    run.observe()
    return poses


def apart(one, other):
    """Return the greatest distance [m] and angle [rad] between two runs."""
    errors = [sizes(pose_error(a, b)) for a, b in zip(one, other, strict=True)]
    return tuple(np.max(errors, axis=0))


SOURCES = ("joystick", "position", "route", "twists", "vision", "following")
TOGETHER = ("joystick", "position", "vision", "following")


@pytest.mark.parametrize("which", [(s,) for s in SOURCES], ids="+".join)
def test_a_new_mrf_leaves_the_motion_of_each_source_as_it_is(pa10, start, stick, which):
    undisturbed = played(pa10, start, stick, which)
    assert apart([undisturbed[0]] * TICKS, undisturbed)[0] > 0.02
    for at, other in ((ONCE, TURNED), (OFTEN, SHIFTED)):
        far, turned = apart(undisturbed, played(pa10, start, stick, which, at, other=other))
        assert far < 5e-5
        assert turned < 2e-4


@pytest.mark.parametrize("at", [ONCE, OFTEN], ids=["once", "33 a second"])
def test_a_new_mrf_leaves_the_motion_of_all_sources_as_it_is(arm, start, stick, at):
    undisturbed = played(arm, start, stick, TOGETHER)
    far, turned = apart(undisturbed, played(arm, start, stick, TOGETHER, at))
    assert far < 5e-5
    assert turned < 2e-4


@pytest.mark.parametrize("which", [TOGETHER, ("force", *TOGETHER)], ids=["all", "force"])
def test_a_new_crf_leaves_the_tools_motion_as_it_is(pa10, start, stick, which):
    undisturbed = played(pa10, start, stick, which)
    assert apart(undisturbed, played(pa10, start, stick, which, OFTEN, "crf")) < (1e-12, 1e-12)


@pytest.mark.parametrize("at", [ONCE, OFTEN], ids=["once", "33 a second"])
def test_at_rest_a_new_mrf_moves_nothing_with_every_source_on(arm, start, stick, at):
    run = start(arm)
    run.set(gains=GAINS)
    weight = arm.control.arms[0].weight(run.pose, run.settings)
    before, redefined = arm.mechanism.pose_wrist(run.memory.commanded.motion.q), 0
    lens = run.pose @ run.settings.T_wrist_mrf.inverse() @ LENS
    given = {
        "goal": PathGoal(run.pose, 1),
        "T_wrist_goal": run.settings.T_wrist_mrf,
        "view": ViewGoal(LENS, lens),
        "stick": stick(0, 0, 0, 0, 0, 0),
        "wrench_sensor": weight,
    }
    for tick in range(TICKS):
        if tick in at:
            redefined += 1
            other = (TURNED, SHIFTED)[redefined % 2]
            mrf = arm.settings.T_wrist_mrf @ other
            run.set(redefined=redefined, T_wrist_mrf=mrf, T_world_crf=other)
        run.tick(**given)
        assert np.abs(run.outputs[-1].twists["frames"]).max() < 1e-9
    after = arm.mechanism.pose_wrist(run.memory.commanded.motion.q)
    assert max(sizes(pose_error(before, after))) < 1e-6


def test_a_turning_stick_turns_the_tool_about_the_new_point_without_a_jump(arm, start, stick):
    run = start(arm)
    run.set(gains={**OFF, "joystick": np.ones(6)})
    turn = stick(0.0, 0.0, 0.0, 0.0, 0.0, 0.3)
    run.go(0.6, stick=turn)
    before = run.memory.commanded.motion.dq
    new = run.settings.T_wrist_mrf @ Pose(np.eye(3), np.array([0.2, 0.0, 0.0]))
    run.set(T_wrist_mrf=new, redefined=1)
    output = run.tick(stick=turn)
    np.testing.assert_allclose(output.dq, before, atol=0.04)
    run.go(0.6, stick=turn)
    there = run.pose.p
    run.go(0.3, stick=turn)
    assert np.linalg.norm(run.pose.p - there) < 2e-4
    run.observe()


def test_a_master_leads_the_new_mrf_from_where_the_old_one_was_led(arm, start):
    """The reference it steers keeps its pace as the rigid body; there is no second approach."""
    poses = []
    for redefined in (0, 1):
        run = start(arm)
        run.set(gains={**OFF, "position": GAINS["position"]})
        begin, mrf = run.pose, run.settings.T_wrist_mrf
        to, found = Pose.identity(), []
        for tick in range(TICKS):
            if tick == 60 and redefined:
                to = SHIFTED
                run.set(T_wrist_mrf=mrf @ to, redefined=1)
            target = away(begin, 0.0005 * min(tick, 120) * np.array([1.0, -1.0, 0.5]), (0, 0, 0))
            goal = Pursuit(target @ to, 1)
            run.tick(goal=goal, T_wrist_goal=run.settings.T_wrist_mrf)
            found.append(arm.mechanism.pose_wrist(run.memory.commanded.motion.q))
        run.observe()
        poses.append(found)
    far, turned = apart(*poses)
    assert far < 5e-5
    assert turned < 2e-4


def test_accommodation_about_a_new_point_begins_without_a_jump_and_a_balanced_load_stays(
    arm, start
):
    run = start(arm)
    run.set(gains={**OFF, "force": np.array([7e-4, 5e-4, 1e-3, 0.03, 0.02, 0.01])})
    weight = arm.control.arms[0].weight(run.pose, run.settings)
    pressed = weight + np.array([20.0, -12.0, 8.0, 0.4, 0.2, -0.3])
    for _ in range(50):
        output = run.tick(wrench_sensor=pressed)
    before = output.twist
    lever = run.pose.R @ SHIFTED.p
    run.set(T_wrist_mrf=run.settings.T_wrist_mrf @ SHIFTED, redefined=1)
    output = run.tick(wrench_sensor=pressed)
    expected = before.copy()
    expected[:3] += np.cross(before[3:], lever)
    np.testing.assert_allclose(output.twist, expected, atol=2e-3)
    # A load that is wanted as it is asks for nothing, at whatever point it is told.
    balanced = run.tick(wrench_sensor=pressed, wrench_desired=output.wrench)
    np.testing.assert_allclose(balanced.twists["force"], 0.0, atol=1e-3)
    run.observe()


def test_grounds_that_change_to_and_fro_wind_nothing_up(arm, start, stick):
    """Between a Carrier that moves and World; afterwards the arm is at rest as soon as ever."""
    run = start(arm)
    run.set(gains={**OFF, "joystick": np.ones(6)})
    base = Body.standing(arm.mechanism.T_world_base)
    carrier = Body(Pose.identity(), np.array([0.2, 0.1, 0.0, 0.0, 0.0, 0.2]))
    moved = Moved(base, carrier, base.T)
    for tick in range(120):
        ground = "carrier" if tick // 3 % 2 else "world"
        run.set(redefined=tick // 3)
        output = run.tick(moved=moved, ground=ground)
        assert sizes(output.twists["frames"]) <= (0.6, 1.8)
    for _ in range(60):
        output = run.tick(moved=Moved(base, Body.standing(carrier.T), base.T), ground="world")
    assert not output.twists["frames"].any()
    run.observe()
