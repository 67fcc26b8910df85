"""Programs that tutorials begin from, against a real daemon."""

import numpy as np
import pytest
from laboratory.tutorials import demonstration, policy

pytestmark = pytest.mark.hil


def test_a_policy_and_a_stream_of_postures_lead_a_real_daemon(plant):
    operator = plant.enabled_operator("ann")
    plant.turn()
    before, q = np.array(plant.truth.pose_mrf[:3]), np.array(plant.truth.q)
    there = policy.observation(operator.wait_state())[:3] + np.array([0.0, 0.0, 0.03])
    policy.run(operator, policy.ReachPolicy(there), seconds=3.0)
    plant.turn()
    assert plant.truth.pose_mrf[2] - before[2] == pytest.approx(0.03, abs=5e-3)
    there = np.array(plant.truth.q)
    demonstration.run(operator, np.linspace(there, q, 20))
    plant.turn()
    assert np.abs(np.array(plant.truth.q) - q).max() < 2e-3
