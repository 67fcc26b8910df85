from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.load import altered
from telerobot.config.schema import cell as schema
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.spatial import Pose

STEP = 1e-6


def based_at(cell, T_world_base):
    """The cell's mechanism with its Base elsewhere in World."""
    x, y, z, *rpy = T_world_base.to_xyz_rpy()
    base = schema.PoseSection(xyz=(x, y, z), rpy=tuple(rpy))
    return Mechanism.from_cell(altered(cell, {"mechanism.T_world_base": base}))


def test_the_jacobian_is_the_derivative_of_the_pose(arm, rng, random_pose):
    for _ in range(25):
        mechanism, T_wrist_mrf = based_at(arm.cell, random_pose()), random_pose(0.4)
        q = arm.random_posture(rng)
        J = mechanism.kinematics(q, T_wrist_mrf).J
        for i, step in enumerate(STEP * np.eye(arm.p.n)):
            before = mechanism.kinematics(q - step, T_wrist_mrf).T_world_mrf
            after = mechanism.kinematics(q + step, T_wrist_mrf).T_world_mrf
            v = (after.p - before.p) / (2 * STEP)
            w = pin.log3(after.R @ before.R.T) / (2 * STEP)
            np.testing.assert_allclose(J[:, i], [*v, *w], atol=2e-8)


def test_the_pa10_reaches_where_its_data_sheet_says(pa10):
    q = np.array([0, np.pi / 4, 0, np.pi / 2, 0, -np.pi / 4, 0])
    hand = pa10.mechanism.kinematics(q, Pose(np.eye(3), np.array([0, 0, 0.121]))).T_world_mrf
    # 0.45 m of upper arm and 0.5 m of forearm, each at 45 degrees, then 0.08 + 0.121 m level.
    np.testing.assert_allclose(hand.p, [0.872751, 0.0, 0.279645], atol=1e-6)
    np.testing.assert_allclose(hand.R @ [0, 0, 1], [1, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "at"), [("pa10", (0.70, 0.0, 0.40)), ("ur5e", (0.55, 0.13, 0.45))]
)
def test_ready_is_level_and_where_the_cell_file_says(name, at, request):
    arm = request.getfixturevalue(name)
    ready = arm.mechanism.kinematics(arm.posture("ready"), arm.settings.T_wrist_mrf).T_world_mrf
    np.testing.assert_allclose(ready.p, at, atol=2e-3)
    np.testing.assert_allclose(ready.R @ [0, 0, 1], [1, 0, 0], atol=5e-3)


def test_the_mrf_hangs_on_the_wrist_and_the_wrist_on_the_base(arm, rng, random_pose):
    T_world_base, T_wrist_mrf, q = random_pose(), random_pose(), arm.random_posture(rng)
    moved = based_at(arm.cell, T_world_base)
    wrist = arm.mechanism.pose_wrist(q)
    k = moved.kinematics(q, T_wrist_mrf)
    for found, expected in (
        (k.T_world_wrist, T_world_base @ wrist),
        (moved.pose_wrist(q), T_world_base @ wrist),
        (k.T_world_mrf, T_world_base @ wrist @ T_wrist_mrf),
    ):
        np.testing.assert_allclose(found.R, expected.R, atol=1e-12)
        np.testing.assert_allclose(found.p, expected.p, atol=1e-12)


def test_answers_stay_what_they_were_when_others_are_asked_for(arm, rng):
    mechanism, T = arm.mechanism, arm.settings.T_wrist_mrf
    first = mechanism.kinematics(arm.posture("ready"), T)
    kept = [a.copy() for a in (first.J, *first.T_world_mrf, *first.T_world_wrist)]
    mechanism.kinematics(arm.random_posture(rng), T)
    for now, before in zip((first.J, *first.T_world_mrf, *first.T_world_wrist), kept, strict=True):
        np.testing.assert_array_equal(now, before)


def test_joints_in_another_order_than_the_chains_are_refused(arm):
    robot = replace(arm.cell.robot, joints=arm.cell.robot.joints[::-1])
    with pytest.raises(ConfigError, match="in order"):
        Mechanism.from_cell(replace(arm.cell, robot=robot))
