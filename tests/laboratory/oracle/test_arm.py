"""The oracle and the control know an arm by different means, and agree on it to rounding."""

from importlib import resources

import numpy as np
import pytest
from laboratory.oracle.arm import OracleArm
from laboratory.oracle.poses import difference
from telerobot.config.load import Cell, load_cell
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.proximity.capsules import Capsules
from telerobot.server.control.spatial import Pose

CELLS = sorted(
    path.name.removesuffix(".toml")
    for path in resources.files("telerobot").joinpath("config/cells").iterdir()
    if path.name.endswith(".toml")
)


def postures(cell: Cell) -> np.ndarray:
    low = np.array([joint.lower for joint in cell.robot.joints])
    high = np.array([joint.upper for joint in cell.robot.joints])
    return np.random.default_rng(4).uniform(low, high, (10, len(low)))


@pytest.mark.parametrize("name", CELLS)
def test_tool_and_jacobian_are_those_of_the_tick(name):
    cell = load_cell(name)
    T = cell.config.mechanism.T_wrist_mrf
    arm, mechanism, T_wrist_mrf = (
        OracleArm.of(cell),
        Mechanism.from_cell(cell),
        Pose.from_xyz_rpy(T.xyz, T.rpy),
    )
    for q in postures(cell):
        found, tool = mechanism.kinematics(q, T_wrist_mrf), arm.tool(q)
        np.testing.assert_allclose(found.T_world_mrf.R, tool[:3, :3], atol=1e-12)
        np.testing.assert_allclose(found.T_world_mrf.p, tool[:3, 3], atol=1e-12)
        # Wheels move the base, which is no function of them: `wheels/test_rolling.py` has these.
        wheels = len(cell.config.mechanism.wheels)
        np.testing.assert_allclose(found.J[:, wheels:], arm.jacobian(q)[:, wheels:], atol=1e-12)


@pytest.mark.parametrize("name", ["pa10", "ur5e", "ranger"])
def test_the_frames_that_capsules_are_fixed_to_are_the_oracles(name):
    cell = load_cell(name)
    arm, forest = OracleArm.of(cell), Capsules(cell).forest
    q = postures(cell)
    frames = forest.frames(q)
    expected = np.array([arm.frames(each) for each in q])
    for i, joint in enumerate(arm.joints):
        if joint.coordinate >= 0:
            found = frames[:, joint.coordinate]
            np.testing.assert_allclose(found, expected[:, i, :3], atol=1e-12)


@pytest.mark.parametrize("name", ["pa10", "ranger"])
def test_the_oracles_jacobian_is_the_slope_of_its_pose(name):
    cell, h = load_cell(name), 1e-6
    arm = OracleArm.of(cell)
    for q in postures(cell)[:3]:
        J = arm.jacobian(q)
        for i, aside in enumerate(h * np.eye(len(q))):
            slope = difference(arm.tool(q + aside), arm.tool(q - aside)) / (2 * h)
            np.testing.assert_allclose(J[:, i], slope, atol=1e-8)
