"""Relief from weight: the slope against finite differences, and what the arm makes of it."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from telerobot.server.control.inputs import ObjectiveGains
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.mechanism.objectives import GravityTorque
from telerobot.server.control.spatial import Pose, rotation_rpy

from .shown import built, shown

HUNG = Pose(rotation_rpy(np.pi / 2, 0.3, 0.0), np.array([0.1, 0.2, 0.3]))


def weight(model, q):
    """Return the torques (n,) that hold an arm still, by the recursion of Newton and Euler."""
    return pin.rnea(model, model.createData(), q, np.zeros(len(q)), np.zeros(len(q)))


def mounted(arm, T_world_base):
    m = arm.cell.config.mechanism
    return Mechanism(arm.cell.robot.description(), arm.p.joints.names, m.tip_link, T_world_base)


@pytest.mark.parametrize("base", [Pose.identity(), HUNG])
def test_it_goes_downhill_in_the_square_of_gravity_torques_however_base_is_mounted(arm, rng, base):
    mechanism = mounted(arm, base)
    model = pin.Model(mechanism.model)
    model.gravity.linear = base.R.T @ np.array([0.0, 0.0, -9.81])
    objective, n, h = built(GravityTorque, arm.p.joints, mechanism), arm.p.n, 1e-5
    for _ in range(5):
        q = arm.random_posture(rng)
        slope = np.empty(n)
        for i in range(n):
            ahead, behind = (weight(model, q + s * h * np.eye(n)[i]) for s in (1.0, -1.0))
            slope[i] = 0.5 * (ahead @ ahead - behind @ behind) / (2 * h)
        rates = objective.rate(shown(q))
        # Equal but for one positive factor, which says that a gain of 1 moves at about 1 rad/s.
        np.testing.assert_allclose(
            rates / np.linalg.norm(rates), -slope / np.linalg.norm(slope), atol=1e-6
        )
        assert 1e-3 < np.linalg.norm(rates) < 3.0


def test_an_arm_without_weight_asks_for_nothing(pa10, rng):
    mechanism = mounted(pa10, Pose.identity())
    mechanism.model.gravity.linear = np.zeros(3)
    objective = built(GravityTorque, pa10.p.joints, mechanism)
    assert not objective.rate(shown(pa10.random_posture(rng))).any()


def test_spare_joints_take_weight_off_the_joints_and_the_tool_stands(pa10, start):
    swung = pa10.posture("ready") + np.array([0.3, 0.0, -0.4, 0.0, 0.3, 0.1, 0.0])
    run = start(pa10, swung)
    gains = dict.fromkeys(pa10.p.redundancy.gains, 0.0) | {"gravity_torque": 2.0}
    run.settings = replace(run.settings, objectives=ObjectiveGains(gains, pa10.posture("ready")))
    at = run.pose
    loads = [np.linalg.norm(weight(pa10.mechanism.model, run.sent[-1]))]
    for _ in range(6):
        run.go(1.0)
        loads.append(np.linalg.norm(weight(pa10.mechanism.model, run.sent[-1])))
    assert (np.diff(loads) < 1e-6).all()
    assert loads[-1] < 0.99 * loads[0]
    assert np.linalg.norm(run.pose.p - at.p) < 2e-3
    assert run.outputs[-1].found.self_motion.norms.keys() == {"gravity_torque"}
    run.observe()
