"""Frames of each arm of a cell: its Base, which may move, and its own camera's Lens."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.spatial import rotation_rpy

BASE = """
[mechanisms.frames.base]
speed = 0.3
angular_speed = 0.3
acceleration = 0.5
angular_acceleration = 0.5
extent = [0.5, 0.35]
"""
SWAY = {"target": "platform", "sway": [0.0, 0.05, 0.0, 0.03, 0.0, 0.0], "period_s": 4.0}
SHIFT = 0.02
"""The right Base is told to have gone so far along y [m]."""
TURNED = (0.3, -0.2, 1.5)
LENSES = f"""
[[tasks]]
name = "left"
[[tasks.cameras]]
name = "left_eye"
device = "0"
T_wrist_lens = {{ xyz = [0.0, 0.05, 0.0], rpy = {list(TURNED)} }}
[[tasks]]
name = "right"
[[tasks.cameras]]
name = "right_eye"
device = "1"
T_wrist_lens = {{ xyz = [0.05, 0.0, 0.0] }}
"""


@pytest.fixture(scope="module")
def two_bases(two_arms):
    return load_cell(two_arms(like=("pa10", "pa10"), bases=(1.0, -1.0), own=(BASE, BASE)))


def tool(run, name, from_s):
    start = run.simulation.player.start_s
    return np.array([t.arms[name].pose_mrf for t in run.truths if t.time_s - start > from_s])


def test_each_arm_keeps_its_tool_in_world_by_news_of_its_own_base(play, two_bases):
    """The left one's platform sways; the right one's stands, and is told to be elsewhere."""
    there = two_bases.parts[1].config.mechanism.T_world_base.xyz
    told = [
        {"at_s": round(0.5 + s, 3), "sensor/frame": {
            "name": "base", "mechanism": "right", "rpy": [0.0] * 3,
            "xyz": [there[0], there[1] + SHIFT * (3.0 - 2.0 * u) * u * u, there[2]]}}
        for s in np.arange(0.0, 6.0, 0.05)
        for u in [min(1.0, max(0.0, s - 0.5))]
    ]  # fmt: skip
    run = play({"at_s": 0.3, "rig/motion": SWAY}, *told, seconds=6.5, cell=two_bases)
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    swayed = np.array([t.frames["base"] for t in run.truths])
    assert np.ptp(swayed, axis=0)[1] > 0.08
    assert np.ptp(tool(run, "left", 2.0), axis=0)[:3].max() < np.ptp(swayed, axis=0)[1] / 20.0
    # What is told of the right Base is made up for: truly it stands, so that its tool goes.
    right = tool(run, "right", 0.0)
    way = right[-1] - right[0]
    assert way[:3] == pytest.approx([0.0, -SHIFT, 0.0], abs=1.5e-3)
    assert run.states[-1].tasks["right"].frames["base"][1] == pytest.approx(
        there[1] + SHIFT, abs=1e-3
    )
    assert run.states[-1].tasks["right"].frame_age_ticks["base"] is not None


def test_news_of_a_base_that_nobody_has_is_refused(play, two_bases):
    news = {"name": "base", "mechanism": "rigth", "xyz": [0.0] * 3, "rpy": [0.0] * 3}
    run = play({"at_s": 0.2, "sensor/frame": news}, seconds=0.5, cell=two_bases)
    (refused,) = run.events("command_refused")
    assert "mechanism 'rigth' is none of: left, right" in refused.detail


@pytest.mark.parametrize("axis", [0, 2])
def test_a_stick_in_the_lens_is_that_of_the_arm_that_it_leads(play, two_arms, axis):
    cell = load_cell(two_arms(like=("pa10", "pa10"), bases=(1.0, -1.0), more=LENSES))
    twist = np.zeros(6)
    twist[axis] = 0.05
    sticks = [
        {"at_s": 0.3, "cmd/joystick": {"task": name, "twist": list(twist), "expressed_in": "lens"}}
        for name in ("left", "right")
    ]
    run = play(*sticks, seconds=1.0, cell=cell)
    assert run.summary["refused"] == []
    for part, turn in zip(cell.parts, (TURNED, (0.0,) * 3), strict=True):
        q = np.array(part.config.mechanism.postures["start"])
        axes = Mechanism.from_cell(part).pose_wrist(q).R @ rotation_rpy(*turn)
        pose = tool(run, part.config.mechanism.name, -1.0)
        way = pose[-1, :3] - pose[0, :3]
        assert np.linalg.norm(way) > 0.02
        assert way / np.linalg.norm(way) == pytest.approx(axes[:, axis], abs=0.01)
