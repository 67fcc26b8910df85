"""Paths, clutch and objectives at the desk: what is taken, refused, told, and what ends them."""

import numpy as np
import pytest
from telerobot.protocols.messages import messages as m
from telerobot.protocols.messages.messages import (
    ClutchRequest,
    MasterPose,
    PathMotion,
    PathRequest,
    RedundancyRequest,
)
from telerobot.protocols.messages.perception import FrameRequest
from telerobot.server.commands.commands import Commands
from telerobot.server.control.inputs import Pursuit, Route, TwistRoute
from telerobot.server.control.scene import Mount
from telerobot.server.control.spatial import Pose, rotation_rpy
from telerobot.server.refusals import Refused, Why

ENVELOPE = {"seen_tick": 1}
MRF = Pose.from_xyz_rpy((0.7, 0.1, 0.4), (0.2, -0.5, 1.1))
WAYPOINTS = ((0.1, -0.2, 0.3, 0.3, 0.2, -0.4), (0.0, 0.1, 0.0, 0.0, 0.0, 0.5))
TWIST = (0.1, 0.2, 0.0, 0.0, 0.0, 0.3)


@pytest.fixture
def commands(pa10):
    commands = Commands.from_cell(pa10.cell)
    commands.frames.lens = lambda: Mount("wrist", MRF)
    # With force control off, the MRF may be anywhere on a tool.
    commands.settings.switch("force", False)
    return commands


def take(commands, kind, now_s=0.0, T=MRF, **fields):
    commands.take(kind(**ENVELOPE, **fields), now_s, T)
    return commands.goals.goal


def lead(commands, now_s=0.0, xyz=(0.0, 0.0, 0.0), T=MRF):
    return take(commands, MasterPose, now_s, T, xyz=xyz, rpy=(0.0, 0.0, 0.0))


def path(commands, action):
    commands.goals.control_path(PathRequest(**ENVELOPE, action=action))


def clutch(commands, **fields):
    commands.set_clutch(ClutchRequest(**ENVELOPE, **fields))


@pytest.mark.parametrize("relative_to", m.Frame)
@pytest.mark.parametrize("expressed_in", [None, *m.Frame])
def test_every_waypoint_is_placed_as_a_target_is(commands, relative_to, expressed_in):
    frames = {"relative_to": relative_to, "expressed_in": expressed_in}
    goal = take(commands, PathMotion, waypoints=WAYPOINTS, speeds=(0.1, 0.2), **frames)
    assert isinstance(goal, Route)
    assert [leg.speed for leg in goal.legs] == [0.1, 0.2]
    for leg, waypoint in zip(goal.legs, WAYPOINTS, strict=True):
        alone = take(commands, m.PositionTarget, xyz=waypoint[:3], rpy=waypoint[3:], **frames)
        np.testing.assert_allclose(leg.T_world_target.p, alone.T_world_target.p, atol=1e-12)
        np.testing.assert_allclose(leg.T_world_target.R, alone.T_world_target.R, atol=1e-12)


def test_twists_are_turned_into_world_or_left_to_the_moving_tool(commands):
    given = {"twists": (TWIST,), "durations_s": (2.0,)}
    commands.frames.crf = Mount("world", Pose(rotation_rpy(0.0, 0.0, np.pi / 2), np.ones(3)))
    fixed = take(commands, PathMotion, **given)
    assert isinstance(fixed, TwistRoute)
    np.testing.assert_allclose(fixed.segments[0].twist, [-0.2, 0.1, 0, 0, 0, 0.3], atol=1e-12)
    moving = take(commands, PathMotion, **given, expressed_in=m.Frame.MRF)
    assert moving.moving_axes
    np.testing.assert_array_equal(moving.segments[0].twist, TWIST)


def test_pause_resume_and_abort_need_a_path(commands):
    for action in ("pause", "resume", "abort"):
        with pytest.raises(Refused) as caught:
            path(commands, action)
        assert caught.value.reason == Why.NOT_NOW
    take(commands, PathMotion, waypoints=WAYPOINTS)
    path(commands, "pause")
    assert commands.goals.paused
    path(commands, "resume")
    assert not commands.goals.paused
    path(commands, "abort")
    assert commands.goals.goal is None


def test_a_new_path_is_not_paused(commands):
    take(commands, PathMotion, waypoints=WAYPOINTS)
    path(commands, "pause")
    take(commands, PathMotion, waypoints=WAYPOINTS)
    assert not commands.goals.paused


def test_taking_up_again_keeps_the_goal(commands):
    before = take(commands, PathMotion, waypoints=WAYPOINTS)
    commands.goals.restart_path()
    assert commands.goals.goal.serial == before.serial
    assert commands.goals.goal.attempt == before.attempt + 1


def test_a_master_leads_once_engaged_and_stands_when_it_is_not(commands):
    assert lead(commands) is None
    clutch(commands, engaged=True)
    goal = lead(commands)
    assert isinstance(goal, Pursuit)
    np.testing.assert_allclose(goal.T_world_target.p, MRF.p)
    moved = lead(commands, 0.01, (0.01, 0.0, 0.0))
    assert moved.serial == goal.serial
    np.testing.assert_allclose(moved.T_world_target.p - MRF.p, [0.01, 0.0, 0.0], atol=1e-12)
    clutch(commands, engaged=False)
    assert commands.goals.goal.T_world_target is None
    assert commands.goals.goal.serial == goal.serial


def test_a_masters_silence_is_told_once_and_stops_its_lead(commands):
    clutch(commands, engaged=True)
    lead(commands)
    assert commands.expired(0.1) == []
    assert commands.expired(0.2) == ["master_pose"]
    assert commands.goals.goal.T_world_target is None
    assert commands.expired(0.3) == []


@pytest.mark.parametrize("what", ["target", "path", "posture", "cancel", "clear"])
def test_another_goal_ends_the_masters_lead_until_it_is_engaged_anew(commands, what):
    clutch(commands, engaged=True)
    lead(commands)
    match what:
        case "target":
            take(commands, m.PositionTarget, xyz=(0, 0, 0), rpy=(0, 0, 0))
        case "path":
            take(commands, PathMotion, waypoints=WAYPOINTS)
        case "posture":
            take(commands, m.PostureMove, posture="ready")
        case "cancel":
            take(commands, m.CancelGoals)
        case "clear":
            commands.clear()
    before = commands.goals.goal
    assert lead(commands, 0.01, (0.01, 0, 0)) is before
    assert not isinstance(before, Pursuit)
    clutch(commands, engaged=True)
    lead(commands, 0.02, (0.02, 0, 0))
    np.testing.assert_allclose(commands.goals.goal.T_world_target.p, MRF.p)


def test_a_master_leads_on_when_the_mrf_is_another_and_turns_the_tool_about_the_new_one(commands):
    clutch(commands, engaged=True)
    lead(commands)
    led = lead(commands, 0.01, (0.01, 0.0, 0.0)).T_world_target
    old = commands.frames.T_wrist_mrf
    commands.set_frame(FrameRequest(**ENVELOPE, frame="mrf", xyz=(0, 0.2, 0.1)), MRF)
    there = old.inverse() @ commands.frames.T_wrist_mrf
    assert commands.goals.T_wrist_goal is commands.frames.T_wrist_mrf
    np.testing.assert_allclose(commands.goals.goal.T_world_target.p, (led @ there).p, atol=1e-12)
    turn = {"xyz": (0.01, 0.0, 0.0), "rpy": (0.0, 0.0, 0.01)}
    turned = take(commands, MasterPose, 0.02, MRF @ there, **turn).T_world_target
    np.testing.assert_allclose(turned.p, (led @ there).p, atol=1e-12)


def test_a_stick_goes_through_the_clutch(commands):
    take(commands, m.JoystickTwist, twist=TWIST)
    clutch(commands, translation=0.5, rotation=2.0)
    np.testing.assert_allclose(
        commands.in_force(0.0, lambda: MRF).stick.twist, [0.05, 0.1, 0, 0, 0, 0.6]
    )
    clutch(commands, engaged=False)
    assert commands.in_force(0.0, lambda: MRF).stick is None


def test_objectives_are_set_one_by_one_and_an_unknown_posture_is_refused(commands, pa10):
    def ask(**fields):
        commands.settings.set_objective(RedundancyRequest(**ENVELOPE, **fields))

    ask(objective="posture", gain=2.0, posture="park")
    ask(objective="mid_range", gain=0.0)
    objectives = commands.settings.for_control().objectives
    assert objectives.gains["posture"] == 2.0
    assert objectives.gains["mid_range"] == 0.0
    np.testing.assert_array_equal(objectives.posture, pa10.posture("park"))
    with pytest.raises(Refused) as caught:
        ask(objective="posture", gain=1.0, posture="bed")
    assert caught.value.reason == Why.UNKNOWN_POSTURE
    assert commands.settings.for_control().objectives is objectives
