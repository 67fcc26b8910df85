"""Dynamics of the arm against finite differences of its own kinematics and energy."""

import numpy as np
import pinocchio as pin
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.mechanism.model import Dynamics, Mechanism
from telerobot.server.control.spatial import Pose

ROTORS = np.array([1.5, 1.5, 0.8, 0.8, 0.15, 0.15, 0.1])
TILTED = Pose.from_xyz_rpy((0.4, 0.2, 0.1), (0.3, -0.2, 1.0))


@pytest.fixture(params=[Pose.identity(), TILTED], ids=["upright", "tilted"])
def arm(request):
    cell = load_cell("pa10_hand")
    joints = tuple(j.name for j in cell.robot.joints)
    mechanism = Mechanism(cell.robot.description(), joints, "flange", request.param)
    return mechanism, Dynamics(mechanism, ROTORS)


def states(n):
    rng = np.random.default_rng(3)
    return [(rng.uniform(-1.5, 1.5, 7), rng.uniform(-1, 1, 7)) for _ in range(n)]


def test_speed_and_gravity_together_are_what_keeps_joints_from_accelerating(arm) -> None:
    _, dynamics = arm
    for q, dq in states(10):
        terms = dynamics.terms(q, dq)
        np.testing.assert_allclose(terms.C @ dq + terms.g, dynamics.bias(q, dq), atol=1e-11)


def test_the_wrists_jacobian_in_its_own_axes_is_the_one_in_world_turned(arm) -> None:
    mechanism, dynamics = arm
    for q, dq in states(10):
        k = mechanism.kinematics(q, Pose.identity())
        in_world = k.T_world_wrist.R @ dynamics.terms(q, dq).J_wrist.reshape(2, 3, 7)
        np.testing.assert_allclose(in_world.reshape(6, 7), k.J, atol=1e-12)


def test_gravity_is_the_slope_of_the_potential_energy_in_world(arm) -> None:
    mechanism, dynamics = arm
    model = mechanism.model
    data = model.createData()
    down = TILTED if not np.array_equal(mechanism.T_world_base.R, np.eye(3)) else Pose.identity()
    mass = sum(i.mass for i in model.inertias[1:])

    def energy(q):
        height = (down.R @ pin.centerOfMass(model, data, q))[2]
        return 9.81 * mass * height

    for q, _ in states(5):
        slope = [(energy(q + e) - energy(q - e)) / 2e-6 for e in 1e-6 * np.eye(mechanism.n)]
        np.testing.assert_allclose(dynamics.bias(q, np.zeros(7)), slope, atol=1e-5)


def test_momentum_changes_by_torque_and_drift(arm) -> None:
    _, dynamics = arm
    h = 1e-6
    tau = np.array([3.0, -5.0, 1.0, 2.0, 0.3, -0.2, 0.1])
    for q, dq in states(5):
        terms = dynamics.terms(q, dq)
        ddq = np.linalg.solve(terms.M, tau - dynamics.bias(q, dq))
        momentum = [dynamics.terms(q + s * h * dq, dq).M @ (dq + s * h * ddq) for s in (-1.0, 1.0)]
        change = (momentum[1] - momentum[0]) / (2 * h)
        np.testing.assert_allclose(change, tau + terms.C.T @ dq - terms.g, atol=1e-5)


def test_rotors_add_to_the_inertia_of_their_own_joint(arm) -> None:
    mechanism, dynamics = arm
    q, dq = states(1)[0]
    added = dynamics.terms(q, dq).M - mechanism.mass_matrix(q)
    np.testing.assert_allclose(added, np.diag(ROTORS), atol=1e-12)


def test_wheels_give_what_base_and_arm_gain_in_energy():
    """Power is the rate of kinetic and potential energy, whatever rolls and turns at once."""
    cell = load_cell("rover")
    mechanism = Mechanism.from_cell(cell)
    Dynamics(mechanism, np.zeros(mechanism.n))  # another of the same mechanism changes nothing
    n, rotors = mechanism.n, np.linspace(0.1, 0.9, mechanism.n)
    dynamics = Dynamics(mechanism, rotors)
    free = pin.buildModelFromXML(cell.robot.description(), pin.JointModelPlanar())
    data, wheels = free.createData(), cell.config.mechanism.base.wheels
    order = [free.joints[free.getJointId(name)].idx_v for name in mechanism.joints]

    def energy(q, dq):
        left, right = 0.5 * wheels.radius * dq[0], 0.5 * wheels.radius * dq[1]
        place, speed = np.zeros(free.nq), np.zeros(free.nv)
        place[2] = 1.0
        speed[0], speed[2] = left + right, (right - left) / (0.5 * wheels.track)
        place[[i + 1 for i in order]], speed[order] = q, dq
        found = pin.computeKineticEnergy(free, data, place, speed)
        found += pin.computePotentialEnergy(free, data, place)
        return found + 0.5 * float(rotors @ dq**2)

    rng = np.random.default_rng(5)
    for _ in range(5):
        q, dq, ddq = rng.uniform(-1.5, 1.5, (3, n))
        h = 1e-6
        gained = energy(q + h * dq, dq + h * ddq) - energy(q - h * dq, dq - h * ddq)
        power = float(dynamics.torque(q, dq, ddq) @ dq)
        np.testing.assert_allclose(power, gained / (2.0 * h), rtol=1e-6, atol=1e-5)
