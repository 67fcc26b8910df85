"""Links of several arms: what the cell says of one's shape or spheres is found on that arm."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.proximity.capsules import Capsules
from telerobot.server.control.proximity.pairs import ControlPoints
from telerobot.server.control.spatial import Pose
from telerobot.server.control.tick import Control
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap

CAPSULES = """
[avoidance]
capsules = [
  { link = "left.hand", start = [0.0, 0.0, 0.0], end = [0.0, 0.0, 0.3], radius = 0.2 },
  { link = "right.link6", start = [0.0, 0.0, 0.0], end = [0.0, 0.0, 0.3], radius = 0.21 },
]
"""


@pytest.fixture
def two(two_arms):
    return load_cell(two_arms(like=("pa10_hand_pole", "ur5e"), more=CAPSULES))


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
