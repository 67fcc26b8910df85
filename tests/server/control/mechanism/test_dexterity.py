"""Objectives of singular values: slopes against finite differences, and self-motion uphill."""

import numpy as np
import pytest
from telerobot.config.schema.null_space import (
    OBJECTIVES,
    ObjectivesSection,
    RedundancySection,
)
from telerobot.server.control.inputs import ObjectiveGains
from telerobot.server.control.mechanism.objectives import (
    AlongDirection,
    Condition,
    LeastSingularValue,
)
from telerobot.server.control.spatial import Pose

from ..chains import CHAINS
from .shown import built, joints, shown

LENGTH = 0.3
E = np.array([1.0, -2.0, 2.0]) / 3.0
SECTION = RedundancySection(along_direction=(1.0, -2.0, 2.0))
KINDS = (LeastSingularValue, Condition, AlongDirection)
SWUNG = np.array([0.6, 0.0, -0.8, 0.0, 0.6, 0.2, 0.0])


def jacobian(arm, q):
    return arm.mechanism.kinematics(q, arm.settings.T_wrist_mrf).J


def view(arm, q):
    return shown(q, J=jacobian(arm, q), length=LENGTH)


def sigma(arm, q):
    weight = np.array([1.0] * 3 + [LENGTH] * 3)[:, None]
    return np.linalg.svd(weight * jacobian(arm, q), compute_uv=False)


@pytest.mark.parametrize("kind", KINDS)
def test_the_rates_are_the_slope_of_the_value(kind, arm, rng):
    objective, n, h = built(kind, arm.p.joints, arm.mechanism, SECTION), arm.p.n, 1e-6
    for _ in range(8):
        q = arm.random_posture(rng)
        slope = [
            (objective.value(view(arm, q + h * e)) - objective.value(view(arm, q - h * e)))
            / (2 * h)
            for e in np.eye(n)
        ]
        rates = objective.rate(view(arm, q))
        np.testing.assert_allclose(rates, slope, atol=1e-6 * max(1.0, np.abs(slope).max()))


def test_values_stand_for_those_of_the_singular_value_decomposition(arm, rng):
    least = built(LeastSingularValue, arm.p.joints, arm.mechanism)
    condition = built(Condition, arm.p.joints, arm.mechanism)
    along = built(AlongDirection, arm.p.joints, arm.mechanism, SECTION)
    for _ in range(20):
        q = arm.random_posture(rng)
        s, J = sigma(arm, q), jacobian(arm, q)
        assert 6 ** (-1 / 8) * s[-1] - 1e-12 <= least.value(view(arm, q)) <= s[-1] + 1e-12
        share = condition.value(view(arm, q)) / (s[-1] / s[0])
        assert 6 ** (-1 / 4) - 1e-9 <= share <= 1.0 + 1e-9
        # The quickest straight motion without turning, by least squares: joint rates that cost
        # their size, and what they miss of it costs as much at ρ = 0.1 m.
        weight = np.array([1.0] * 3 + [LENGTH] * 3)[:, None]
        rows = np.vstack([np.eye(arm.p.n), weight * J / 0.1])
        aim = np.concatenate([np.zeros(arm.p.n), E / 0.1, np.zeros(3)])
        rates = np.linalg.lstsq(rows, aim, rcond=None)[0]
        cost = np.linalg.norm(rows @ rates - aim)
        assert along.value(view(arm, q)) == pytest.approx(1.0 / cost, rel=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_where_two_singular_values_cross_the_slope_does_not_jump(kind, pa10, rng):
    """The least one's own slope does: it is that of another singular vector."""
    objective = built(kind, pa10.p.joints, pa10.mechanism)
    for _ in range(5):
        q = pa10.random_posture(rng)
        weight = np.array([1.0] * 3 + [LENGTH] * 3)[:, None]
        U, s, Vt = np.linalg.svd(weight * jacobian(pa10, q), full_matrices=False)
        rates = []
        for apart in (-1e-9, 1e-9):
            s[4:] = 0.1, 0.1 + apart
            rates.append(objective.rate(shown(q, J=(U * s) @ Vt / weight, length=LENGTH)))
        np.testing.assert_allclose(*rates, atol=1e-6 * np.abs(rates).max())


@pytest.mark.parametrize("kind", KINDS)
def test_of_a_planar_arm_count_the_axes_that_it_reaches(kind, rng):
    mechanism, _ = CHAINS["planar of five"]
    section = RedundancySection(along_direction=(1.0, -2.0, 0.0))
    objective, h = built(kind, joints(-np.ones(5), np.ones(5)), mechanism, section), 1e-6

    def value(q):
        J = mechanism.kinematics(q, Pose.identity()).J
        return objective.value(shown(q, J=J, length=LENGTH))

    q = rng.uniform(-1.0, 1.0, 5)
    slope = [(value(q + h * e) - value(q - h * e)) / (2 * h) for e in np.eye(5)]
    J = mechanism.kinematics(q, Pose.identity()).J
    assert value(q) > 0.01
    np.testing.assert_allclose(objective.rate(shown(q, J=J, length=LENGTH)), slope, atol=1e-6)


def test_a_direction_out_of_its_plane_asks_a_planar_arm_for_nothing(rng):
    mechanism, _ = CHAINS["planar of five"]
    objective = built(AlongDirection, joints(-np.ones(5), np.ones(5)), mechanism)
    q = rng.uniform(-1.0, 1.0, 5)
    J = mechanism.kinematics(q, Pose.identity()).J
    assert not objective.rate(shown(q, J=J, length=LENGTH)).any()


@pytest.mark.parametrize("name", ["sigma_min", "condition", "along"])
def test_spare_joints_climb_and_the_tool_stands(name, pa10, start):
    run = start(pa10, pa10.posture("ready") + SWUNG)
    kind = dict(zip(("sigma_min", "condition", "along"), KINDS, strict=True))[name]
    objective = built(kind, pa10.p.joints, pa10.mechanism)
    gains = dict.fromkeys(OBJECTIVES, 0.0) | {name: 20.0}
    run.set(objectives=ObjectiveGains(gains, pa10.posture("ready")))
    at, found = run.pose, [objective.value(view(pa10, run.sent[-1]))]
    for _ in range(5):
        run.go(1.0)
        found.append(objective.value(view(pa10, run.sent[-1])))
    assert (np.diff(found) > -1e-7).all()
    assert found[-1] > 1.01 * found[0]
    assert np.linalg.norm(run.pose.p - at.p) < 2e-3
    run.observe()


@pytest.mark.parametrize("name", ["holding_torque", "sigma_min", "condition", "along"])
def test_at_twice_the_greatest_gain_the_arm_comes_to_rest_and_does_not_rattle(
    name, pa10, start, rng
):
    """Beside singularities, and where singular values cross, a slope that is too steep rattles."""
    greatest = next(m.le for m in ObjectivesSection.model_fields[name].metadata if hasattr(m, "le"))
    for q in pa10.posture("ready") + rng.uniform(-0.8, 0.8, (6, 7)):
        run = start(pa10, q)
        gains = dict.fromkeys(OBJECTIVES, 0.0) | {name: 2.0 * greatest}
        run.set(objectives=ObjectiveGains(gains, q))
        run.go(4.0)
        late = np.diff(run.sent[-100:], axis=0) / pa10.p.period_s
        turns = np.abs(np.diff(np.sign(np.where(np.abs(late) > 1e-3, late, 0.0)), axis=0)) == 2
        assert not turns.any()
        run.observe()
