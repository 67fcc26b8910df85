"""The walls around the tool, against Pinocchio's idea of where the tool is."""

import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.config.schema.surroundings import (
    AvoidanceSection,
    ToolPlaneSection,
    WorkspaceSection,
)
from telerobot.server.control.barriers.rows import BETWEEN, Walls
from telerobot.server.control.proximity.capsules import Capsules
from telerobot.server.control.spatial import Pose

LOW, HIGH = np.array([0.2, -0.3, 0.2]), np.array([0.8, 0.3, 0.9])
T_WRIST_MRF = Pose.from_xyz_rpy((0.02, -0.05, 0.2), (0.1, 0.2, 0.3))


@pytest.fixture
def walls(pa10):
    box = WorkspaceSection(low=tuple(LOW.tolist()), high=tuple(HIGH.tolist()))
    given = AvoidanceSection(enabled=True, workspace=box)
    cell = altered(pa10.cell, {"avoidance": given})
    return Walls(cell, Capsules(cell))


def places(pa10, q, base=None) -> np.ndarray:
    return np.array([pa10.mechanism.kinematics(x, T_WRIST_MRF, base).T_world_mrf.p for x in q])


def out(p) -> np.ndarray:
    """Return how far places (s, 3) are beyond any wall (s,) [m], some way before it."""
    return np.maximum(LOW + BETWEEN - p, p - HIGH + BETWEEN).max(axis=1)


@pytest.mark.parametrize("base", [None, Pose.from_xyz_rpy((0.3, 0.1, -0.2), (0.1, 0.0, 0.5))])
def test_the_shortfall_is_how_far_the_worst_posture_leads_the_tool_out(pa10, walls, rng, base):
    inside = 0.5 * (LOW + HIGH)
    short = []
    for _ in range(60):
        q = pa10.posture("ready") + rng.uniform(-0.4, 0.4) * rng.uniform(-1, 1, (5, 7))
        expected = max(0.0, float(out(places(pa10, q, base)).max()))
        short.append(walls.violation(inside, T_WRIST_MRF, q, base))
        assert short[-1] == pytest.approx(expected, abs=1e-12)
    assert max(short) > 0.0


def test_planes_are_walls_beside_those_of_a_box(pa10, rng):
    tilted = ToolPlaneSection(point=(0.5, 0.0, 0.3), normal=(0.0, 0.6, 0.8))
    given = AvoidanceSection(enabled=True, tool_planes=(tilted,))
    cell = altered(pa10.cell, {"avoidance": given})
    walls, normal = Walls(cell, Capsules(cell)), np.array(tilted.normal)
    short = []
    for _ in range(60):
        q = pa10.posture("ready") + rng.uniform(-0.6, 0.6) * rng.uniform(-1, 1, (5, 7))
        heights = (places(pa10, q) - tilted.point) @ normal
        short.append(walls.violation(np.array([0.5, 0.0, 2.0]), T_WRIST_MRF, q))
        assert short[-1] == pytest.approx(max(0.0, BETWEEN - heights.min()), abs=1e-12)
    assert max(short) > 0.0


def test_a_tool_that_is_outside_may_only_come_nearer(pa10, walls, rng):
    for _ in range(60):
        q = pa10.random_posture(rng)
        p = places(pa10, q[None])[0]
        assert walls.violation(p, T_WRIST_MRF, q[None]) == 0.0
        further = rng.uniform(-0.3, 0.3, 7)
        after = places(pa10, (q + further)[None])[0]
        worse = max(0.0, float(out(after[None])[0]))
        wall = np.maximum(np.maximum(LOW - p, p - HIGH), 0.0)
        if worse > 0.0 and (np.maximum(LOW - after, after - HIGH) > wall + 0.01).any():
            assert walls.violation(p, T_WRIST_MRF, (q + further)[None]) > 0.0


def test_joints_that_are_said_not_to_lead_the_tool_out_do_not(pa10, walls, rng):
    far = 0
    for _ in range(300):
        q = pa10.posture("ready") + rng.uniform(-0.3, 0.3, 7)
        p, turn = places(pa10, q[None])[0], rng.uniform(-0.03, 0.03, 7)
        if walls.far(p, T_WRIST_MRF, np.abs(turn)):
            far += 1
            assert out(places(pa10, (q + turn)[None]))[0] < 0.0
    assert far > 20


def test_another_tool_has_another_reach(pa10, walls):
    p = places(pa10, pa10.posture("ready")[None])[0]
    room = float(np.minimum(p - LOW, HIGH - p).min())
    way = np.zeros(7)
    way[6] = 0.9 * room / 0.5
    long = Pose(np.eye(3), np.array([1.0, 0.0, 0.0]))
    assert walls.far(p, T_WRIST_MRF, way)
    assert not walls.far(p, long, way)
    assert walls.far(p, T_WRIST_MRF, way)
