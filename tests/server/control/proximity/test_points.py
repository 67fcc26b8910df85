"""Distances of points from a scene, against the obstacles' own definitions and their slopes."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.surroundings import ObstacleSection
from telerobot.server.control.proximity.distance import apart
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap

SOLIDS = {
    "dot": ObstacleSection(name="dot", shape="point", xyz=(0.3, 0.3, 0.6)),
    "ball": ObstacleSection(name="ball", shape="sphere", xyz=(0.5, -0.4, 0.7), radius=0.1),
    "pipe": ObstacleSection(
        name="pipe", shape="capsule", xyz=(0.6, 0.5, 0.2), to=(0.6, 0.4, 0.9), radius=0.05
    ),
    "case": ObstacleSection(
        name="case",
        shape="box",
        xyz=(0.1, 0.2, 0.5),
        rpy=(0.3, -0.4, 0.9),
        half_size=(0.1, 0.4, 0.2),
    ),
}
VIEW = ObstacleSection(name="view", shape="sight_line", xyz=(0.0, -0.4, 1.0), to=(0.8, -0.2, 0.1))


def scene_of(*obstacles):
    cell = load_cell("pa10")
    return ObstacleMap.from_cell(altered(cell, {"obstacles": obstacles}), Events()).scene(0)


@pytest.mark.parametrize("name", sorted(SOLIDS))
def test_a_normal_is_the_slope_of_the_distance(name, rng):
    scene, h = scene_of(SOLIDS[name]), 1e-6
    points = rng.uniform(-0.8, 1.0, (200, 3))
    found = apart(points, scene)
    assert found.distance.shape == (200, 1)
    assert name == "dot" or (found.distance < 0.0).any()
    for axis, e in enumerate(np.eye(3)):
        further, nearer = apart(points + h * e, scene), apart(points - h * e, scene)
        slope = (further.distance - nearer.distance) / (2.0 * h)
        assert slope == pytest.approx(found.normal[:, :, axis], abs=1e-5)


def test_a_step_along_the_normal_comes_out_of_a_box(rng):
    scene = scene_of(SOLIDS["case"])
    points = scene.boxes.centre + rng.uniform(-0.05, 0.05, (50, 3))
    found = apart(points, scene)
    assert (found.distance < 0.0).all()
    out = points - found.distance * found.normal[:, 0]
    assert np.abs(apart(out, scene).distance).max() < 1e-12


def test_a_point_is_on_the_surface_where_a_ball_begins_and_a_sight_line_is_no_obstacle():
    scene = scene_of(VIEW, SOLIDS["ball"])
    found = apart(np.array([[0.5, -0.3, 0.7], [0.4, -0.3, 0.55]]), scene)
    assert found.distance.shape == (2, 1)
    assert found.distance[0, 0] == pytest.approx(0.0, abs=1e-12)


def test_what_may_move_is_as_near_as_it_may_be():
    moves = SOLIDS["ball"].model_copy(update={"max_speed": 0.4})
    cell = load_cell("pa10")
    world = ObstacleMap.from_cell(altered(cell, {"obstacles": (moves,)}), Events())
    point = np.array([[0.5, 0.2, 0.7]])
    fresh, older = (apart(point, world.scene(tick)).distance[0, 0] for tick in (0, 10))
    assert fresh == pytest.approx(0.5)
    assert older == pytest.approx(0.5 - 0.4 * 0.1)
