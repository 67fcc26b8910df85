"""The torque law on an arm that is integrated finely, with the delay that the bus has."""

import numpy as np
import pinocchio as pin
import pytest
from telerobot.config.load import load_cell
from telerobot.config.schema.mechanism import TorqueSection
from telerobot.server.control.actuation.torque import TorqueLaw
from telerobot.server.control.mechanism.model import Dynamics, Mechanism
from telerobot.server.control.spatial import Motion, Pose, pose_error, wrench_to

T, STEPS = 0.01, 50
START = np.array([0.0, 0.785398, 0.0, 1.570796, 0.0, -0.785398, 0.0])
STRAIGHT = np.zeros(7)
TOOL = Pose.from_xyz_rpy((0.0, 0.0, 0.121), (0.0, 0.0, 0.0))
MOST = np.array([230.0, 230.0, 115.0, 115.0, 30.0, 30.0, 30.0])
RATED = 10.0
ROTORS = (1.5, 1.5, 0.8, 0.8, 0.15, 0.15, 0.1)
QUIET = {"observer": 0.0, "velocity_filter_hz": 500.0}


class Plant:
    """An arm whose torques act a period after they were computed, and are held for one."""

    def __init__(self, q, rate=None, **gains):
        self.mechanism = Mechanism.from_cell(load_cell("pa10_hand"))
        self.dynamics = Dynamics(self.mechanism, np.array(ROTORS))
        torque = TorqueSection(**{**QUIET, **gains})
        self.law = TorqueLaw(self.dynamics, torque, np.zeros(7), MOST, 0.3, T, rate, TOOL, RATED)
        self.q, self.dq = q.copy(), np.zeros(7)
        self.acting = self.dynamics.bias(self.q, self.dq)
        self.model = pin.Model(self.mechanism.model)
        self.model.armature = np.array(ROTORS)
        self.data = self.model.createData()
        self.state, self.torques, self.k = None, None, 0
        self.unknown = np.zeros(7)
        self.on_arm = np.zeros(6)

    def tick(self, before, after, wrench=None, settled=False):
        self.state, self.torques = self.law.step(
            self.state, self.q.copy(), before, after, self.commanded(before.q), wrench, TOOL,
            self.k * T, settled,
        )  # fmt: skip
        for _ in range(STEPS):
            J = self.mechanism.kinematics(self.q, TOOL).J
            tau = self.acting + self.unknown + J.T @ self.on_arm
            ddq = pin.aba(self.model, self.data, self.q, self.dq, tau)
            self.q = self.q + T / STEPS * (self.dq + 0.5 * T / STEPS * ddq)
            self.dq = self.dq + T / STEPS * ddq
        self.acting = self.torques.tau
        self.k += 1

    def commanded(self, q):
        return self.mechanism.kinematics(q, TOOL)

    def pose(self):
        return self.mechanism.pose_wrist(self.q) @ TOOL


def self_motion(plant, q):
    """Return a direction (n,) of unit length in which the tool does not move."""
    return np.linalg.svd(plant.mechanism.kinematics(q, TOOL).J)[2][-1]


def test_an_error_of_the_tool_dies_out_as_the_gains_say() -> None:
    plant = Plant(START)
    J = plant.mechanism.kinematics(START, TOOL).J
    target = START + np.linalg.pinv(J) @ np.array([0.0, 0.01, 0.0, 0.0, 0.0, 0.01])
    rest = Motion.at_rest(target)
    goal = plant.mechanism.pose_wrist(target) @ TOOL
    first = pose_error(goal, plant.pose())
    for _ in range(80):
        plant.tick(rest, rest)
        t = max(0.0, (plant.k - 1) * T)  # the first torque acted one period after it was asked
        left = (1.0 + 10.0 * t) * np.exp(-10.0 * t)  # critical: K_p 100, K_d 20
        error = pose_error(goal, plant.pose())
        np.testing.assert_allclose(error, left * first, atol=0.05 * np.abs(first).max())


def test_self_motion_comes_back_and_the_tool_does_not_notice() -> None:
    plant = Plant(START)
    goal = plant.mechanism.pose_wrist(START) @ TOOL
    plant.q = START + 0.05 * self_motion(plant, START)
    away = pose_error(goal, plant.pose())  # the second order of the displacement
    rest, most = Motion.at_rest(START), np.zeros(6)
    for _ in range(100):
        plant.tick(rest, rest)
        most = np.maximum(most, np.abs(pose_error(goal, plant.pose())))
    assert np.abs(plant.q - START).max() < 1e-3
    assert (most <= 1.3 * np.abs(away).max()).all()


def test_a_moving_command_is_followed_without_lag() -> None:
    plant = Plant(START)
    t, last = 0.0, Motion.at_rest(START)
    swing = 0.1 * np.array([1.0, -0.5, 0.3, 0.6, -1.0, 0.8, 1.0])
    worst = 0.0
    for _ in range(150):
        t += T
        w = 3.0
        motion = Motion(
            START + swing * (1 - np.cos(w * t)),
            swing * w * np.sin(w * t),
            swing * w * w * np.cos(w * t),
        )
        plant.tick(last, motion)
        # reached one period later: `last` is where the joints ought to be now
        worst = max(worst, float(np.abs(plant.q - last.q).max()))
        last = motion
    assert worst < 2e-3


def test_a_far_mrf_changes_no_torque() -> None:
    far = Pose.from_xyz_rpy((40.0, -90.0, 10.0), (0.4, 1.0, -0.3))
    push, torques = np.array([0.0, 10.0, 4.0, 0.0, 0.5, 0.0]), []
    moving = Motion(START + 0.01, np.linspace(-0.5, 1.0, 7), np.zeros(7))
    for T_wrist_mrf in (TOOL, far):
        plant, commanded = Plant(START), moving.q + np.linspace(0.02, -0.02, 7)
        k = plant.mechanism.kinematics(commanded, T_wrist_mrf)
        felt = wrench_to(T_wrist_mrf.inverse() @ TOOL, push)
        state = None
        for i in range(3):
            state, now = plant.law.step(
                state, START + i * 0.01, moving, moving, k, felt, T_wrist_mrf, i * T, False
            )
        torques.append(now.tau)
    np.testing.assert_allclose(torques[0], torques[1], atol=1e-6)


def test_the_measured_force_on_the_arm_is_compensated() -> None:
    push = np.array([0.0, 10.0, 0.0, 0.0, 0.0, 0.0])
    rest, moved = Motion.at_rest(START), {}
    for share in (0.0, 1.0):
        plant = Plant(START, compensation=share)
        start = plant.pose()
        plant.on_arm = push
        felt = np.concatenate([start.R.T @ push[:3], np.zeros(3)])
        for _ in range(150):
            plant.tick(rest, rest, felt)
        moved[share] = float(np.abs(plant.pose().p - start.p).max())
    assert moved[0.0] > 0.005
    assert moved[1.0] < 1e-4


def test_the_observer_takes_away_what_the_model_does_not_know() -> None:
    rest, off = Motion.at_rest(START), {}
    for bandwidth in (0.0, 10.0):
        plant = Plant(START, observer=bandwidth)
        plant.unknown = np.array([0.0, 8.0, 0.0, -5.0, 0.0, 0.0, 0.0])
        for _ in range(200):
            plant.tick(rest, rest)
        off[bandwidth] = float(np.abs(plant.q - START).max())
    assert off[0.0] > 0.01
    assert off[10.0] < 1e-3 * off[0.0] + 1e-4


def test_what_the_observer_may_compensate_is_bounded_and_said() -> None:
    rest, plant = Motion.at_rest(START), Plant(START, observer=10.0, observer_share=0.05)
    plant.unknown = np.array([0.0, 40.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for _ in range(100):
        plant.tick(rest, rest)
    assert plant.torques.beyond.tolist() == [False, True, False, False, False, False, False]
    nominal = plant.state.momentum.residual[1]
    assert nominal > 0.05 * MOST[1]


def test_nothing_is_suspected_while_the_drives_are_off() -> None:
    rest, plant = Motion.at_rest(START), Plant(START, observer=10.0)
    plant.unknown = np.array([0.0, 8.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for _ in range(20):
        plant.tick(rest, rest, settled=True)
    assert np.abs(plant.state.momentum.residual).max() == 0.0


def test_in_a_singularity_the_joints_own_law_holds_the_arm() -> None:
    plant = Plant(STRAIGHT)
    rest = Motion.at_rest(STRAIGHT)
    plant.q = STRAIGHT + np.array([0.02, 0.02, -0.02, 0.03, 0.02, -0.02, 0.02])
    for _ in range(100):
        plant.tick(rest, rest)
        assert (np.abs(plant.torques.tau) < MOST).all()
    assert np.abs(plant.q - STRAIGHT).max() < 2e-3


def test_a_posture_through_the_singularity_changes_torques_smoothly() -> None:
    plant, last = Plant(STRAIGHT), None
    away = np.array([0.0, 0.02, 0.0, -0.05, 0.0, 0.02, 0.0])
    for bend in np.linspace(-0.3, 0.3, 601):
        q = np.array([0.0, -0.5 * bend, 0.0, bend, 0.0, -0.5 * bend, 0.0])
        rest = Motion.at_rest(q + away)
        _, torques = plant.law.step(
            None, q, rest, rest, plant.commanded(rest.q), None, TOOL, 0.0, False
        )
        if last is not None:
            assert np.abs(torques.tau - last).max() < 3.0
        last = torques.tau


@pytest.mark.parametrize("missed", [2, 5])
def test_late_ticks_leave_no_false_speed(missed: int) -> None:
    plant = Plant(START)
    moving = Motion.at_rest(START)
    for _ in range(20):
        plant.tick(moving, moving)
    plant.q = plant.q + 0.01
    plant.k += missed
    before = plant.torques.tau.copy()
    plant.tick(moving, moving)
    # 10 mrad in one period would look like 1 rad/s, and 20 /s times that like 20 rad/s²
    assert np.abs(plant.state.dq_next).max() < 0.05
    assert np.abs(plant.torques.tau - before).max() < 25.0


def test_torques_and_their_steps_stay_inside_their_bounds_and_nothing_winds_up() -> None:
    plant, rate = Plant(START, rate=5.0 * MOST, observer=10.0), 5.0 * MOST
    target = START + np.array([0.15, 0.1, -0.1, 0.15, 0.2, -0.1, 0.2])
    rest, last, held_back = Motion.at_rest(target), None, False
    for _ in range(150):
        plant.tick(rest, rest)
        tau = plant.torques.tau
        assert (np.abs(tau) <= MOST).all()
        if last is not None:
            assert (np.abs(tau - last) <= rate * T * (1.0 + 1e-9)).all()
        held_back, last = held_back or plant.torques.held_back.any(), tau
        # the observer knows what was sent: the model is true, so it finds nothing
        assert (np.abs(plant.state.momentum.residual) < 0.03 * MOST).all()
    assert held_back
    assert np.abs(plant.q - target).max() < 2e-3


def test_a_payload_that_is_carried_is_held_and_accelerated_as_the_model_of_it_says() -> None:
    rest, sagged = Motion.at_rest(START), {}
    for known in (False, True):
        plant = Plant(START)
        frame = plant.model.getFrameId("flange")
        tip = plant.model.frames[frame]
        com = np.array([0.0, 0.0, 0.1])
        extra = pin.Inertia(3.0, tip.placement.act(com), np.zeros((3, 3)))
        plant.model.inertias[tip.parentJoint] += extra
        if known:
            grip, at = 0.98, 0.051
            plant.law.carry(grip + 3.0, np.array([0.0, 0.0, (grip * at + 0.3) / (grip + 3.0)]))
            held, _ = plant.law.step(
                None, START, rest, rest, plant.commanded(START), None, TOOL, -T, True
            )
            plant.acting = held.tau
        for _ in range(100):
            plant.tick(rest, rest)
        sagged[known] = float(np.abs(plant.q - START).max())
    assert sagged[False] > 0.02
    assert sagged[True] < 1e-3
