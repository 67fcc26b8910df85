"""Sliding: what stands across a path is passed, with bounded rates and without chatter."""

from dataclasses import replace

import numpy as np
import pytest
from telerobot.config.schema.surroundings import ObstacleSection
from telerobot.server.control.inputs import PathGoal
from telerobot.server.control.spatial import Pose, rotation_log

from .test_clearance import BALL, TABLE, Kept


def glided(kept: Kept, since: int = 0):
    """Return joint rates (ticks, n) [rad/s] sent since a tick."""
    return np.diff(np.array(kept.run.sent[since:]), axis=0) / kept.run.arm.p.period_s


def turns(rates, least=0.02):
    """Count how often joints turn round, by more than `least` [rad/s]."""
    round_ = (rates[1:] * rates[:-1] < 0.0) & (np.abs(np.diff(rates, axis=0)) > least)
    return int(round_.sum())


@pytest.mark.parametrize("across", [(0.2, 0.0), (0.0, 0.2), (0.1, -0.15), (-0.2, 0.1)])
def test_a_stick_pushed_obliquely_into_a_table_glides_along_it(pa10, across):
    kept = Kept(pa10, (TABLE,))
    kept.go(0.6, (0, 0, -0.4, 0, 0, 0))
    there, touched = kept.run.pose, len(kept.run.outputs)
    kept.go(1.0, (*across, -0.25, 0, 0, 0))
    way = kept.run.pose.p - there.p
    asked = np.array([*across, 0.0])
    share = float(way @ asked) / float(asked @ asked)
    assert share > 0.3, "it stands"
    assert np.linalg.norm(way[:2] - share * asked[:2]) < 0.15 * np.linalg.norm(way[:2])
    assert abs(way[2]) < 0.02
    assert np.linalg.norm(rotation_log(there.R.T @ kept.run.pose.R)) < 0.1
    assert min(kept.least) > 0.0
    assert kept.stopped == 0.0
    assert turns(glided(kept, touched)) <= pa10.p.n
    kept.run.observe()


def test_pushed_straight_into_a_table_the_tool_hardly_moves_and_hardly_tilts(pa10):
    kept = Kept(pa10, (TABLE,))
    kept.go(1.5, (0, 0, -0.4, 0, 0, 0))
    there = kept.run.pose
    kept.go(1.0, (0, 0, -0.4, 0, 0, 0))
    assert np.linalg.norm(kept.run.pose.p - there.p) < 0.03
    assert np.linalg.norm(rotation_log(there.R.T @ kept.run.pose.R)) < 0.06


def behind(kept: Kept, way) -> PathGoal:
    """Return a goal that lies so far from where the tool is, in the same attitude."""
    here = kept.run.pose
    return PathGoal(Pose(here.R, here.p + np.array(way)), serial=1)


@pytest.mark.parametrize("aside", [(0.0, 0.0, 0.0), (0.0, 0.0, 0.02), (0.01, 0.0, -0.03)])
@pytest.mark.parametrize("shape", ["sphere", "capsule", "box"])
def test_a_target_behind_something_is_reached_round_it(pa10, shape, aside):
    tool = Kept(pa10, ()).run.pose.p
    middle = tuple((tool + np.array([0.0, 0.25, 0.0]) + aside).tolist())
    thing = {
        "sphere": ObstacleSection(name="it", shape="sphere", xyz=middle, radius=0.06),
        "capsule": ObstacleSection(
            name="it", shape="capsule", xyz=middle, to=(middle[0], middle[1], middle[2] + 0.3),
            radius=0.04,
        ),
        "box": ObstacleSection(name="it", shape="box", xyz=middle, half_size=(0.05, 0.05, 0.05),
                        rpy=(0.3, 0.2, 0.5)),
    }[shape]  # fmt: skip
    kept = Kept(pa10, (thing,))
    goal = behind(kept, (0.0, 0.5, 0.0))
    start = kept.run.pose.p
    for _ in range(1200):
        output = kept.run.tick(goal=goal, scene=kept.world.scene(0))
        kept.least.append(kept.gap())
        if output.at_goal:
            break
    assert output.at_goal
    assert min(kept.least) > 0.0
    assert kept.stopped < 0.01
    assert any("clearance:" in name for o in kept.run.outputs for name in o.limits)
    off = [np.linalg.norm(o.T_world_mrf.p - start - [0, (o.T_world_mrf.p - start)[1], 0])
           for o in kept.run.outputs]  # fmt: skip
    assert max(off) > 0.03, "nothing was in the way"
    assert turns(glided(kept)) <= 4 * pa10.p.n
    kept.run.observe()


def test_what_is_only_beside_the_path_slows_the_tool_and_does_not_turn_it(pa10):
    """The path is kept as long as slowing down is enough."""
    tool = Kept(pa10, ()).run.pose.p
    wall = ObstacleSection(
        name="it", shape="box", xyz=(float(tool[0]), float(tool[1]) + 0.6, float(tool[2])),
        half_size=(0.4, 0.02, 0.4),
    )  # fmt: skip
    kept = Kept(pa10, (wall,))
    start, slowest = kept.run.pose.p, 1.0
    for _ in range(200):
        kept.go(0.01, (0.0, 0.5, 0.03, 0, 0, 0))
        slowest = min(slowest, kept.run.outputs[-1].granted)
        if slowest < 0.55:
            break
        way = kept.run.pose.p - start
        side = way - way @ [0, 0.5, 0.03] / (0.5**2 + 0.03**2) * np.array([0, 0.5, 0.03])
        assert np.linalg.norm(side) < 1e-3 + 0.01 * np.linalg.norm(way)
    assert slowest < 0.55
    assert kept.run.pose.p[1] > start[1] + 0.1


def test_an_arm_at_a_joint_limit_beside_something_leaves_it(pa10):
    """The elbow is as bent as it may be, and the way out would bend it more: the rest goes on."""
    q = np.array([-0.229, 0.23, 1.048, pa10.p.joints.upper[3] - 2e-6, 0.203, 0.017, 0.495])
    kept = Kept(pa10, (replace_at(BALL, Kept(pa10, (), q), 0.14),), q)
    start, gap = kept.run.pose.p, kept.gap()
    way = np.array([-0.345, -0.798, -0.495])
    kept.go(1.5, (*(0.15 * way), 0, 0, 0))
    assert "joint_limit:e1" in {name for o in kept.run.outputs for name in o.limits}
    assert way @ (kept.run.pose.p - start) > 0.02
    assert kept.gap() > gap
    assert min(kept.least) > min(gap, 0.0) - 3e-4
    kept.run.observe()


def replace_at(thing: ObstacleSection, kept: Kept, away: float) -> ObstacleSection:
    p = kept.run.pose.p + away * np.array([0.345, 0.798, 0.495])
    return thing.model_copy(update={"xyz": tuple(p.tolist())})


def test_the_path_waits_for_a_joint_that_does_not_follow(pa10):
    kept = Kept(pa10, (TABLE,))
    goal = behind(kept, (0.0, 0.3, 0.0))
    for _ in range(50):
        kept.run.tick(goal=goal, scene=kept.world.scene(0))
    stuck = kept.run.memory.commanded.sent[1]
    for _ in range(200):
        output = kept.run.tick(goal=goal, scene=kept.world.scene(0), q_measured=stuck)
    assert any(name.startswith("leash:") for name in output.limits)
    part = output.task.position.progress.part
    for _ in range(200):
        output = kept.run.tick(goal=goal, scene=kept.world.scene(0), q_measured=stuck)
    assert output.task.position.progress.part == pytest.approx(part, abs=0.01)
    assert part < 0.9


def test_a_tool_that_slides_is_led_home_to_the_path_behind_what_stood_on_it(pa10):
    tool = Kept(pa10, ()).run.pose.p
    ball = BALL.model_copy(
        update={"xyz": tuple((tool + np.array([0.0, 0.2, -0.03])).tolist()), "radius": 0.06}
    )
    kept = Kept(pa10, (ball,))
    start = kept.run.pose.p
    goal = replace(behind(kept, (0.0, 0.7, 0.0)), speed=0.15)
    off, there = [], []
    for _ in range(1200):
        output = kept.run.tick(goal=goal, scene=kept.world.scene(0))
        way = kept.run.pose.p - start
        off.append(float(np.hypot(way[0], way[2])))
        there.append(float(way[1]))
        if output.at_goal:
            break
    assert output.at_goal
    assert max(off) > 0.05
    late = [o for o, y in zip(off, there, strict=True) if y > 0.6]
    assert late
    assert max(late) < 0.02


def test_beside_a_singularity_and_at_a_joint_limit_no_joint_swings_to_and_fro(pa10):
    """Stretched, the shoulder at its limit: self-motion would buy a little way at great speed."""
    q = np.array([2.188, pa10.p.joints.upper[1] - 1e-6, 0.009, 0.258, -0.537, 2.846, 3.46])
    kept = Kept(pa10, (), q)
    kept.go(4.0, (-0.12, 0.06, -0.065, 0, 0, 0))
    assert "joint_limit:s2" in {name for o in kept.run.outputs for name in o.limits}
    assert turns(glided(kept)) <= 10
    kept.run.observe()
