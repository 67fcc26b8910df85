"""Following a hand: the damped mass in closed form, and what must not disturb it."""

import numpy as np
import pytest
from telerobot.config.schema.sources import FollowingSection
from telerobot.server.control.spatial import Pose, rotation_rpy
from telerobot.server.control.task.following import Following, FollowingState

from .shown import SHAPING, T, shown
from .shown import granted as let_through

FORCE = np.array([0.0, 4.0, 0.0, 0.0, 0.0, 0.0])
ONLY_FORCE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
OFF = np.zeros(6)


def felt(wrench_on_arm, T_world_mrf, **said):
    """Return what a hand with a wrench (6,) on the arm shows; None for a stale sensor."""
    hand = None if wrench_on_arm is None else -wrench_on_arm
    return shown(hand=hand, T_world_mrf=T_world_mrf, **said)


class Tool:
    """A tool that does what it is told."""

    def __init__(self):
        self.source = Following(FollowingSection(), SHAPING)
        self.state = FollowingState()
        self.pose = Pose.identity()

    def tick(self, wrench, gain=ONLY_FORCE, others=OFF, granted=1.0, share=1.0):
        before = self.pose
        context = felt(wrench, before, precedence=1.0 - share)
        twist, self.state = self.source.rate(context, self.state, gain)
        total = twist + others
        self.pose = Pose(before.R, before.p + T * granted * total[:3])
        self.state = self.source.advance(
            self.state, let_through(granted, twist=total, T_world_mrf=before)
        )
        return twist


def test_speed_and_path_under_a_steady_force_are_those_of_a_damped_mass() -> None:
    tool = Tool()
    for k in range(1, 101):
        twist = tool.tick(FORCE)
        t = k * T
        assert tool.state.twist[1] == pytest.approx(0.2 * (1 - np.exp(-20 * t)), rel=1e-4)
        path = 0.2 * (t - 0.05 * (1 - np.exp(-20 * t)))
        assert tool.state.T_world_reference.p[1] == pytest.approx(path, rel=1e-3, abs=1e-6)
    assert twist[1] == pytest.approx(0.2, rel=5e-3)
    assert np.abs(twist[[0, 2, 3, 4, 5]]).max() < 1e-12


def test_moments_do_not_turn_the_tool_unless_a_gain_says_so() -> None:
    wrench = np.array([0.0, 4.0, 0.0, 0.5, 0.5, -0.5])
    tool, turning = Tool(), Tool()
    for _ in range(50):
        assert np.abs(tool.tick(wrench)[3:]).max() < 1e-12
        twist = turning.tick(wrench, gain=np.ones(6))
    assert twist[3] > 0.01


def test_the_hand_is_felt_in_the_tools_axes_and_led_in_the_worlds() -> None:
    tool = Tool()
    tool.pose = Pose(rotation_rpy(0.0, 0.0, np.pi / 2), np.zeros(3))
    for _ in range(50):
        twist = tool.tick(FORCE)
    assert twist[0] == pytest.approx(-0.2, rel=0.02)


@pytest.mark.parametrize("wrench", [None, OFF, 0.05 * FORCE])
def test_without_a_hand_or_its_sensor_the_motion_dies_out_as_the_mass_does(wrench) -> None:
    tool = Tool()
    for _ in range(50):
        tool.tick(FORCE)
    speed = tool.state.twist[1]
    for k in range(1, 60):
        tool.tick(wrench)
        assert tool.state.twist[1] == pytest.approx(speed * np.exp(-20 * k * T), rel=2e-3)


def test_noise_below_the_deadband_moves_nothing_and_twice_as_much_is_followed_in_full() -> None:
    assert np.abs(Tool().tick(0.07 * FORCE)).max() == 0.0
    for size in (0.15, 1.0):
        tool = Tool()
        for _ in range(100):
            twist = tool.tick(size * FORCE)
        assert twist[1] == pytest.approx(0.2 * size, rel=5e-3)


def test_a_blow_is_followed_as_the_greatest_force_would_be() -> None:
    tool = Tool()
    for _ in range(100):
        twist = tool.tick(1000.0 * FORCE)
    assert twist[1] == pytest.approx(30.0 / 20.0, rel=0.02)


def test_an_avoidance_that_takes_precedence_leaves_its_share() -> None:
    tool = Tool()
    for _ in range(100):
        twist = tool.tick(FORCE, share=0.25)
    assert twist[1] == pytest.approx(0.05, rel=0.01)


def test_a_stick_adds_to_the_hand_and_is_not_fought() -> None:
    tool, stick = Tool(), np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    for _ in range(200):
        twist = tool.tick(FORCE, others=stick)
    assert tool.pose.p[0] == pytest.approx(0.05 * 2.0, rel=1e-6)
    assert abs(twist[0]) < 1e-9


def test_an_arm_that_could_not_follow_does_not_catch_up_afterwards() -> None:
    tool = Tool()
    for _ in range(300):
        twist, tool.state = tool.source.rate(felt(FORCE, tool.pose), tool.state, ONLY_FORCE)
        # It stood, but was told that all was granted.
        tool.state = tool.source.advance(tool.state, let_through(1.0, twist=twist))
    assert tool.state.T_world_reference.p[1] <= 0.02 + 1e-9
    for _ in range(100):
        tool.tick(OFF)
    assert tool.pose.p[1] < 0.02 + 0.2 * 0.05 + 1e-3


def test_switching_on_and_off_ramps_with_the_gain() -> None:
    tool, last = Tool(), 0.0
    ramp = [*np.linspace(0, 1, 30), *np.ones(50), *np.linspace(1, 0, 30), *np.zeros(80)]
    for part in ramp:
        twist = tool.tick(FORCE, gain=part * ONLY_FORCE)
        assert abs(twist[1] - last) < 4.0 * T + 1e-9  # never more than the mass itself allows
        last = twist[1]
    assert last == 0.0
    assert tool.state.T_world_reference is None


@pytest.mark.parametrize("more", [0.2 * FORCE, -0.4 * FORCE, 0.2 * FORCE[[1, 0, 2, 3, 4, 5]]])
def test_a_force_that_is_nobodys_leads_nowhere_and_whole_with_a_hand_beside_it(more) -> None:
    source, here = Following(FollowingSection(), SHAPING), Pose.identity()

    def twist(wrench, untold):
        context = felt(wrench, here, untold=untold)
        return source.rate(context, FollowingState(), ONLY_FORCE)[0]

    assert np.abs(twist(FORCE, -FORCE)).max() == 0.0
    assert np.abs(twist(FORCE + 0.05 * more, -FORCE)).max() == 0.0
    assert np.abs(twist(OFF, -FORCE)).max() == 0.0
    np.testing.assert_array_equal(twist(FORCE + more, -FORCE), twist(FORCE + more, None))
