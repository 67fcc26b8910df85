"""What holds for every redundancy objective in the table."""

import numpy as np
import pytest
from telerobot.config.schema.null_space import OBJECTIVES
from telerobot.server.control.mechanism.objectives import KINDS

from .shown import built, shown


def test_every_gain_has_its_objective_in_the_order_of_the_sum():
    assert tuple(KINDS) == OBJECTIVES


@pytest.mark.parametrize("name", OBJECTIVES)
def test_it_asks_for_rates_of_all_joints_and_for_the_same_ones_again(name, pa10, rng):
    objective = built(KINDS[name], pa10.p.joints, pa10.mechanism)
    for _ in range(5):
        q = pa10.random_posture(rng)
        J = pa10.mechanism.kinematics(q, pa10.settings.T_wrist_mrf).J
        dq, null = rng.normal(size=7), np.linalg.svd(J)[2][6:]
        view = shown(q, J=J, dq_task=dq, null=null, posture=pa10.posture("ready"))
        rates = objective.rate(view)
        assert rates.shape == (7,)
        assert np.isfinite(rates).all()
        np.testing.assert_array_equal(rates, objective.rate(view))
