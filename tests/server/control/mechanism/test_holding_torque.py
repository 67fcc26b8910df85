"""Relief of the drives from arm and payload: the slope against finite differences."""

import numpy as np
import pinocchio as pin
import pytest
from telerobot.server.control.inputs import Payload
from telerobot.server.control.mechanism.model import Dynamics
from telerobot.server.control.mechanism.objectives import HoldingTorque

from .shown import built, shown

NONE, HEAVY = Payload(0.0, np.zeros(3)), Payload(7.0, np.array([0.08, -0.03, 0.11]))


def hung(mechanism, payload):
    """Return a model that carries a payload at its Wrist, in place of the URDF's tool."""
    dynamics = Dynamics(mechanism, np.zeros(mechanism.n))
    dynamics.carry(payload.mass, payload.com)
    return dynamics


def load(arm, dynamics, q):
    """Return the sum of squared holding torques over the ratings, by Newton and Euler."""
    torque = dynamics.torque(q, np.zeros(len(q)), np.zeros(len(q)))
    return 0.5 * float(((torque / arm.p.joints.rated_torque) ** 2).sum())


@pytest.mark.parametrize("payload", [NONE, HEAVY])
def test_it_goes_downhill_in_squared_torques_over_ratings_with_what_is_carried(arm, rng, payload):
    objective = built(HoldingTorque, arm.p.joints, arm.mechanism)
    dynamics, n, h = hung(arm.mechanism, payload), arm.p.n, 1e-5
    for _ in range(5):
        q = arm.random_posture(rng)
        slope = np.empty(n)
        for i in range(n):
            ahead, behind = (load(arm, dynamics, q + s * h * np.eye(n)[i]) for s in (1.0, -1.0))
            slope[i] = (ahead - behind) / (2 * h)
        rates = objective.rate(shown(q, payload=payload))
        np.testing.assert_allclose(
            rates / np.linalg.norm(rates), -slope / np.linalg.norm(slope), atol=1e-6
        )
        assert 1e-3 < np.linalg.norm(rates) < 30.0


def test_a_payload_is_as_heavy_as_an_independent_model_has_it(pa10, rng):
    """An arm without masses of its own holds the payload alone."""
    q, at = pa10.random_posture(rng), np.zeros(7)
    model = pin.Model(pa10.mechanism.model)
    frame = model.frames[pa10.mechanism.tip]
    bare = hung(pa10.mechanism, NONE).torque(q, at, at)
    for i in range(1, model.njoints - 1):
        model.inertias[i] = pin.Inertia.Zero()
    model.inertias[frame.parentJoint] = pin.Inertia(
        HEAVY.mass, frame.placement.act(HEAVY.com), np.zeros((3, 3))
    )
    alone = pin.rnea(model, model.createData(), q, at, at)
    both = hung(pa10.mechanism, HEAVY).torque(q, at, at)
    np.testing.assert_allclose(both - bare, alone, atol=1e-9)


def test_joints_that_are_rated_higher_are_relieved_less(pa10, rng):
    strong = pa10.p.joints._replace(rated_torque=1e6 * np.eye(7)[1] + np.ones(7))
    weak = pa10.p.joints._replace(rated_torque=np.ones(7))
    dynamics, q = hung(pa10.mechanism, HEAVY), pa10.random_posture(rng)
    _, slope = dynamics.gravity(q)
    view = shown(q, payload=HEAVY)
    shares = []
    for joints in (strong, weak):
        rates = built(HoldingTorque, joints, pa10.mechanism).rate(view)
        parts = np.linalg.lstsq(slope.T, rates, rcond=None)[0]  # of each joint's torque
        shares.append(abs(parts[1]) / np.linalg.norm(parts))
    assert shares[0] < 1e-6 < 1e-2 < shares[1]
