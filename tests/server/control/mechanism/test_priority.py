"""Virtual spheres: the printed values of α and ξ, slopes by differences, signs that lead away."""

import dataclasses
import math

import numpy as np
import pytest
from laboratory.bench.load import chain
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.surroundings import ObstacleSection
from telerobot.config.urdf.robot import read_robot
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.mechanism.redundancy import RELEASE_S, Priority, alpha_of, size_of
from telerobot.server.control.proximity.pairs import ALIKE, ControlPoints
from telerobot.server.control.spatial import Pose
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap

CELL = load_cell("pa10_hand_pole")
LAW = CELL.config.priority
START = np.array(CELL.config.mechanism.postures["start"])
BALL = ObstacleSection(name="ball", shape="sphere", xyz=(0.35, -0.35, 0.5), radius=0.05)


def priority_of(cell=CELL, **changes):
    return Priority.from_cell(altered(cell, changes, "priority"))


def scene_of(*obstacles):
    return ObstacleMap.from_cell(altered(CELL, {"obstacles": obstacles}), Events()).scene(0)


def null_at(q):
    J = Mechanism.from_cell(CELL).kinematics(q, Pose.identity()).J
    return np.linalg.svd(J)[2][6:]


def near_the_pole(rng):
    """Return postures with the elbow in reach of the pole."""
    while True:
        q = START + rng.normal(0.0, 0.35, 7)
        if (
            0.02
            < priority_of().look(q, scene_of(*CELL.config.obstacles), None).distances.least
            < 0.2
        ):
            yield q


@pytest.mark.parametrize(
    ("distance", "alpha", "size"),
    [
        (0.10, 1.0, 0.45),
        (0.15, 1.0, 0.3),
        (0.17, math.exp(-1.0), 0.24),
        (0.20, math.exp(-2.5), 0.15),
        (0.25, math.exp(-5.0), 0.0),
        (0.40, math.exp(-12.5), 0.0),
        (math.inf, 0.0, 0.0),
    ],
)
def test_priority_and_rates_are_those_of_the_paper(distance, alpha, size):
    assert alpha_of(distance, LAW) == pytest.approx(alpha, abs=1e-12)
    assert size_of(distance, LAW) == pytest.approx(size, abs=1e-12)


def test_the_distance_of_the_elbow_is_that_of_a_drawing():
    found = priority_of().look(START, scene_of(*CELL.config.obstacles), None)
    elbow = np.array([0.45 * math.sin(START[1]), 0.0, 0.315 + 0.45 * math.cos(START[1])])
    aside = np.maximum(np.abs(elbow - [0.4, 0.3, 0.78]) - [0.05, 0.05, 0.175], 0.0)
    assert found.names == ("elbow", "forearm")
    assert found.distances.each[0] == pytest.approx(np.linalg.norm(aside), abs=1e-6)


def test_the_slope_is_that_of_the_distance(rng):
    priority, scene, h = priority_of(), scene_of(*CELL.config.obstacles, BALL), 1e-6

    def mixed(q):
        """Return the distance with near ties mixed, of every sphere and obstacle [m]."""
        each = [priority.look(q, scene_of(o), None).distances.each for o in obstacles]
        return -ALIKE * math.log(np.exp(-np.array(each) / ALIKE).sum())

    obstacles = (*CELL.config.obstacles, BALL)
    for _ in range(10):
        q = rng.uniform(-1.5, 1.5, 7)
        slope = priority.look(q, scene, None).distances.slope
        for i, e in enumerate(np.eye(7)):
            expected = (mixed(q + h * e) - mixed(q - h * e)) / (2.0 * h)
            assert slope[i] == pytest.approx(expected, abs=1e-6)


def test_a_sliding_joint_moves_a_sphere_along_its_axis(tmp_path):
    """A made chain, of whose seven joints the second slides: the slope is that by differences."""
    cell = chain(CELL, 7, tmp_path)
    text = cell.path.read_text(encoding="utf-8")
    path = tmp_path / "slides.urdf"
    path.write_text(
        text.replace('"joint1" type="revolute"', '"joint1" type="prismatic"'), encoding="utf-8"
    )
    cell = dataclasses.replace(cell, robot=read_robot(path, "tip", str(path)))
    spheres, scene, h = ControlPoints(cell, LAW.spheres[:1]), scene_of(BALL), 1e-6
    q = np.array([0.3, 0.1, -0.2, 0.5, 0.4, 0.1, 0.0])
    slope = spheres.look(q, scene).slope
    for i, e in enumerate(h * np.eye(7)):
        ahead, behind = spheres.look(q + e, scene).least, spheres.look(q - e, scene).least
        assert slope[i] == pytest.approx((ahead - behind) / (2.0 * h), abs=1e-6)
    assert abs(slope[1]) > 0.1


@pytest.mark.parametrize("joints", [("s1",), ("s3",), ("s1", "s3"), ("e2",)])
def test_every_joints_rate_leads_away_by_self_motion(joints, rng):
    priority, scene = priority_of(joints=joints), scene_of(*CELL.config.obstacles)
    leading = 0
    for q, _ in zip(near_the_pole(rng), range(20), strict=False):
        near, null = priority.look(q, scene, None), null_at(q)
        xi = priority.rates(near, null)
        moved = {joint.name for joint, x in zip(CELL.robot.joints, xi, strict=True) if x}
        assert moved <= set(joints)
        ahead = q + 1e-4 * null.T @ (null @ xi)
        widened = priority.look(ahead, scene, None).distances.least - near.distances.least
        assert widened >= -1e-12
        leading += widened > 0.0
    assert leading >= 18


def test_no_sign_is_sudden_where_neither_way_leads_away(rng):
    """Across the posture where self-motion does not change the distance, rates turn over gently."""
    priority = priority_of()
    above = ObstacleSection(name="lamp", shape="sphere", xyz=(0.318, 0.0, 0.95), radius=0.1)
    scene = scene_of(above)
    rates = []
    for swing in np.linspace(-0.02, 0.02, 81):
        q = START + swing * null_at(START)[0]
        near = priority.look(q, scene, None)
        rates.append(priority.rates(near, null_at(q)))
    rates = np.array(rates)
    assert np.ptp(np.sign(rates[[0, -1], 2])) == 2.0
    assert np.abs(np.diff(rates, axis=0)).max() < 0.3 * np.ptp(rates[:, 2])


def test_without_precedence_all_of_the_force_is_followed():
    scene = scene_of(*CELL.config.obstacles)
    near = priority_of(precedence=False, inner_radius=0.24, outer_radius=0.4).look(
        START, scene, None
    )
    assert near.alpha == 0.0
    closer = priority_of(inner_radius=0.24, outer_radius=0.4)
    assert closer.look(START, scene, None).alpha > 0.5


def test_precedence_comes_at_once_and_goes_gently():
    priority = priority_of(outer_radius=0.35, inner_radius=0.3)
    near = priority.look(START, scene_of(*CELL.config.obstacles), None)
    assert near.alpha == 1.0
    alphas = []
    for _ in range(40):
        near = priority.look(START, None, near)
        alphas.append(near.alpha)
    step = CELL.config.timing.period_s / RELEASE_S
    assert np.diff([1.0, *alphas]).min() == pytest.approx(-step)
    assert alphas[-1] == 0.0


def test_nothing_near_asks_for_nothing():
    for scene in (None, scene_of()):
        near = priority_of().look(START, scene, None)
        assert near.alpha == 0.0
        assert not priority_of().rates(near, null_at(START)).any()
