"""Folding to a posture, a source and an objective beside all others (Williams 1997, eq. 7)."""

from collections.abc import Callable

import numpy as np
import pytest
from telerobot.server.control.inputs import Fold, JointFeedforward, ObjectiveGains

from ..conftest import Arm, Run

AWAY = np.array([0.3, 0.4, -0.2, -0.5, 0.3, -0.4, 0.2])


@pytest.fixture
def folding(pa10: Arm, start: Callable[..., Run]) -> Callable[..., Run]:
    """Return what makes an arm fold for some seconds, with gains of source and objective."""

    def run(seconds: float, source: float, objective: float, **inputs: object) -> Run:
        made = start(pa10)
        off = dict.fromkeys(pa10.p.redundancy.gains, 0.0)
        made.set(
            gains={**made.settings.gains, "reflex": np.full(6, source)},
            objectives=ObjectiveGains({**off, "reflex": objective}, made.q),
        )
        fold = JointFeedforward(Fold(made.q + AWAY, 0.3))
        made.go(seconds, beside=fold, at_posture=True, **inputs)
        return made

    return run


def test_source_and_objective_together_lead_the_joints_straight_to_the_posture(
    folding: Callable[..., Run],
) -> None:
    run = folding(6.0, 1.0, 1.0)
    np.testing.assert_allclose(run.memory.commanded.motion.q, run.q + AWAY, atol=1e-3)
    ways = (np.array(run.sent) - run.q) / AWAY
    assert np.ptp(ways, axis=1).max() < 5e-3  # in proportion
    shown = run.outputs[50]
    np.testing.assert_allclose(shown.twists["reflex"], shown.twist, atol=1e-12)
    assert np.linalg.norm(shown.twist[:3]) <= 0.3 + 1e-9
    run.observe()


def test_without_the_source_the_tool_stands_and_spare_joints_alone_fold(
    folding: Callable[..., Run],
) -> None:
    run = folding(1.0, 0.0, 1.0)
    assert np.abs(run.memory.commanded.motion.q - run.q).max() > 0.05
    pose = run.arm.mechanism.pose_wrist(run.q) @ run.settings.T_wrist_mrf
    np.testing.assert_allclose(run.pose.p, pose.p, atol=2e-3)
    np.testing.assert_allclose(run.pose.R, pose.R, atol=5e-3)


def test_without_the_objective_the_tool_goes_as_it_would_but_not_the_elbow(
    folding: Callable[..., Run],
) -> None:
    whole, tool = folding(0.5, 1.0, 1.0), folding(0.5, 1.0, 0.0)
    np.testing.assert_allclose(tool.pose.p, whole.pose.p, atol=0.02)
    assert np.abs(tool.memory.commanded.motion.q - whole.memory.commanded.motion.q).max() > 0.02


def test_a_stick_adds_to_folding(folding: Callable[..., Run], stick: Callable[..., object]) -> None:
    """dq = z + J⁺ẋ of the others: what the tool does is the sum of both."""
    run = folding(0.5, 1.0, 1.0, stick=stick(0.0, 0.0, 0.05, 0.0, 0.0, 0.0))
    output = run.outputs[-1]
    total = output.twists["reflex"] + output.twists["joystick"]
    np.testing.assert_allclose(output.twist, total, atol=1e-12)
    J = run.arm.mechanism.kinematics(run.sent[-2], run.settings.T_wrist_mrf).J
    np.testing.assert_allclose(J @ output.dq, total, atol=5e-3)
    run.observe()
