"""Trees of joints against Pinocchio; several mechanisms in one forest move as each would alone."""

import numpy as np
import pinocchio as pin
import pytest
from telerobot.server.control.forest import frames_at, placed_at
from telerobot.server.control.mechanism.model import Dynamics, Mechanism
from telerobot.server.control.proximity.capsules import Capsules, levers
from telerobot.server.control.proximity.distance import slopes
from telerobot.server.control.spatial import Pose, rotation_exp

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


INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
KINDS = ("revolute", "prismatic", "revolute", "revolute", "prismatic", "revolute")


@pytest.fixture
def crooked(rng):
    """Turning and sliding joints about any axes, anywhere, with bodies that have no symmetry."""

    def row(*values):
        return " ".join(f"{value:.17g}" for value in values)

    parts = ['<robot name="crooked"><link name="l0"/>']
    for j, kind in enumerate(KINDS):
        a = rng.uniform(-0.1, 0.1, (3, 3))
        entries = (a @ a.T + 0.02 * np.eye(3))[np.triu_indices(3)].tolist()
        inertia = " ".join(f'{name}="{x:.17g}"' for name, x in zip(INERTIA, entries, strict=True))
        axis = rng.normal(size=3)
        parts.append(
            f'<link name="l{j + 1}"><inertial><origin xyz="{row(*rng.uniform(-0.3, 0.3, 3))}"/>'
            f'<mass value="{rng.uniform(0.5, 4.0)}"/><inertia {inertia}/></inertial></link>'
            f'<joint name="j{j}" type="{kind}"><parent link="l{j}"/><child link="l{j + 1}"/>'
            f'<origin xyz="{row(*rng.uniform(-0.5, 0.5, 3))}" rpy="{row(*rng.uniform(-2, 2, 3))}"/>'
            f'<axis xyz="{row(*axis / np.linalg.norm(axis))}"/>'
            '<limit lower="-3" upper="3" velocity="2" effort="100"/></joint>'
        )
    base = Pose.from_xyz_rpy((0.3, -0.2, 0.5), (0.4, -0.3, 1.2))
    names = tuple(f"j{j}" for j in range(len(KINDS)))
    return Mechanism("\n".join([*parts, "</robot>"]), names, f"l{len(KINDS)}", base)


def test_pose_and_jacobian_are_pinocchios(crooked, rng):
    model, data, base = crooked.model, crooked.model.createData(), crooked.T_world_base
    for q in rng.uniform(-2.0, 2.0, (20, crooked.n)):
        J = pin.computeFrameJacobian(model, data, q, crooked.tip, pin.LOCAL_WORLD_ALIGNED)
        wrist, (found, J_found) = data.oMf[crooked.tip], crooked.wrist(q)
        np.testing.assert_allclose(found.R, base.R @ wrist.rotation, atol=1e-14)
        np.testing.assert_allclose(found.p, base.R @ wrist.translation + base.p, atol=1e-14)
        np.testing.assert_allclose(J_found[:3], base.R @ J[:3], atol=1e-14)
        np.testing.assert_allclose(J_found[3:], base.R @ J[3:], atol=1e-14)


def test_torques_of_a_motion_and_the_sensors_jacobian_are_pinocchios(crooked, rng):
    rotors, at = rng.uniform(0.1, 1.0, crooked.n), Pose.from_xyz_rpy((0.1, 0.2, 0.3), (1, 2, 3))
    dynamics = Dynamics(crooked, rotors, at)
    dynamics.carry(2.5, np.array([0.1, -0.05, 0.2]))
    data = crooked.model.createData()
    for q, dq, ddq in rng.uniform(-2.0, 2.0, (20, 3, crooked.n)):
        terms = dynamics.terms(q, dq)
        tau, J = dynamics.needed(q, dq, ddq)
        np.testing.assert_allclose(tau[1], terms.C @ dq + terms.g, atol=1e-11)
        np.testing.assert_allclose(tau[0] - tau[1], terms.M @ ddq, atol=1e-11)
        own = pin.computeFrameJacobian(crooked.model, data, q, crooked.tip, pin.LOCAL)
        expected = pin.SE3(at.R, at.p).inverse().action @ own
        np.testing.assert_allclose(J, expected, atol=1e-13)


def test_a_base_that_accelerates_is_as_another_gravity(crooked, rng):
    dynamics, a = Dynamics(crooked, np.zeros(crooked.n)), rng.normal(size=3)
    q, still = rng.uniform(-2.0, 2.0, crooked.n), np.zeros(crooked.n)
    dynamics.fall(-a)
    k = pin.Model(crooked.model)
    k.gravity.linear = -a
    expected = pin.computeGeneralizedGravity(k, k.createData(), q)
    np.testing.assert_allclose(dynamics.torque(q, still, still), expected, atol=1e-12)
