"""Base and arm as one mechanism: their manipulability, and its slope."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.mechanism.potentials import manipulability_slope
from telerobot.server.control.spatial import Pose
from telerobot.server.control.wheels import Rolled

HERE = Pose.identity()


def manipulability(mechanism, q, base=HERE):
    J = mechanism.kinematics(q, HERE, base).J
    return float(np.sqrt(np.linalg.det(J @ J.T)))


def test_the_slope_of_the_whole_robots_manipulability_is_the_arms_and_wheels_change_none(rng):
    mechanism = Mechanism.from_cell(load_cell("rover"))
    for _ in range(10):
        q = np.concatenate((np.zeros(2), rng.uniform(-1.5, 1.5, mechanism.n - 2)))
        slope = manipulability_slope(mechanism.kinematics(q, HERE, HERE).J, 6, None)[1]
        for j in range(2, mechanism.n):
            step = 1e-6 * np.eye(mechanism.n)[j]
            ahead, back = manipulability(mechanism, q + step), manipulability(mechanism, q - step)
            assert slope[j] == pytest.approx((ahead - back) / 2e-6, abs=1e-7)
        driven = mechanism.rolling.roll(Rolled.at(HERE, np.zeros(2)), np.array([0.7, 0.2]))
        there = manipulability(mechanism, q, Pose(driven.R, driven.p))
        assert there == pytest.approx(manipulability(mechanism, q), rel=1e-9)
