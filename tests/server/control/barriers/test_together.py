"""Two tools on one payload: what holds one up slows or slides both, and pulls nothing apart."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.barriers.programme import nearest
from telerobot.server.control.barriers.together import PayloadLink
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.spatial import Pose

V = np.array([0.9, 0.9, 1.8, 1.8, 3.0, 3.0, 3.0] * 2)
TOOL = np.repeat([0, 1], 7)
UP = np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def arms():
    """Return both tools' Jacobians, side by side: (6, 14)."""
    cell = load_cell("pa10")
    arm, found = Mechanism.from_cell(cell), []
    for shift, y in ((0.0, -0.55), (0.15, 0.55)):
        q = np.array([shift, 0.17, 0.0, 1.72, 0.0, 1.25, 0.0])
        found.append(arm.kinematics(q, Pose(np.eye(3), np.array([0.0, y, 0.121]))).J)
    return np.concatenate(found, axis=1)


def asked(J, first, second):
    """Return joint rates (14,) for the twists (6,) of both."""
    return np.concatenate([np.linalg.pinv(J[:, :7]) @ first, np.linalg.pinv(J[:, 7:]) @ second])


def relative(J, dq):
    return np.abs(J[:, :7] @ dq[:7] - J[:, 7:] @ dq[7:]).max()


def at_a_limit(joint):
    """Return bounds of rates where a joint may not go on."""
    low, high = -V, V.copy()
    high[joint] = 0.0
    low = low.copy()
    low[joint] = 0.0
    return low, high


@pytest.mark.parametrize("joint", [1, 3, 5, 8, 10])
def test_a_joint_at_its_limit_does_not_pull_the_payload_apart(arms, joint):
    dq = asked(arms, UP, UP)
    low, high = at_a_limit(joint)
    link = PayloadLink(np.array([0, 1]), np.zeros((2, 6)))
    alone = nearest(dq, arms, low, high, V, 0.3, None, TOOL)
    held = nearest(dq, arms, low, high, V, 0.3, None, TOOL, (link,))
    assert relative(arms, held.dq) < 1e-4
    assert relative(arms, alone.dq) > 20 * relative(arms, held.dq)
    assert held.pace[0] == held.pace[1]


def test_what_force_control_asks_for_beside_is_kept(arms):
    apart = np.array([[0, 0.01, 0, 0, 0, 0], [0, -0.01, 0, 0, 0, 0.0]])
    dq = asked(arms, UP + apart[0], UP + apart[1])
    low, high = at_a_limit(3)
    found = nearest(
        dq, arms, low, high, V, 0.3, None, TOOL, (PayloadLink(np.array([0, 1]), apart),)
    )
    way = arms[:, :7] @ found.dq[:7] - arms[:, 7:] @ found.dq[7:]
    assert way[1] == pytest.approx(0.02, abs=1e-3)
