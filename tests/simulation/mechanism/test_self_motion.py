"""Self-motion by hand: the arm angle is told, and moved while the tool stays."""

import math

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.spatial import Pose, pose_error

TOOL_M, TOOL_RAD = 1.5e-3, 1.5e-3
"""The tool stays within this while the elbow turns by more than a radian."""
ASIDE = [0.0, 0.6, 0.4, 1.3, 0.2, 0.9, 0.0]
"""A posture of the PA-10 away from singularities [rad]."""


def turn(at_s, rate, for_s, **more):
    return {"at_s": at_s, "cmd/self_motion": {"rate": rate, **more}, "for_s": for_s}


def posture(at_s, q=ASIDE):
    return {"at_s": at_s, "cmd/posture": {"q": q}}


def between(run, from_s, to_s):
    start = run.simulation.player.start_s
    return [s for s in run.states if from_s <= s.time_s - start - 1e-9 <= to_s]


def farthest(poses):
    """How far poses of six numbers are from the first one, [m] and [rad]."""
    first, *others = (Pose.from_xyz_rpy(p[:3], p[3:]) for p in poses)
    errors = [pose_error(first, other) for other in others]
    return (
        max(np.linalg.norm(e[:3]) for e in errors),
        max(np.linalg.norm(e[3:]) for e in errors),
    )


def angle_of(q):
    """φ of a PA-10, by the elbow's and the wrist's place (numpy alone)."""

    def about(axis, angle):
        c, s = math.cos(angle), math.sin(angle)
        return np.array(
            [[c, -s, 0], [s, c, 0], [0, 0, 1]]
            if axis == "z"
            else [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        )

    R = about("z", q[0]) @ about("y", q[1]) @ about("z", q[2])
    E = R @ [0.0, 0.0, 0.45]
    W = E + R @ about("y", q[3]) @ [0.0, 0.0, 0.5]
    w = W / np.linalg.norm(W)
    p, V = E - w * (w @ E), np.array([0.0, 0.0, 1.0])
    return math.atan2(w @ np.cross(V, p), V @ p)


@pytest.fixture(scope="module")
def turned(simulated):
    """The elbow of a PA-10 is turned to one side and to the other, the tool stands."""
    return simulated(posture(0.1), turn(4.5, 0.5, 2.4), turn(7.2, -0.5, 3.5), seconds=12.5)


@pytest.fixture(scope="module")
def simulated():
    from telerobot.tools.scripts.script import Script
    from telerobot.tools.simulation.simulation import Simulation

    from ..conftest import Run

    def run(*steps, seconds, cell=None):
        script = Script.model_validate({"duration_s": seconds, "step": list(steps)})
        simulation = Simulation(cell or load_cell("pa10"), script)
        return Run(simulation, simulation.run())

    return run


def test_the_elbow_turns_over_more_than_a_radian_while_the_tool_stays(turned):
    assert turned.summary["failure"] is None
    assert turned.summary["refused"] == []
    states = between(turned, 4.4, 12.4)
    angles = np.array([angle_of(s.q) for s in states])  # by the measured joints
    assert angles.max() - angles[0] > 1.0
    assert angles.max() - angles.min() > 1.4
    off, off_rad = farthest([s.pose_mrf_measured for s in states])
    assert off < TOOL_M
    assert off_rad < TOOL_RAD
    start = turned.simulation.player.start_s
    true = [t.pose_mrf for t in turned.truths if 4.4 <= t.time_s - start <= 12.4]
    assert len(true) > 600
    off, off_rad = farthest(true)
    assert off < TOOL_M
    assert off_rad < TOOL_RAD


def test_it_turns_at_the_rate_that_is_asked_for_and_is_told_as_it_is(turned):
    for state in turned.states[::25]:
        assert state.arm_angle == pytest.approx(angle_of(state.q_command), abs=6e-3)
    for from_s, rate in ((5.3, 0.5), (8.2, -0.5)):
        a, b = turned.at(from_s), turned.at(from_s + 0.8)
        found = (angle_of(b.q_command) - angle_of(a.q_command)) / (b.time_s - a.time_s)
        assert found == pytest.approx(rate, rel=0.01)
    # released, it stays where it was put: no objective pulls it back
    assert turned.at(12.4).arm_angle == pytest.approx(turned.at(11.9).arm_angle, abs=1e-4)
    assert turned.at(4.4).arm_angle == pytest.approx(angle_of(ASIDE), abs=2e-3)


def test_a_stream_that_falls_silent_fades_and_is_told(play):
    step = {"at_s": 0.3, "cmd/self_motion": {"rate": 0.3}}
    run = play(step, {"at_s": 1.2, "link": {"cut": True}}, seconds=1.9)
    assert [e.detail for e in run.events("stream_expired")] == ["self_motion"]
    assert np.abs(run.at(1.15).dq_command).max() > 0.05
    speeds = [np.abs(s.dq_command).max() for s in between(run, 1.2, 1.85)]
    assert speeds[-1] < 1e-3


def test_an_angle_is_gone_to_by_its_shorter_way_reached_told_and_kept(play):
    to = {"at_s": 4.5, "cmd/arm_angle": {"angle": -0.6, "speed": 0.4}}
    stick = {"at_s": 9.0, "cmd/joystick": {"twist": [0, 0, 0.05, 0, 0, 0]}, "for_s": 1.0}
    run = play(posture(0.1), to, stick, seconds=10.6)
    assert run.summary["refused"] == []
    (told,) = run.events("arm_angle_reached")
    assert told.detail == "-0.600 rad"
    assert run.at(8.9).arm_angle == pytest.approx(-0.6, abs=1e-3)
    assert farthest([s.pose_mrf_measured for s in between(run, 4.4, 8.9)])[0] < TOOL_M
    speeds = np.diff([s.arm_angle for s in between(run, 4.5, 8.9)]) / 0.01
    assert np.abs(speeds).max() < 0.4 * 1.02
    # and kept while the tool goes on
    kept = [s.arm_angle for s in between(run, 9.0, 10.5)]
    assert np.abs(np.array(kept) + 0.6).max() < 5e-3
    assert run.at(10.5).pose_mrf[2] - run.at(8.9).pose_mrf[2] > 0.04


def test_an_angle_behind_a_joints_limit_is_named_unreachable_with_what_stops_it(play):
    cell = load_cell("pa10")
    mechanism = Mechanism.from_cell(cell)
    run = play(posture(0.1), {"at_s": 4.5, "cmd/arm_angle": {"angle": 2.6}}, seconds=12.0)
    (told,) = run.events("arm_angle_unreachable")
    assert told.detail.startswith("2.600 rad: it stands at ")
    assert "joint_limit" in told.detail
    assert run.states[-1].arm_angle_target is None
    q = np.array(run.states[-1].q_command)
    joints = cell.robot.joints
    assert all(j.lower <= x <= j.upper for j, x in zip(joints, q, strict=True))
    assert mechanism.n == len(q)
    assert farthest([s.pose_mrf for s in between(run, 4.5, 11.9)])[0] < TOOL_M


@pytest.mark.parametrize(
    ("cell", "changes", "message", "reason"),
    [
        ("ur5e", {}, {"cmd/self_motion": {"rate": 0.1}}, "no_spare_joint"),
        ("ur5e", {}, {"cmd/arm_angle": {"angle": 0.1}}, "no_spare_joint"),
        (
            "planar3",
            {"resolve.free_axes": []},
            {"cmd/self_motion": {"rate": 0.1}},
            "no_spare_joint",
        ),
        ("planar3", {}, {"cmd/arm_angle": {"angle": 0.1}}, "unknown_mechanism"),
        ("pa10", {}, {"cmd/self_motion": {"rate": 0.6}}, "at most 0.5 either way"),
        ("snake", {}, {"cmd/self_motion": {"rate": 0.1}}, "no_spare_joint"),
    ],
)
def test_what_cannot_be_is_refused_by_name(play, cell, changes, message, reason):
    run = play({"at_s": 0.2, **message}, seconds=0.3, cell=altered(load_cell(cell), changes))
    told = run.events("command_refused")
    assert told
    assert any(reason in f"{e.detail} {e.values}" for e in told)


def test_the_spare_motion_of_an_arm_without_an_elbow_on_a_circle_leaves_its_tool(play):
    cell = altered(load_cell("planar3"), {"redundancy.field": 0.0})
    run = play(turn(0.3, 0.8, 1.5), turn(2.2, -0.8, 1.5), seconds=4.2, cell=cell)
    assert run.summary["refused"] == []
    states = between(run, 0.2, 4.1)
    assert farthest([[*s.pose_mrf[:3], 0, 0, 0] for s in states])[0] < TOOL_M
    q = np.array([s.q_command for s in states])
    assert q[:, 1].max() - q[0, 1] > 0.1  # the middle joint turns on first
    assert q[-1] == pytest.approx(q[0], abs=0.05)  # and the same way back


@pytest.mark.parametrize(("mechanism", "own"), [("left", slice(0, 7)), ("right", slice(7, 14))])
def test_one_of_two_arms_turns_its_elbow_and_the_other_stands(play, mechanism, own):
    run = play(turn(0.3, 0.4, 1.5, mechanism=mechanism), seconds=2.0, cell=load_cell("pa10_two"))
    assert run.summary["mode"] == "enabled"
    assert run.summary["refused"] == []
    q = np.array([s.q_command for s in between(run, 0.2, 1.9)])
    way = np.abs(q[-1] - q[0])
    assert way[own].max() > 0.2
    # The other gives way to the noise of its sensor, and to nothing else.
    assert np.delete(way, own).max() < 5e-4


def test_an_obstacle_beside_the_elbow_comes_first(play):
    """Without it the elbow would go through."""
    ball = {"name": "ball", "shape": "sphere", "xyz": [0.16, -0.42, 0.5], "radius": 0.05}
    cell = altered(load_cell("pa10_scene"), {"obstacles": [ball]})
    run = play(turn(0.3, 0.5, 4.0), seconds=5.0, cell=cell)
    assert run.summary["failure"] is None
    states = between(run, 0.2, 4.9)
    assert any(name.startswith("clearance") for s in states for name in s.limits)
    assert min(t.clearance_m for t in run.truths) > 0.015
    assert farthest([s.pose_mrf for s in states])[0] < TOOL_M


@pytest.mark.parametrize("cell", ["ur5e", "planar3", "snake"])
def test_an_arm_without_an_elbow_on_a_circle_tells_no_angle(play, cell):
    assert play(seconds=0.05, cell=load_cell(cell)).states[-1].arm_angle is None


def test_each_arm_tells_its_own_angle_and_a_payload_in_their_hands_none(play):
    state = play(seconds=0.05, cell=load_cell("pa10_pair")).states[-1]
    assert state.arm_angle is not None
    other, beam = (name for name in state.tasks)
    assert state.tasks[other].arm_angle is not None
    assert state.tasks[beam].arm_angle is None
    assert math.isfinite(state.arm_angle)
