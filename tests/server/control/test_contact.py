"""The tool against a spring: what two periods later is felt, and what is done about it."""

from collections import deque

import numpy as np
import pinocchio as pin
import pytest
from telerobot.server.control.inputs import Intent, Payload

DELAY = 2
"""Periods from a command to the wrench that it causes."""


class Wall:
    """A plane of known stiffness across World x, felt through the arm's own sensor."""

    def __init__(self, run, stiffness, gap):
        self.run, self.stiffness = run, stiffness
        self.x = run.pose.p[0] + gap
        self.forces = deque([0.0] * DELAY, maxlen=DELAY)

    def reading(self):
        """Return the sensor's reading (6,): the contact, the payload's weight and the bias."""
        self.forces.append(self.stiffness * max(0.0, self.run.pose.p[0] - self.x))
        control, settings = self.run.arm.control, self.run.settings
        M = settings.T_wrist_mrf.inverse() @ control.arms[0].wrist.contact.T_wrist_sensor
        at_mrf = pin.Force(self.run.pose.R.T @ [self.forces[0], 0, 0], np.zeros(3))
        at_sensor = pin.SE3(M.R, M.p).actInv(at_mrf).vector
        weight = control.arms[0].weight(self.run.pose, settings)
        return at_sensor + weight + settings.wrench_bias

    def press(self, seconds, **inputs):
        output = None
        for _ in range(round(seconds / self.run.arm.p.period_s)):
            output = self.run.tick(wrench_sensor=self.reading(), **inputs)
        return output


@pytest.mark.parametrize("stiffness", [2_000.0, 20_000.0])
@pytest.mark.parametrize("u", [0.005, 0.015])
def test_a_held_stick_presses_with_a_force_that_no_wall_changes(run, stick, stiffness, u):
    """F = K_HC u / K_F (Williams 1997, section 2.6)."""
    K_HC = np.array([0.8, 1, 1, 1, 1, 1])
    run.set(gains=run.arm.gains(joystick=K_HC), wrench_bias=np.array([1, -2, 3, 0.1, 0.2, 0.3]))
    wall = Wall(run, stiffness, 0.01)
    wall.press(12.0, stick=stick(u, 0, 0, 0, 0, 0))
    expected = K_HC[0] * u / run.settings.gains["force"][0]
    forces = []
    for _ in range(100):
        wall.press(run.arm.p.period_s, stick=stick(u, 0, 0, 0, 0, 0))
        forces.append(wall.forces[-1])
    assert np.mean(forces) == pytest.approx(expected, rel=0.02)
    assert np.ptp(forces) < 0.02 * expected
    run.observe()


def test_pressed_against_a_wall_an_idle_arm_backs_off(run):
    wall = Wall(run, 20_000.0, -0.002)
    wall.press(0.03)
    assert wall.forces[-1] > 20.0
    output = wall.press(2.0)
    assert wall.forces[-1] < 0.5
    np.testing.assert_allclose(output.wrench[:3], 0.0, atol=0.5)
    run.observe()


def test_a_desired_wrench_is_reached_at_the_mrf(run):
    wall = Wall(run, 5_000.0, 0.003)
    desired = np.zeros(6)
    desired[:3] = run.pose.R.T @ [15.0, 0.0, 0.0]
    output = wall.press(8.0, wrench_desired=desired)
    assert wall.forces[-1] == pytest.approx(15.0, rel=0.02)
    np.testing.assert_allclose(output.wrench[:3], desired[:3], atol=0.5)
    run.observe()


def test_a_sensor_that_falls_silent_ends_the_force_sources_motion(run):
    wall = Wall(run, 20_000.0, -0.002)
    wall.press(0.05)
    assert run.outputs[-1].twists["force"].any()
    output = run.go(0.5, wrench_sensor=None)
    assert not output.twists["force"].any()
    assert output.wrench is None
    assert np.abs(output.dq).max() < 0.02
    run.observe()


def test_in_hold_strong_contact_is_bled_off_inside_the_leash_and_then_left(run):
    at, threshold = run.pose.p, run.arm.p.sources.force.hold_threshold
    wall = Wall(run, 20_000.0, -1.5 * threshold / 20_000.0)
    output = wall.press(0.05, intent=Intent.HOLD)
    assert output.bleeding
    output = wall.press(4.0, intent=Intent.HOLD)
    assert not output.bleeding
    assert wall.forces[-1] < threshold
    assert output.at_rest
    assert 0 < at[0] - run.pose.p[0] < run.arm.p.sources.force.hold_leash
    run.observe()


def test_in_hold_a_gentle_touch_moves_nothing(run):
    wall = Wall(run, 20_000.0, -0.9 * run.arm.p.sources.force.hold_threshold / 20_000.0)
    output = wall.press(1.0, intent=Intent.HOLD)
    assert wall.forces[-1] > 20.0
    np.testing.assert_array_equal(output.q, run.q)
    assert not output.bleeding


def test_in_hold_a_force_without_end_gets_no_further_than_the_leash(run):
    """As from a sensor that drifted: FMA alone would walk away."""
    at = run.arm.mechanism.pose_wrist(run.q).p
    wrench = run.arm.control.arms[0].weight(run.pose, run.settings)
    wrench[2] += 80.0
    run.go(6.0, intent=Intent.HOLD, wrench_sensor=wrench)
    moved = np.linalg.norm(run.arm.mechanism.pose_wrist(run.memory.commanded.motion.q).p - at)
    leash = run.arm.p.sources.force.hold_leash
    assert 0.5 * leash < moved <= 1.05 * leash
    run.observe()


def test_while_stopping_contact_moves_nothing(run):
    wall = Wall(run, 20_000.0, -0.004)
    output = wall.press(0.5, intent=Intent.STOP)
    np.testing.assert_array_equal(output.q, run.q)


def test_a_payload_that_is_switched_never_jumps(run):
    """The operator says 2 kg more than there is: the arm sets off gently, to a steady drift."""
    wall = Wall(run, 20_000.0, 10.0)
    wall.press(0.2)
    reading = wall.reading()
    payload = run.arm.p.payload
    run.set(payload=Payload(payload.mass + 2.0, payload.com))
    twists = [run.tick(wrench_sensor=reading).twists["force"] for _ in range(200)]
    steps = np.abs(np.diff(twists, axis=0, prepend=np.zeros((1, 6)))).max(axis=0)
    assert (steps <= 0.1 * np.abs(twists).max(axis=0) + 1e-6).all()
    drift = run.settings.gains["force"][0] * 2.0 * 9.81
    assert np.linalg.norm(twists[-1][:3]) == pytest.approx(drift, rel=0.02)
    run.observe()


def test_a_tare_never_jumps(run):
    wall = Wall(run, 20_000.0, 10.0)
    wall.press(0.2)
    reading = wall.reading()
    before = run.tick(wrench_sensor=reading).twists["force"]
    run.set(wrench_bias=np.array([10.0, 0, 0, 0, 0, 0]))
    after = run.tick(wrench_sensor=reading).twists["force"]
    assert np.abs(after - before)[:3].max() < 0.1 * run.settings.gains["force"][0] * 10.0
