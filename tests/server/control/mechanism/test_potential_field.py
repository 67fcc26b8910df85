"""The potential field on a whole arm: its slope, and what follows it in the tick."""

import dataclasses

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.null_space import PotentialFieldSection, VirtualLinkSection
from telerobot.config.schema.surroundings import ObstacleSection
from telerobot.server.control.arm import Arm as ArmControl
from telerobot.server.control.inputs import (
    ObjectiveGains,
    PathGoal,
    Settings,
    StickCommand,
    VirtualLinks,
)
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.mechanism.potentials import ahead, shape
from telerobot.server.control.mechanism.redundancy import Field
from telerobot.server.control.parameters import Parameters
from telerobot.server.control.proximity.capsules import Capsules
from telerobot.server.control.spatial import Pose, pose_error
from telerobot.server.control.task.position import PositionState
from telerobot.server.control.tick import Control
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap

from ...conftest import SOURCES, Arm

EVERY_KIND = (
    ObstacleSection(name="dot", shape="point", xyz=(0.3, 0.3, 0.6)),
    ObstacleSection(name="view", shape="sight_line", xyz=(0.0, -0.4, 1.0), to=(0.8, -0.2, 0.1)),
    ObstacleSection(name="ball", shape="sphere", xyz=(0.5, -0.4, 0.7), radius=0.1),
    ObstacleSection(
        name="pipe", shape="capsule", xyz=(0.6, 0.5, 0.2), to=(0.6, 0.4, 0.9), radius=0.05
    ),
    ObstacleSection(name="wall", shape="box", xyz=(-0.4, 0.2, 0.5), half_size=(0.05, 0.5, 0.5)),
)
STRENGTHS = PotentialFieldSection(obstacles=0.1, lines=0.2, joint_limits=0.1, manipulability=0.3)


def arm_among(name, obstacles, potential=STRENGTHS, **redundancy):
    """Return a shipped arm among obstacles, and the scene that its daemon would know."""
    cell = load_cell(name)
    cell = altered(cell, {"obstacles": obstacles, "potential": potential})
    cell = altered(cell, {"mid_range": 0.0, **redundancy}, "redundancy")
    p, mechanism = Parameters.from_cell(cell), Mechanism.from_cell(cell)
    m = cell.config.mechanism
    settings = Settings(
        gains={s: np.array(getattr(cell.config.sources, s).gain) for s in SOURCES},
        T_wrist_mrf=Pose.from_xyz_rpy(m.T_wrist_mrf.xyz, m.T_wrist_mrf.rpy),
        T_world_crf=Pose.identity(),
        wrench_bias=np.zeros(6),
    )
    scene = ObstacleMap.from_cell(cell, Events()).scene(0)
    return Arm(cell, p, mechanism, Control([ArmControl(p, mechanism)]), settings), scene


def field_of(p):
    return Field(p.joints, p.potential, p.capsules)


def look(arm, scene, q, field=None):
    k = arm.mechanism.kinematics(q, arm.settings.T_wrist_mrf)
    objectives = ObjectiveGains({"field": 1.0}, q)
    return (field or field_of(arm.p)).look(q, k, scene, objectives)


def felt(arm, scene, q, field):
    """The potential and its slope."""
    return look(arm, scene, q, field).value


@pytest.mark.parametrize("kind", [*(o.name for o in EVERY_KIND), "all"])
def test_joint_torques_are_the_slope_of_the_potential(kind):
    obstacles = tuple(o for o in EVERY_KIND if kind in (o.name, "all"))
    arm, scene = arm_among("pa10", obstacles)
    field, h = field_of(arm.p), 1e-6
    rng = np.random.default_rng(21)
    for _ in range(5):
        q = rng.uniform(-1.2, 1.2, 7)
        found = felt(arm, scene, q, field)
        assert found.parts["obstacles"] > 0.0
        for i, e in enumerate(np.eye(7)):
            ahead_of = felt(arm, scene, q + h * e, field).total
            behind = felt(arm, scene, q - h * e, field).total
            slope = -(ahead_of - behind) / (2 * h)
            assert found.torque[i] == pytest.approx(slope, rel=1e-5, abs=1e-6)


SPRINGS = PotentialFieldSection(obstacles=0.0, lines=0.0, joint_limits=0.4, rest="posture")


def stiffness(arm):
    """K of eq. 19."""
    return 0.4 / (arm.p.joints.upper - arm.p.joints.lower)


def test_springs_pull_to_the_posture_where_the_cell_says_so(rng):
    arm, _ = arm_among("pa10", (), SPRINGS)
    q, to = arm.random_posture(rng), arm.posture("park")
    k = arm.mechanism.kinematics(q, arm.settings.T_wrist_mrf)
    value = field_of(arm.p).look(q, k, None, ObjectiveGains({"field": 1.0}, to)).value
    np.testing.assert_allclose(value.torque, stiffness(arm) * (to - q))
    assert value.total == pytest.approx(0.5 * stiffness(arm) @ (to - q) ** 2)


def test_another_posture_moves_their_rest_without_a_jump(start):
    arm, _ = arm_among("pa10", (), SPRINGS, field=4.0, posture_name="ready")
    run = start(arm, arm.posture("ready") + np.array([0.3, 0.0, -0.4, 0.0, 0.3, 0.1, 0.0]))
    at = run.pose

    def left(to):
        """What is left of the springs' pull in the self-motions."""
        J = arm.mechanism.kinematics(run.sent[-1], run.settings.T_wrist_mrf).J
        null = np.eye(7) - np.linalg.pinv(J) @ J
        return np.linalg.norm(null @ (stiffness(arm) * (arm.posture(to) - run.sent[-1])))

    run.go(3.0)
    ready, sent = left("ready"), run.sent[-1]
    to = ObjectiveGains(arm.p.redundancy.gains, arm.posture("park"))
    run.settings = dataclasses.replace(run.settings, objectives=to)
    first = np.abs(run.tick().dq).max()
    run.go(3.0)
    assert ready < 1e-4
    assert left("park") < 1e-4
    assert np.abs(run.sent[-1] - sent).max() > 0.01
    assert first < 0.02  # the bounds of acceleration alone would let it be 0.04
    assert np.linalg.norm(run.pose.p - at.p) < 2e-3
    run.observe()


def test_a_small_way_ahead_links_and_screws_are_where_kinematics_have_them():
    arm, _ = arm_among("pa10", EVERY_KIND)
    links, T = Capsules(arm.cell), arm.settings.T_wrist_mrf
    rng = np.random.default_rng(22)

    def at(q):
        k = arm.mechanism.kinematics(q, T)
        return shape(q, k.J, k.T_world_mrf.p, links.place(q[None]).ends[0])

    for _ in range(5):
        q, way, step = rng.uniform(-1.5, 1.5, 7), rng.normal(size=7), 1e-5
        found, true = ahead(at(q), links.body, way, step), at(q + step * way)
        for a, b in zip(found, true, strict=True):
            np.testing.assert_allclose(a, b, atol=2e-9)


SWUNG = np.array([-0.4, 0.0, 0.5, 0.0, -0.4, 0.0, 0.0])


def test_the_slope_in_the_self_motions_is_gone_within_two_seconds(start):
    """The stated ε: a hundredth of a strength of 0.1 N·m."""
    arm, scene = arm_among("pa10", EVERY_KIND, field=4.0)
    run = start(arm, arm.posture("ready") + SWUNG)
    before = run.pose
    first = run.tick(scene=scene).found.field.slope
    last = run.go(2.0, scene=scene)
    assert first > 0.04
    assert last.found.field.slope < 1e-3
    assert np.linalg.norm(run.pose.p - before.p) < 1e-3
    run.observe()


@pytest.mark.parametrize("strength", [1e-3, 1.0])
def test_the_strengths_do_not_change_how_quickly_the_slope_is_gone(start, strength):
    potential = PotentialFieldSection(obstacles=strength, lines=strength, joint_limits=strength)
    arm, scene = arm_among("pa10", EVERY_KIND, potential, field=4.0)
    run = start(arm, arm.posture("ready") + SWUNG)
    first = run.tick(scene=scene).found.field.slope
    assert run.go(2.0, scene=scene).found.field.slope < 0.02 * first


def test_an_obstacle_that_leaps_at_the_arm_asks_for_no_more_than_the_bound(start):
    arm, scene = arm_among("pa10", EVERY_KIND, field=10.0)
    run = start(arm)
    run.go(0.5, scene=scene)
    elbow = Capsules(arm.cell).place(run.sent[-1][None]).ends[0][4, 0]
    at = np.vstack([elbow + 0.01, scene.rounds.start[1:]])
    rounds = dataclasses.replace(
        scene.rounds, start=at, end=np.vstack([at[:1], scene.rounds.end[1:]])
    )
    leap = dataclasses.replace(scene, rounds=rounds)
    for _ in range(50):
        output = run.tick(scene=leap)
        share = np.abs(output.found.self_motion.dq) / arm.p.joints.velocity
        assert share.max() <= arm.p.redundancy.max_rate + 1e-12
    run.observe()


def test_self_motion_leaves_the_task_its_speed(start, stick):
    """s is the most with |dq_task + s dq_null| ≤ V: the tool is not slowed for it."""
    arm, scene = arm_among("pa10", EVERY_KIND, field=10.0, max_rate=10.0)
    push = stick(0.25, 0.0, 0.1, 0.0, 0.0, 0.0)
    alone = start(arm)
    both = start(arm)
    for _ in range(60):
        quiet = alone.tick(stick=push)
        output = both.tick(scene=scene, stick=push)
        assert output.granted == pytest.approx(quiet.granted, abs=0.05)
    assert max(np.abs(o.found.self_motion.dq).max() for o in both.outputs) > 0.05


def test_a_field_that_nothing_follows_is_not_computed(start, monkeypatch):
    arm, scene = arm_among("pa10", EVERY_KIND, field=0.0)
    run = start(arm)
    monkeypatch.setattr(arm.p.capsules, "place", None)
    assert run.go(0.1, scene=scene).found.field is None


def test_where_there_is_no_field_none_is_computed_or_told(start):
    """Obstacles that do not repel, and no other potential."""
    none = PotentialFieldSection(obstacles=0.0, lines=0.0, joint_limits=0.0, manipulability=0.0)
    arm, scene = arm_among("pa10", EVERY_KIND, none, field=4.0)
    run = start(arm)
    output = run.go(0.1, scene=scene)
    assert output.found.field is None
    assert not output.found.self_motion.dq.any()


def test_without_obstacles_the_other_potentials_are_felt(start, monkeypatch):
    arm, _ = arm_among("pa10", EVERY_KIND, field=4.0)
    run = start(arm, arm.posture("ready") + SWUNG)
    monkeypatch.setattr(arm.p.capsules, "place", None)
    output = run.tick()
    assert output.found.field.parts["joint_limits"] > 0.0
    assert output.found.field.parts["obstacles"] == 0.0
    assert output.found.self_motion.dq.any()


ON_THE_WAY = (ObstacleSection(name="ball", shape="sphere", xyz=(0.55, 0.0, 0.40), radius=0.05),)
LINK = VirtualLinkSection(directions=((0.0, 0.0, 1.0),), stiffness=2.0, longest=0.3, speed=0.3)


def crossing(start, obstacles, link=LINK):
    """A six-joint arm's tool goes 0.3 m to the side, straight through where the obstacle is."""
    potential = PotentialFieldSection(obstacles=0.02, joint_limits=0.0, virtual_link=link)
    arm, scene = arm_among("ur5e", obstacles, potential)
    run = start(arm)
    first = run.pose
    goal = PathGoal(Pose(first.R, first.p + np.array([0.0, -0.3, 0.0])), 1)
    return run, scene, first, goal


def test_a_six_joint_arm_goes_round_an_obstacle_on_its_path_and_comes_back_to_it(start):
    run, scene, first, goal = crossing(start, ON_THE_WAY)
    off, nearest = [], []
    for _ in range(600):
        output = run.tick(scene=scene, goal=goal)
        off.append(0.0 if output.task.off_path is None else output.task.off_path[2])
        nearest.append(np.linalg.norm(run.pose.p - [0.55, 0.0, 0.40]))
    assert max(off) > 0.03
    straight = np.abs(first.p - [0.55, 0.0, 0.40])[[0, 2]]
    assert min(nearest) > np.linalg.norm(straight) + 0.02
    # All the while it is off along its own direction alone, and by what it says.
    for output, d in zip(run.outputs, off, strict=True):
        way = output.T_world_mrf.p - first.p
        assert abs(way[0]) < 2e-3
        assert abs(way[2] - d) < 5e-3
    gone = run.go(3.0, goal=goal)  # the obstacle is taken away
    assert abs(gone.task.off_path[2]) < 1e-3
    assert gone.at_goal
    assert np.linalg.norm(run.pose.p - goal.T_world_target.p) < 1e-3
    run.observe()


def test_without_the_virtual_link_six_joints_keep_to_their_path(start):
    run, scene, first, goal = crossing(start, ON_THE_WAY, link=None)
    run.go(5.0, scene=scene, goal=goal)
    assert max(abs(o.T_world_mrf.p[2] - first.p[2]) for o in run.outputs) < 1e-3


def test_the_virtual_link_gives_way_no_further_than_it_is_long(start):
    link = LINK.model_copy(update={"stiffness": 1e-3, "longest": 0.03})
    run, scene, _, goal = crossing(start, ON_THE_WAY, link)
    run.go(6.0, scene=scene, goal=goal)
    off = [o.task.off_path[2] for o in run.outputs if o.task.off_path is not None]
    assert max(map(abs, off)) <= 0.03 + 1e-9


def test_without_a_path_the_virtual_link_moves_nothing(start):
    run, scene, first, _ = crossing(start, ON_THE_WAY)
    output = run.go(1.0, scene=scene)
    assert output.task.off_path is None
    np.testing.assert_allclose(run.pose.p, first.p, atol=1e-12)


def offs(run):
    """Where the tool was off its path (ticks, 3) [m]."""
    return np.array([o.task.off_path for o in run.outputs if o.task.off_path is not None])


BESIDE = (ObstacleSection(name="ball", shape="sphere", xyz=(0.57, 0.0, 0.38), radius=0.05),)
SQUARE = LINK.model_copy(update={"directions": ((0.0, 0.0, 2.0), (1.0, 0.0, 0.0))})


def test_two_links_give_way_in_their_plane_to_where_springs_and_field_are_even(start):
    run, scene, _, goal = crossing(start, BESIDE, SQUARE)
    run.go(8.0, scene=scene, goal=goal)
    off = offs(run)
    assert np.abs(off[:, [0, 2]]).max(axis=0).min() > 0.01
    assert np.abs(off[:, 1]).max() < 1e-12
    run.observe()
    # By differences of the potential alone: no way in the plane leads further downhill.
    arm, d = run.arm, off[-1]
    k, q = run.outputs[-1].kinematics, run.memory.commanded.motion.q
    for e in np.eye(3)[[0, 2]]:
        dq = np.linalg.solve(k.J, np.concatenate([e, np.zeros(3)]))
        h = 1e-4
        up, down = (sum(felt(arm, scene, q + s * h * dq, None).parts.values()) for s in (1, -1))
        assert (up - down) / (2 * h) == pytest.approx(-SQUARE.stiffness * (d @ e), abs=0.02)
        assert abs(d @ e) > 1e-3


@pytest.mark.parametrize(("axes", "across"), [("mrf", (1.0, 0.0, 0.0)), ("path", (0.0, 1.0, 0.0))])
def test_a_link_in_axes_of_the_tool_or_of_the_path_gives_way_along_these(start, axes, across):
    link = LINK.model_copy(update={"directions": (across,), "axes": axes})
    run, scene, first, goal = crossing(start, BESIDE, link)
    turned = Pose(goal.T_world_target.R, first.p + np.array([0.1, -0.3, 0.05]))
    goal = PathGoal(turned, 1)
    run.go(5.0, scene=scene, goal=goal)
    way = turned.p - first.p
    level = np.array([way[1], -way[0], 0.0]) / np.hypot(way[0], way[1])
    along = {"mrf": run.pose.R[:, 0], "path": level}[axes]
    off = offs(run)
    assert np.linalg.norm(off, axis=1).max() > 0.01
    assert np.abs(off - np.outer(off @ along, along)).max() < 1e-6
    run.observe()


def test_a_vertical_path_has_axes_too_and_a_goal_where_the_tool_is_has_worlds(start):
    link = LINK.model_copy(update={"axes": "path", "directions": ((0.0, 1.0, 0.0),)})
    field = crossing(start, ON_THE_WAY, link)[0].arm.control.arms[0].p
    links, eye = field_of(field), np.eye(3)
    for way in ((0.0, 0.0, -0.5), (0.3, 0.0, 0.0), (0.0, 0.0, 0.0)):
        found = links.directions(links.links, eye, eye, np.array(way))
        np.testing.assert_allclose(found[0], [0, 1, 0])


def test_an_operator_turns_the_link_with_his_frame_and_what_it_left_behind_comes_back(start):
    link = LINK.model_copy(update={"axes": "crf"})
    run, scene, _, goal = crossing(start, BESIDE, link)
    run.go(2.0, scene=scene, goal=goal)
    up = abs(run.outputs[-1].task.off_path[2])
    assert up > 0.01
    crf = Pose.from_xyz_rpy((0.0, 0.0, 0.0), (0.0, 0.9, 0.0))
    run.set(T_world_crf=crf, redefined=1)
    run.go(4.0, scene=scene, goal=goal)
    off = offs(run)
    assert np.abs(np.diff(off, axis=0)).max() <= 2 * link.speed * run.arm.p.period_s + 1e-9
    along, across = off[-1] @ crf.R[:, 2], off[-1] @ crf.R[:, 0]
    assert abs(across) < 1e-4 < 2e-3 < abs(along)
    run.observe()


def changes(run, since):
    """The greatest change of the velocity along the links in a tick, from a tick on [m/s]."""
    rates = np.array([o.found.give_way for o in run.outputs[since - 1 :]])
    return np.abs(np.diff(rates, axis=0)).max()


def test_links_that_are_told_anew_take_over_without_a_jump_and_take_back_what_others_left(start):
    run, scene, _, goal = crossing(start, BESIDE)
    run.go(2.0, scene=scene, goal=goal)
    since, up = len(run.outputs), abs(offs(run)[-1][2])
    assert up > 0.01
    run.set(links=VirtualLinks(((1.0, 0.0, 0.0),), stiffness=LINK.stiffness))
    run.go(5.0, scene=scene, goal=goal)
    off = offs(run)[-1]
    assert abs(off[2]) < 2e-3 < abs(off[0])
    assert changes(run, since) < 5e-3
    run.observe()


def test_a_stiffer_spring_and_no_link_at_all_bring_the_tool_nearer_and_back_without_a_jump(start):
    run, scene, _, goal = crossing(start, BESIDE)
    run.go(4.0, scene=scene, goal=goal)
    since, far = len(run.outputs), abs(offs(run)[-1][2])
    run.set(links=VirtualLinks(LINK.directions, stiffness=4.0 * LINK.stiffness))
    run.go(3.0, scene=scene, goal=goal)
    near = abs(offs(run)[-1][2])
    assert 1e-3 < near < 0.6 * far
    run.set(links=VirtualLinks())
    run.go(3.0, scene=scene, goal=goal)
    assert np.abs(offs(run)[-1]).max() < 1e-4
    assert changes(run, since) < 5e-3
    run.observe()


def test_an_arm_without_links_computes_none(start, monkeypatch):
    run, scene, _, goal = crossing(start, BESIDE, link=None)
    monkeypatch.setattr(Field, "directions", None)
    monkeypatch.setattr(Field, "give_way", None)
    monkeypatch.setattr(PositionState, "way", None)
    assert run.go(0.1, scene=scene, goal=goal).found.give_way is None


@pytest.mark.parametrize("always", [True, False])
def test_a_link_that_always_acts_gives_way_without_a_goal_and_comes_back(start, stick, always):
    link = LINK.model_copy(update={"always": always})
    run, scene, first, _ = crossing(start, ON_THE_WAY, link)
    moved = stick(0.0, -0.03, 0.0, 0.0, 0.0, 0.0)
    run.go(4.0, scene=scene, stick=moved)
    assert (run.outputs[-1].task.off_path is not None) is always
    rose = run.pose.p[2] - first.p[2]
    assert bool(abs(rose) > 0.01) is always
    if always:
        assert rose == pytest.approx(run.outputs[-1].task.off_path[2], abs=5e-3)
        run.go(4.0, stick=moved)  # the obstacle is taken away
        assert abs(run.pose.p[2] - first.p[2]) < 2e-3
    run.observe()


def test_an_arm_with_spare_joints_uses_them_and_the_link(start):
    ball = (ObstacleSection(name="ball", shape="sphere", xyz=(0.62, 0.0, 0.42), radius=0.06),)
    potential = PotentialFieldSection(obstacles=0.05, joint_limits=0.0, virtual_link=LINK)
    arm, scene = arm_among("pa10", ball, potential, field=4.0)
    run = start(arm)
    goal = PathGoal(Pose(run.pose.R, run.pose.p + np.array([0.0, -0.2, 0.0])), 1)
    run.go(4.0, scene=scene, goal=goal)
    assert np.abs(offs(run)[:, 2]).max() > 5e-3
    assert np.abs(offs(run)[:, :2]).max() < 1e-12
    assert max(np.abs(o.found.self_motion.dq).max() for o in run.outputs) > 0.01
    run.observe()


@pytest.mark.parametrize(
    ("directions", "words"),
    [
        (((0.0, 0.0, 0.0),), "must not be zero"),
        (((0.0, 0.0, 1.0), (1.0, 0.0, 0.1)), "must be square"),
        ((), "at least 1"),
        (((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), "at most 2"),
    ],
)
def test_links_that_are_no_directions_are_refused(directions, words):
    with pytest.raises(ValueError, match=words):
        VirtualLinkSection(directions=directions)


def rounds(start, search, sense):
    """Drive a tool three times on a circle, 6 cm/s, and return the postures and the slopes.

    Of the last round, postures (n, 7) in the order of a circle that is gone in sense +1.
    """
    potential = STRENGTHS.model_copy(update={"search": search})
    arm, scene = arm_among("pa10", EVERY_KIND, potential, field=4.0)
    run = start(arm, arm.posture("ready") + np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0]))
    run.go(3.0, scene=scene)
    at, n, postures, slopes = run.pose, round(4.0 / arm.p.period_s), [], []
    for k in range(2 * n):
        a = sense * 2.0 * np.pi * k / n
        aim = at.p + 0.08 * np.array([0.0, np.sin(a), np.cos(a) - 1.0])
        way = sense * 0.04 * np.pi * np.array([0.0, np.cos(a), -np.sin(a)])
        twist = np.concatenate([way, np.zeros(3)]) + 4.0 * pose_error(Pose(at.R, aim), run.pose)
        output = run.tick(scene=scene, stick=StickCommand(twist, np.eye(3)))
        postures.append(run.sent[-1])
        slopes.append(output.found.field.slope)
    run.observe()
    last = np.array(postures[n:])
    return arm, scene, (last if sense > 0 else last[-2::-1]), max(slopes[n:])


def test_with_a_search_joints_are_where_the_tool_is_however_it_came_there(start):
    """Wang's cyclic property (Scott and Carignan 2008, section II): 0.13 rad without a search."""
    arm, scene, there, slope = rounds(start, 2, +1)
    back, n = rounds(start, 2, -1)[2], len(there)
    assert np.abs(there[: n - 1] - back).max() < 0.015
    assert slope < 1e-3
    lags = rounds(start, 0, +1)[2][: n - 1] - rounds(start, 0, -1)[2]
    assert np.abs(lags).max() > 0.08
    # The least of all postures of the self-motion around, 2 mrad apart, is where the arm is.
    field, T = field_of(arm.p), arm.settings.T_wrist_mrf
    for q in there[:: n // 4]:
        aim, least = arm.mechanism.kinematics(q, T).T_world_mrf, (np.inf, q)
        for sign in (1.0, -1.0):
            at, way = q, np.zeros(7)
            for _ in range(100):
                k = arm.mechanism.kinematics(at, T)
                null = np.linalg.svd(k.J)[2][6]
                way = null * (np.sign(null @ way) or sign)
                back_to = np.linalg.pinv(k.J) @ pose_error(aim, k.T_world_mrf)
                at = at + back_to + 2e-3 * way
                least = min(least, (felt(arm, scene, at, field).total, at), key=lambda x: x[0])
        assert np.abs(least[1] - q).max() < 0.015


def test_a_search_keeps_the_bounds_of_the_joints_when_an_obstacle_jumps(start):
    potential = STRENGTHS.model_copy(update={"search": 8})
    arm, scene = arm_among("pa10", EVERY_KIND, potential, field=4.0)
    run = start(arm, arm.posture("ready") + SWUNG)
    before = run.pose
    for _ in range(3):
        run.go(0.4, scene=scene)
        run.go(0.4)
    run.go(2.0, scene=scene)
    assert run.outputs[-1].found.field.slope < 1e-3
    assert np.linalg.norm(run.pose.p - before.p) < 2e-3
    run.observe()
