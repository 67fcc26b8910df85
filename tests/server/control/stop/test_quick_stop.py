"""Ramps of a quick stop by which joints come to rest together."""

import numpy as np
import pytest
from telerobot.server.control.stop.profile import ramps_in_proportion

OWN = np.array([10.0, 15.0, 25.0, 25.0])
SPREAD = np.full(4, 0.02)


def test_joints_come_to_rest_when_the_slowest_does_by_its_own_ramp():
    dq = np.array([0.5, -0.3, 0.1, 0.04])
    ramps = ramps_in_proportion(dq, OWN, SPREAD)
    np.testing.assert_allclose(np.abs(dq) / ramps, 0.05)
    assert ramps[0] == OWN[0]


def test_no_ramp_is_steeper_than_the_drives_own_or_too_gentle_for_a_joint_that_goes_faster():
    rng = np.random.default_rng(1)
    for _ in range(200):
        dq = rng.normal(0.0, 0.5, 4) * (rng.random(4) < 0.7)
        ramps = ramps_in_proportion(dq, OWN, SPREAD)
        assert (ramps <= OWN).all()
        takes_s = (np.abs(dq) / OWN).max()
        assert ((np.abs(dq) + SPREAD) / ramps <= 2.0 * max(takes_s, (SPREAD / OWN).max())).all()


def test_joints_at_rest_keep_their_own_ramps():
    assert ramps_in_proportion(np.zeros(4), OWN, SPREAD) == pytest.approx(OWN)
