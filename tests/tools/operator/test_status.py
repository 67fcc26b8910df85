"""The terminal's status: attitude, joints, forces, sources and limits, in 80 columns."""

import re

import numpy as np
import pytest
from telerobot.protocols.messages.telemetry import State
from telerobot.tools.operator.terminal import arm_lines, joint_words, share_words, tool_words


def numbers(text):
    return np.array([float(n) for n in re.findall(r"[+-]\d+\.\d+", text)])


@pytest.mark.parametrize("roll", [-2.0, 0.0, 1.3])
def test_the_attitude_does_not_jump_where_the_pitch_passes_a_right_angle(roll):
    pitches = np.pi / 2 + np.linspace(-0.02, 0.02, 41)
    # Beyond a right angle the same attitude has another roll and yaw, half a turn away.
    poses = [
        [0, 0, 0, roll, p, 0.4]
        if p <= np.pi / 2
        else [0, 0, 0, roll + np.pi, np.pi - p, 0.4 + np.pi]
        for p in pitches
    ]
    shown = np.array([numbers(tool_words(pose)) for pose in poses])
    assert np.abs(np.diff(shown, axis=0)).max() <= 0.011
    assert np.abs(shown[:, 3:]).max() > 0.5


def test_a_tool_that_points_down_shows_it():
    assert "z +0.00 +0.00 -1.00" in tool_words([0.5, 0.0, 0.3, np.pi, 0.0, 0.0]).replace(
        "-0.00", "+0.00"
    )


def test_shares_name_the_sources_that_move_the_tool_and_no_others():
    shares = {
        "joystick": (0.03, 0.0, 0.04, 0, 0, 0),
        "force": (0, 0, 0, 0, 0, np.pi / 180),
        "vision": (0,) * 6,
    }
    assert share_words(shares) == "stick 50 mm/s + force 1.0 °/s"


def test_joints_are_told_in_degrees():
    assert joint_words(("s1", "e1"), (0.0, np.pi / 2)) == "s1 +0.0° e1 +90.0°"
    assert joint_words(("x", "pan"), (-1.25, 0.0), (True, False)) == "x -1250.0 mm pan +0.0°"


def test_the_lines_of_an_arm_say_force_per_axis_and_limits_in_words():
    state = State.model_construct(
        mode="enabled",
        q=(0.5, -0.5),
        pose_mrf=(0.5, 0, 0.3, 0, 0, 0),
        wrench_mrf=(1.0, -2.0, 3.0, 0, 0, 0.25),
        sources={"joystick": (0.05, 0, 0, 0, 0, 0)},
        limits=("leash:s1",),
        protective_stop=True,
    )
    head, force, shares, limit = arm_lines(state, state, (), (), 0)
    assert head.startswith("ENABLED | xyz +0.500")
    assert head.endswith("PROTECTIVE STOP")
    assert force == "f +1.0 -2.0 +3.0 N  m +0.00 +0.00 +0.25 N·m"
    assert shares == "stick 50 mm/s"
    assert "s1 lags behind its command" in limit
    assert all(len(line) < 80 for line in (force, shares, limit))
    assert "j1 +28.6° j2 -28.6°" in arm_lines(state, state, (), ("j1", "j2"), 0)[0]
