"""What the guard makes of rates that are asked for."""

import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.config.schema.surroundings import AvoidanceSection, ObstacleSection
from telerobot.server.control.barriers.clearance import (
    COMMANDED,
    CollisionConstraint,
)
from telerobot.server.control.compiled import evolve
from telerobot.server.control.spatial import Motion, Pose
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap

from .asked import situation

TABLE = ObstacleSection(name="table", shape="box", xyz=(0.6, 0, 0.1), half_size=(0.3, 0.6, 0.1))
POST = ObstacleSection(name="post", shape="point", xyz=(0.85, 0.0, 0.5))


@pytest.fixture
def watched(pa10):
    """Return a function of joint rates, asked for and present: what the guard watches then."""
    given = AvoidanceSection(enabled=True, near_speed=0.05, clearance=0.02)
    cell = altered(pa10.cell, {"obstacles": (TABLE, POST), "avoidance": given})
    guard = CollisionConstraint(cell, pa10.p.joints.acceleration, pa10.p.joints.jerk)
    scene, q = ObstacleMap.from_cell(cell, Events()).scene(0), pa10.posture("ready")
    k = pa10.mechanism.kinematics(q, Pose.identity())

    def watch(asked, dq, clearance=0.02):
        around = evolve(scene, clearance=np.full(2, clearance))
        zero = np.zeros(7)
        at = situation(k, asked, Motion(q, dq, zero), around)
        return guard, guard.watch(*at)

    return k.J, watch


def test_beside_things_the_tool_is_as_slow_as_it_is_told(watched, rng):
    J, watch = watched
    for _ in range(10):
        asked = rng.normal(size=7)
        guard, seen = watch(asked, np.zeros(7))
        near, links = seen.sight.near, guard.capsules
        tool = (links.body[near.first] == links.forest.n) & (near.obstacle >= 0)
        limits = AvoidanceSection(enabled=True)
        far = (near.gap[tool].min() - 0.02) / (limits.near_distance - 0.02)
        bound = 0.05 + np.clip(far, 0.0, 1.0) * (guard._speed - 0.05)
        expected = min(1.0, bound / np.linalg.norm(J[:3] @ asked))
        assert guard.tool_shares(seen) == pytest.approx([expected], abs=1e-12)


def test_as_far_is_looked_as_the_faster_of_both_rates_leads(watched, rng):
    _, watch = watched
    for _ in range(10):
        asked, dq = rng.normal(size=(2, 7))
        _, seen = watch(asked, dq)
        _, fastest = watch(np.maximum(np.abs(asked), np.abs(dq)), np.zeros(7))
        np.testing.assert_array_equal(seen.sight.around, fastest.sight.around)


@pytest.mark.parametrize(("part", "ordered"), [(0.9, False), (1.1, True)])
def test_only_a_tool_that_is_to_move_is_led_out_of_a_bound(watched, rng, part, ordered):
    J, watch = watched
    asked = rng.normal(size=7)
    asked *= part * COMMANDED / np.abs(J @ asked).max()
    _, seen = watch(asked, np.zeros(7), clearance=3.0)
    inside = seen.sight.room < 0.0
    assert inside.any()
    assert ((seen.rows.low[: len(inside)][inside] > 0.0) == ordered).all()
