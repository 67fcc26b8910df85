"""Several mechanisms in one forest: each moves as if alone, and slopes count the joints between."""

import numpy as np
import pytest
from telerobot.server.control.proximity.capsules import Capsules, frames_at, levers, placed_at
from telerobot.server.control.proximity.distance import slopes
from telerobot.server.control.spatial import rotation_exp

BODIES = np.array([0, 2, 7])
"""Of one PA-10: its root, its upper arm, its last link."""
SEGMENTS = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 0.2]]] * 3)


@pytest.fixture
def one(pa10):
    return Capsules(pa10.cell).forest


def pair(one, parent):
    """Return the tree of two equal arms; the second one's first joint has this parent."""
    tree = one.tree
    second = np.where(tree.parent < 0, parent, tree.parent + one.n)
    twice = [np.concatenate([a, a]) for a in tree[1:]]
    return np.concatenate([tree.parent, second]), *twice


def moving(parents):
    """Return which joints move each body from 1 on (n, n)."""
    moves = np.eye(len(parents), dtype=bool)
    for j, parent in enumerate(parents.tolist()):
        if parent >= 0:
            moves[j] |= moves[parent]
    return moves


def poses(rng, *shape):
    """Return random attitudes (…, 3, 3) and places (…, 3)."""
    R = np.array([rotation_exp(v) for v in rng.uniform(-3.0, 3.0, (int(np.prod(shape)), 3))])
    return R.reshape(*shape, 3, 3), rng.uniform(-1.0, 1.0, (*shape, 3))


def test_two_arms_move_as_each_would_alone_from_a_root_that_moves(one, rng):
    q, (R, p) = rng.uniform(-2.0, 2.0, (5, 2 * one.n)), poses(rng, 5, 2)
    bodies = np.concatenate([BODIES, np.where(BODIES > 0, BODIES + one.n, -1)])
    segments = np.concatenate([SEGMENTS, SEGMENTS])
    ends, frames, axes = placed_at(pair(one, -2), q, (R, p), bodies, segments)
    for i in range(2):
        joints = slice(i * one.n, (i + 1) * one.n)
        root = R[:, i : i + 1], p[:, i : i + 1]
        alone = placed_at(one.tree[:], q[:, joints], root, BODIES, SEGMENTS)
        np.testing.assert_array_equal(ends[:, 3 * i : 3 * i + 3], alone[0])
        np.testing.assert_array_equal(frames[:, joints], alone[1])
        np.testing.assert_array_equal(axes[:, joints], alone[2])


def test_an_arm_that_stands_on_another_is_carried_by_its_link(one, rng):
    q, root = rng.uniform(-2.0, 2.0, (4, 2 * one.n)), poses(rng, 1, 1)
    frames = frames_at(pair(one, 3), q, root)
    carrier = frames[:, 3]
    alone = frames_at(one.tree[:], q[:, one.n :], (carrier[:, None, :, :3], carrier[:, None, :, 3]))
    np.testing.assert_allclose(frames[:, one.n :], alone, atol=1e-14)


@pytest.mark.parametrize("parent", [-2, 3])
def test_the_slope_of_a_distance_between_arms_counts_the_joints_that_move_one_of_them(
    one, rng, parent
):
    """Two ends of links, one of each arm, whose distance is differentiated by every joint."""
    tree, n = pair(one, parent), 2 * one.n
    bodies, root = np.array([6, one.n + 5]), poses(rng, 1, 2)
    moves, points = moving(tree[0])[bodies - 1], np.repeat(rng.normal(size=(2, 1, 3)), 2, axis=1)
    arms = np.zeros(2), moves, tree[1]

    def apart(q):
        ends = placed_at(tree, q, root, bodies, points)[0]
        return np.linalg.norm(ends[:, 0, 0] - ends[:, 1, 0], axis=1)

    for _ in range(20):
        q = rng.uniform(-2.0, 2.0, n)
        placed = placed_at(tree, q[None], root, bodies, points)
        way = placed[0][0, 0, 0] - placed[0][0, 1, 0]
        normal = way[None] / np.linalg.norm(way)
        found = slopes(placed, arms, (np.array([0]), np.array([1])), normal, placed[0][0, :1, 0])
        step = 1e-6 * np.eye(n)
        expected = (apart(q + step) - apart(q - step)) / 2e-6
        np.testing.assert_allclose(found[0], expected, atol=1e-7)
        assert (found[0][moves[0] == moves[1]] == 0.0).all()


def test_a_lever_bounds_what_each_joint_moves_of_either_arm(one, rng):
    tree, n = pair(one, 3), 2 * one.n
    bodies, root = np.array([6, one.n + 5]), poses(rng, 1, 1)
    moves = moving(tree[0])[bodies - 1]
    for _ in range(20):
        q, step = rng.uniform(-2.0, 2.0, n), 1e-6 * np.eye(n)
        placed = placed_at(tree, q[None], root, bodies, SEGMENTS[:2])
        lever = levers(placed, moves, tree[1])
        ends = placed_at(tree, np.concatenate([q + step, q - step]), root, bodies, SEGMENTS[:2])[0]
        speed = np.linalg.norm(ends[:n] - ends[n:], axis=-1).max(axis=-1) / 2e-6
        np.testing.assert_allclose(lever, speed.T, atol=1e-6)
