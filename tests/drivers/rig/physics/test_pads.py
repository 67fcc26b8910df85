"""The pads' springs against the same by numpy and MuJoCo's quaternions."""

import mujoco
import numpy as np
import pytest
from telerobot.drivers.rig.physics.beam import pull_pads

GAINS = np.array([5e4, 1e3, 200.0, 1.0])


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def attitude(rng, most):
    R, axis = np.zeros(9), rng.normal(size=3)
    quat = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quat, axis / np.linalg.norm(axis), rng.uniform(-most, most))
    mujoco.mju_quat2Mat(R, quat)
    return R.reshape(3, 3)


@pytest.mark.parametrize("turned", [0.0, 1e-7, 0.01, 2.0])
def test_they_pull_as_springs_of_six_freedoms_and_by_equal_and_opposite_wrenches(rng, turned):
    xpos, xipos = rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    R = [attitude(rng, 3.0) for _ in range(4)]
    bodies, twists = np.array([2, 1, 3]), rng.normal(size=(3, 6))
    p_tip, p = rng.normal(size=(2, 3)), rng.normal(size=(2, 3))
    R_tip = np.array([attitude(rng, 3.0) for _ in range(2)])
    held = [R[2].T @ R[tip] @ R_tip[i] for i, tip in enumerate(bodies[1:])]
    R_pad = np.array([attitude(rng, turned).T @ each for each in held])
    wrenches, apart, forces = np.zeros((2, 6)), np.zeros((2, 3)), np.zeros((4, 6))
    pull_pads(
        (xpos, np.array([each.ravel() for each in R]), xipos), bodies, twists, (p_tip, R_tip),
        (p, R_pad, np.array([1.0, 1.0])), GAINS, wrenches, apart, forces,
    )  # fmt: skip
    total = np.zeros((4, 6))
    for i, tip in enumerate(bodies[1:]):
        at = xpos[2] + R[2] @ p[i]
        off = R[2].T @ (xpos[tip] + R[tip] @ p_tip[i] - xpos[2]) - p[i]
        quat, turn = np.zeros(4), np.zeros(3)
        mujoco.mju_mat2Quat(quat, (held[i] @ R_pad[i].T).ravel())
        mujoco.mju_quat2Vel(turn, quat, 1.0)
        rates = [
            twist[3:] + np.cross(twist[:3], at - xipos[body])
            for twist, body in ((twists[i + 1], tip), (twists[0], 2))
        ]
        force = GAINS[0] * off + GAINS[2] * R[2].T @ (rates[0] - rates[1])
        moment = GAINS[1] * turn + GAINS[3] * R[2].T @ (twists[i + 1, :3] - twists[0, :3])
        np.testing.assert_allclose(apart[i], off, atol=1e-12)
        np.testing.assert_allclose(wrenches[i], [*force, *moment], rtol=1e-9, atol=1e-6)
        for sign, body in ((1.0, 2), (-1.0, tip)):
            f, m = R[2] @ force, R[2] @ moment
            total[body] += sign * np.concatenate([f, m + np.cross(at - xipos[body], f)])
    np.testing.assert_allclose(forces, total, rtol=1e-9, atol=1e-6)


def test_an_open_pad_pulls_at_nothing(rng):
    wrenches, apart, forces = np.ones((1, 6)), np.zeros((1, 3)), np.zeros((2, 6))
    eye = np.eye(3)
    pull_pads(
        (rng.normal(size=(2, 3)), np.tile(eye.ravel(), (2, 1)), np.zeros((2, 3))),
        np.array([0, 1]), rng.normal(size=(2, 6)), (np.zeros((1, 3)), eye[None]),
        (np.zeros((1, 3)), eye[None], np.zeros(1)), GAINS, wrenches, apart, forces,
    )  # fmt: skip
    assert not wrenches.any()
    assert not forces.any()
