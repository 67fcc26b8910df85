"""Links of several arms: what the cell says of one's shape or spheres is found on that arm."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.proximity.capsules import Capsules
from telerobot.server.control.proximity.control_points import ControlPoints
from telerobot.server.control.spatial import Pose
from telerobot.server.control.tick import Control
from telerobot.server.perception.obstacle_map import ObstacleMap
from telerobot.server.runtime.events import Events

PAIR = """
name = "two"
default_script = "pa10_tour"
[[buses]]
name = "one"
channel = "239.74.163.30"
[[buses]]
name = "other"
channel = "239.74.163.31"
[[mechanisms]]
name = "left"
like = "pa10_hand_pole"
bus = "one"
T_world_base = { xyz = [0.0, 0.55, 0.0] }
[[mechanisms]]
name = "right"
like = "ur5e"
bus = "other"
T_world_base = { xyz = [0.0, -0.6, 0.0] }
[avoidance]
capsules = [
  { link = "left.hand", start = [0.0, 0.0, 0.0], end = [0.0, 0.0, 0.3], radius = 0.2 },
  { link = "right.link6", start = [0.0, 0.0, 0.0], end = [0.0, 0.0, 0.3], radius = 0.21 },
]
"""


@pytest.fixture
def two(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(PAIR)
    return load_cell(path)


def test_a_capsule_is_on_the_arm_that_its_link_names(two):
    def stated(cell):
        shapes = Capsules(cell)
        return {link for link, r in zip(shapes.links, shapes.radius, strict=True) if r >= 0.2}

    assert stated(two) == {"left.hand", "right.link6"}
    left, right = two.parts
    assert stated(left) == {"left.hand"}
    assert stated(right) == {"right.link6"}


def test_spheres_of_one_arm_are_as_far_from_things_as_alone(two):
    left, alone = two.parts[0], load_cell("pa10_hand_pole")
    spheres = alone.config.priority.spheres
    q = np.array(alone.config.mechanism.postures["ready"])
    scene = ObstacleMap.from_cell(alone, Events()).scene(0)
    base = Pose(np.eye(3), np.zeros(3))
    both = [ControlPoints(cell, spheres).look(q, scene, base).each for cell in (left, alone)]
    assert np.isfinite(both).all()
    np.testing.assert_allclose(*both)
    assert len(Control.of(two).arms) == 2
