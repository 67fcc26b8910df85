"""An arm that is held up slows as a whole, before a joint falls out of its following window."""

import numpy as np
import pytest


class GraspState:
    """A run whose joints follow two ticks late, but for what holds them up."""

    def __init__(self, run, stick, twist):
        self.run, self.stick = run, stick(*twist)
        self.delayed = [run.q, run.q]
        self.away = np.zeros(run.arm.p.n)
        self.worst = 0.0

    def tick(self, stick=None, **inputs):
        follows = self.delayed[-2] - self.away
        output = self.run.tick(stick=stick or self.stick, q_measured=follows, **inputs)
        self.delayed.append(output.q)
        joints = self.run.arm.p.joints
        window = np.minimum(joints.following_window, 2.0 * joints.leash)  # what a command keeps to
        self.worst = max(self.worst, float((np.abs(output.error) / window).max()))
        return output

    def go(self, seconds):
        for _ in range(round(seconds / self.run.arm.p.period_s)):
            output = self.tick()
        return output


def test_joints_that_follow_late_are_not_slowed(run, stick):
    held = GraspState(run, stick, (0.25, -0.2, 0.1, 0.3, 0.2, -0.5))
    held.go(1.0)
    assert np.abs(run.outputs[-1].dq).max() > 0.2
    assert not any("leash" in name for o in run.outputs for name in o.limits)


@pytest.mark.parametrize("speed", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("joint", [0, 1, 2, 3])
def test_a_joint_that_is_arrested_stays_in_its_window(run, stick, joint, speed):
    """Jogged, it runs into something hard: from there on it stands."""
    held = GraspState(run, stick, (0.0,) * 6)
    rates = np.zeros(run.arm.p.n)
    rates[joint] = speed
    for _ in range(40):
        held.tick(jog=rates)
    where = held.delayed[-1][joint]
    for _ in range(60):
        held.away[joint] = held.delayed[-2][joint] - where
        output = held.tick(jog=rates)
    assert abs(output.dq[joint]) < 0.01
    assert 0.25 < held.worst < 1.0
    assert f"leash:{run.arm.p.joints.names[joint]}" in output.limits


@pytest.mark.parametrize("joint", [4, 5])
def test_a_joint_that_the_others_push_back_stops_them(run, stick, joint):
    """A wrist at the end of its torque: what the first joint presses it into, it gives way to."""
    held = GraspState(run, stick, (0.0,) * 6)
    rates = np.zeros(run.arm.p.n)
    rates[0] = 0.8 * run.arm.p.joints.velocity[0]
    start = run.q[0]

    def press(jog):
        # Felt 20 ms late, as by drives that give their torque late.
        pressed = held.delayed[max(0, len(held.delayed) - 4)][0] - start
        held.away[joint] = run.arm.p.joints.leash[joint] * 1.2 + 0.5 * max(0.0, pressed)
        return held.tick(jog=jog)

    for _ in range(100):
        output = press(rates)
    assert abs(output.dq[0]) < 0.02
    assert held.worst < 1.0
    # The way back is open: nothing falls farther behind on it.
    for _ in range(40):
        output = press(-rates)
    assert output.dq[0] < -0.05
    assert held.worst < 1.0
