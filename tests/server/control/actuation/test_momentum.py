"""The momentum observer against a torque that only the plant knows, and what it foresees."""

import math
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.actuation.momentum import Foreseen, observed, predict, to_expect
from telerobot.server.control.mechanism.model import Dynamics, Mechanism

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
    expected, found, steps = np.zeros(7), [], 100
    for _ in range(round(seconds / T)):
        known = np.zeros(7)
        for _ in range(steps):
            tau = -20.0 * dq + 0.9 * pin.computeGeneralizedGravity(model, data, q).copy()
            terms = dynamics.terms(q, dq)
            known += (tau + terms.C.T @ dq - terms.g) / steps
            dq = dq + T / steps * pin.aba(model, data, q, dq, tau + unknown)
            q = q + T / steps * dq
        momentum = dynamics.terms(q, dq).M @ dq
        found.append(observed(expected, momentum, known, K, T))
        expected = to_expect(momentum, found[-1], K)
    return np.array(found)


def test_the_residual_follows_an_unknown_torque_as_a_first_order_filter(mechanism) -> None:
    found = fall(mechanism, UNKNOWN, 0.5)
    t = T * np.arange(1, len(found) + 1)
    expected = UNKNOWN * (1.0 - np.exp(-math.log1p(K * T) / T * t))[:, None]
    np.testing.assert_allclose(found, expected, atol=0.03)
    np.testing.assert_allclose(found[-1], UNKNOWN, rtol=0.02, atol=0.02)


def test_an_arm_that_does_what_is_known_of_it_is_suspected_of_nothing(mechanism) -> None:
    assert np.abs(fall(mechanism, np.zeros(7), 0.3)).max() < 0.03


def test_another_residual_is_gone_on_from() -> None:
    momentum, known, other = np.array([0.3]), np.array([2.0]), np.array([1.5])
    # the momentum grows as known torque and residual say: nothing new is learnt
    grown = momentum + T * (known + other)
    assert observed(to_expect(momentum, other, K), grown, known, K, T) == pytest.approx(1.5)
    # what was found is expected to have made the momentum what it is
    residual = observed(np.zeros(1), momentum, known, K, T)
    assert to_expect(momentum, residual, K) == pytest.approx(T * (known + residual))


def test_a_quick_observer_stays_stable_where_an_explicit_one_would_not() -> None:
    expected, momentum, known = np.zeros(1), np.array([1.0]), np.zeros(1)
    for _ in range(200):
        residual = observed(expected, momentum, known, 1e4, T)
        expected = to_expect(momentum, residual, 1e4)
        assert abs(float(residual[0])) <= 1.0 / T
    assert abs(float(residual[0])) < 1e-3


LEAD, SPEED, TRUST, SHARE = 2.0, 0.01, 0.8, 0.9


@pytest.fixture
def seen(mechanism, rng):
    """Return by name what an arm in motion tells `predict`, in its order."""
    q, rate = rng.uniform(-1.5, 1.5, 7), rng.normal(0.0, 0.3, 7)
    terms = Dynamics(mechanism, np.full(7, 0.4)).terms(q, rate)
    return {
        **dict(zip(("M", "C", "g", "J"), terms, strict=True)),
        "wrench": rng.normal(0.0, 5.0, 6),
        "left_out": rng.normal(0.0, 2.0, 6),
        "q": q,
        "rate": rate,
        "rate_foreseen": rate + rng.normal(0.0, 0.02, 7),
        "acting": rng.normal(0.0, 20.0, 7),
        "acted": rng.normal(0.0, 20.0, 7),
        "expected": terms.M @ rate,
        "residual": rng.normal(0.0, 3.0, 7),
        "q_command": q + rng.normal(0.0, 1e-3, 7),
        "dq_command": rng.normal(0.0, 5e-3, 7),
        "friction": rng.uniform(0.5, 4.0, 7),
        "authority": np.array([40.0, 40.0, 20.0, 0.5, 0.5, 0.5, 0.5]),
    }


def look(seen, bandwidth=K, settled=False):
    return predict(*seen.values(), T, TRUST, bandwidth, LEAD, SPEED, SHARE, settled)


def written_out(seen, bandwidth, settled):
    """Return what `predict` does, in matrices."""
    s = SimpleNamespace(**seen)

    def heading(q):
        return np.tanh((s.dq_command + LEAD * (s.q_command - q)) / SPEED)

    inverse, felt, h = np.linalg.inv(s.M), s.J.T @ s.wrench, s.C @ s.rate + s.g
    dq = s.rate + 0.5 * T * inverse @ (s.acted + felt + s.residual - h)
    dq = (1.0 - TRUST) * s.rate_foreseen + TRUST * dq
    p, found = s.M @ dq, np.zeros(7)
    if bandwidth > 0.0 and not settled:
        known = s.acted + felt + s.C.T @ s.rate - s.g
        found = (p - s.expected - T * known) / (1.0 / bandwidth + T)
        band = s.friction * (1.0 - np.abs(heading(s.q))) ** 4
        found = found - np.clip(found, -band, band)
    expected = p - found / bandwidth if bandwidth > 0.0 else p
    ddq = inverse @ (s.acting + felt + found - h)
    q_next = s.q + T * dq + 0.5 * T**2 * ddq
    ends = np.array([np.zeros(7), -felt, s.J.T @ s.left_out])
    answered = np.clip(found, ends.min(axis=0) - s.authority, ends.max(axis=0) + s.authority)
    answer, beyond = -SHARE * felt - answered, found != answered
    rubbing = s.friction * heading(q_next)
    return Foreseen(inverse, q_next, dq + T * ddq, expected, found, answer, rubbing, beyond)


@pytest.mark.parametrize(("bandwidth", "settled"), [(K, False), (K, True), (0.0, False)])
def test_the_state_foreseen_is_that_of_the_equations(seen, bandwidth, settled) -> None:
    found = look(seen, bandwidth, settled)
    for part, expected in zip(found, written_out(seen, bandwidth, settled), strict=True):
        np.testing.assert_allclose(part, expected, rtol=1e-9, atol=1e-11)


def test_the_joints_foreseen_are_where_a_finely_integrated_arm_is(mechanism, seen) -> None:
    model = pin.Model(mechanism.model)
    model.armature = np.full(7, 0.4)
    data = model.createData()
    seen["rate_foreseen"] = seen["rate"]
    seen["acted"] = seen["C"] @ seen["rate"] + seen["g"] - seen["J"].T @ seen["wrench"]
    seen["residual"] = np.zeros(7)  # so that the rate was steady until now
    q, dq, felt = seen["q"], seen["rate"], seen["J"].T @ seen["wrench"]
    for _ in range(1000):
        ddq = pin.aba(model, data, q, dq, seen["acting"] + felt)
        q, dq = q + T / 1000 * dq, dq + T / 1000 * ddq
    found = look(seen, bandwidth=0.0)
    np.testing.assert_allclose(found.q, q, atol=2e-4)
    np.testing.assert_allclose(found.dq, dq, atol=0.05 * np.abs(dq - seen["rate"]).max())


@pytest.mark.parametrize("name", ["wrench", "rate", "residual"])
def test_what_is_no_number_is_not_bounded_away(seen, name) -> None:
    seen[name] = np.full_like(seen[name], np.nan)
    assert not np.isfinite(look(seen).answer).any()
