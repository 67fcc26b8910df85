"""The momentum observer against a torque that only the plant knows."""

import math

import numpy as np
import pinocchio as pin
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.dynamics import Dynamics
from telerobot.server.control.mechanism import Mechanism
from telerobot.server.control.momentum import MomentumState, begin, corrected, observe

T = 0.01
K = 10.0
UNKNOWN = np.array([5.0, -8.0, 2.0, 3.0, -0.5, 0.4, 0.2])


@pytest.fixture(scope="module")
def mechanism():
    return Mechanism.from_cell(load_cell("pa10_hand"))


def fall(mechanism, unknown, seconds):
    """Let the arm fall under damping, known, and `unknown` (n,); return residuals (k, n)."""
    dynamics, model = Dynamics(mechanism, np.full(7, 0.4)), pin.Model(mechanism.model)
    model.armature = np.full(7, 0.4)
    data = model.createData()
    q, dq = np.array([0.1, 0.6, -0.2, 1.4, 0.3, -0.7, 0.2]), np.zeros(7)
    state, found, steps = begin(np.zeros(7)), [], 100
    for _ in range(round(seconds / T)):
        known = np.zeros(7)
        for _ in range(steps):
            tau = -20.0 * dq + 0.9 * pin.computeGeneralizedGravity(model, data, q).copy()
            known += (tau + dynamics.terms(q, dq).drift) / steps
            dq = dq + T / steps * pin.aba(model, data, q, dq, tau + unknown)
            q = q + T / steps * dq
        state = observe(state, dynamics.terms(q, dq).M @ dq, known, K, T)
        found.append(state.residual)
    return np.array(found)


def test_the_residual_follows_an_unknown_torque_as_a_first_order_filter(mechanism) -> None:
    found = fall(mechanism, UNKNOWN, 0.5)
    t = T * np.arange(1, len(found) + 1)
    expected = UNKNOWN * (1.0 - np.exp(-math.log1p(K * T) / T * t))[:, None]
    np.testing.assert_allclose(found, expected, atol=0.03)
    np.testing.assert_allclose(found[-1], UNKNOWN, rtol=0.02, atol=0.02)


def test_an_arm_that_does_what_is_known_of_it_is_suspected_of_nothing(mechanism) -> None:
    assert np.abs(fall(mechanism, np.zeros(7), 0.3)).max() < 0.03


def test_a_corrected_residual_is_gone_on_from() -> None:
    momentum, known = np.array([0.3]), np.array([2.0])
    state = observe(begin(np.zeros(1)), momentum, known, K, T)
    other = corrected(momentum, np.array([1.5]), K)
    assert other.residual[0] == 1.5
    # the momentum grows as known torque and residual say: nothing new is learnt
    on = observe(other, momentum + T * (known + 1.5), known, K, T)
    assert on.residual[0] == pytest.approx(1.5)
    same = corrected(momentum, state.residual, K)
    assert same.expected[0] == pytest.approx(state.expected[0])


def test_a_quick_observer_stays_stable_where_an_explicit_one_would_not() -> None:
    state = MomentumState(np.zeros(1), np.zeros(1))
    for _ in range(200):
        state = observe(state, np.array([1.0]), np.zeros(1), 1e4, T)
        assert abs(float(state.residual[0])) <= 1.0 / T
    assert abs(float(state.residual[0])) < 1e-3
