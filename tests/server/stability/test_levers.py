"""An MRF away from where the tool touches: one judge for frames, gains, switches, loads, `check`.

The loop gains are held against the loop itself, run in time.
"""

import re

import numpy as np
import pytest
from telerobot.config.load import Cell, ConfigError, grasp_part, joint_part, load_cell
from telerobot.protocols.messages import requests
from telerobot.protocols.messages.perception import FrameRequest
from telerobot.server.commands.commands import Commands
from telerobot.server.control.spatial import Pose, rotation_rpy
from telerobot.server.refusals import Refused, Why
from telerobot.server.stability.judgement import LoopBounds
from telerobot.server.stability.loops import ForceLoop, bound
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.judge import judge

T, DELAY = 0.01, 4
ENVELOPE = {"seen_tick": 1}
HERE = Pose.from_xyz_rpy((0.7, 0.0, 0.4), (0.0, 1.57, 0.0))
GAINS = np.array([7.5e-4, 6e-4, 5e-4, 0.03, 0.02, 0.025])
STIFFNESS = np.array([20e3] * 3 + [500.0] * 3)
ASIDE = {"xyz": (0.0, 0.6, 0.121)}


@pytest.fixture(scope="module")
def cell() -> Cell:
    return load_cell("pa10")


@pytest.fixture
def commands(cell: Cell) -> Commands:
    return Commands.from_cell(cell)


def frame(commands: Commands, **pose) -> str | None:
    """Redefine the MRF; return why that is refused, or None."""
    try:
        commands.set_frame(FrameRequest(**ENVELOPE, frame="mrf", **pose), HERE)
    except Refused as refused:
        return f"{refused.reason}: {refused.detail}"
    return None


def grows(gains: np.ndarray, r: np.ndarray, stiffness: np.ndarray) -> bool:
    """Let a rigid tool give way to its contact `DELAY` periods late; return whether it swings up.

    The contact, at r from the MRF, moves by v + ω × r, and its force f is felt as r × f there.
    """
    off = [np.linspace(1e-3, 2e-3, 6)] * (DELAY + 1)  # of the MRF
    sizes = []
    for _ in range(4000):
        late = off[-1 - DELAY]
        f = stiffness[:3] * (late[:3] + np.cross(late[3:], r))
        felt = np.concatenate([f, stiffness[3:] * late[3:] + np.cross(r, f)])
        off = [*off[1:], off[-1] - T * gains * felt]
        sizes.append(float(np.abs(off[-1]).max()))
    return max(sizes[-200:]) > max(sizes[:200])


@pytest.mark.parametrize("seed", range(4))
def test_a_tool_swings_at_a_lever_where_its_loop_gain_says(tmp_path, seed):
    draw = np.random.default_rng(seed)
    tip = written(tmp_path, "pa10", ("rate_hz = 200", "rate_hz = 200\ncontact_length = 0.0"))
    loop = ForceLoop(load_cell(tip))
    aside = Pose(rotation_rpy(*draw.uniform(-2, 2, 3)), loop.tip.p + draw.uniform(-0.4, 0.4, 3))
    contact = loop.touching(GAINS, aside)
    r = aside.R.T @ (loop.tip.p - aside.p)
    assert contact.lever == pytest.approx(np.linalg.norm(r))
    # The judge's delay is the cell's; the loop in time has a round one.
    at_bound = bound(DELAY) / contact.loop_gain * GAINS
    assert not grows(0.97 * at_bound, r, STIFFNESS)
    assert grows(1.03 * at_bound, r, STIFFNESS)


def test_a_tool_that_is_touched_beside_its_tip_swings_where_its_loop_gain_says(cell):
    contact = ForceLoop(cell).touching(GAINS)
    assert contact.lever == pytest.approx(0.121)
    at_bound, r = bound(DELAY) / contact.loop_gain * GAINS, np.array([0.0, 0.0, -0.121])
    point = np.array([*STIFFNESS[:3], 0.0, 0.0, 0.0])
    assert not grows(0.97 * at_bound, r, point)
    assert grows(1.03 * at_bound, r, point)


def test_at_the_tip_the_axes_are_judged_alone(cell):
    loop = ForceLoop(cell)
    along = GAINS * (1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    first = loop.axes(along)[0]
    assert loop.touching(along).loop_gain == pytest.approx(7.5e-4 * 20e3 * T)
    assert loop.touching(along).bound == pytest.approx(first.bound)
    assert LoopBounds(cell).gain("force", GAINS).share < 1.0
    high = LoopBounds(cell).gain("force", (3e-3, *GAINS[1:]))
    assert high.share >= 1.0
    assert high.words.startswith("gain[0] = 0.003: loop gain 0.6, stable below 0.3")


def test_an_mrf_aside_of_the_tool_is_refused_with_the_bound(commands):
    before = commands.frames.T_wrist_mrf
    refused = frame(commands, **ASIDE)
    assert refused is not None
    assert refused.startswith(f"{Why.UNSTABLE_FRAME}: force: a contact 0.6")
    assert "stable below 0.3" in refused
    allowed = float(re.search(r"the MRF may be ([\d.]+) m from the tool's tip", refused)[1])
    # By the delays where it was asked for: with those at the tip it would be 0.124 m.
    assert allowed == pytest.approx(0.122)
    assert commands.frames.T_wrist_mrf is before
    assert frame(commands, xyz=(0.0, allowed - 0.001, 0.121)) is None
    assert frame(commands, xyz=(0.0, allowed + 0.01, 0.121)) is not None


def test_every_way_of_telling_an_mrf_is_judged(commands):
    """Relative to whatever frame, and as an origin alone."""
    commands.set_frame(FrameRequest(**ENVELOPE, frame="crf", xyz=(0.7, 0.9, 0.4)), HERE)
    for pose in (
        {"relative_to": "crf"},
        {"relative_to": "mrf", "xyz": (0.0, 0.6, 0.0), "origin_only": True},
        {"relative_to": "world", "xyz": (0.7, 0.8, 0.4)},
    ):
        assert str(frame(commands, **pose)).startswith(Why.UNSTABLE_FRAME)


def test_no_tool_is_longer_than_two_metres_even_where_nothing_feels_it(commands):
    commands.settings.switch("force", False)
    assert frame(commands, xyz=(0.0, 1.9, 0.121)) is None
    refused = str(frame(commands, xyz=(0.0, 30.0, 0.121)))
    assert refused.startswith(f"{Why.OUT_OF_RANGE}: the MRF 30 m")
    assert refused.endswith("no tool reaches farther than 2 m")


def test_with_low_gains_about_its_axes_the_mrf_may_be_aside_and_then_gains_are_judged_there(
    commands,
):
    settings, low = commands.settings, (7.5e-4,) * 3 + (1e-3,) * 3
    assert settings.set_gain("force", low, forced=False) is None
    assert frame(commands, **ASIDE) is None
    with pytest.raises(Refused, match=r"a contact 0\.6.* m from the MRF"):
        settings.set_gain("force", (7.5e-4,) * 3 + (0.03,) * 3, forced=False)
    np.testing.assert_array_equal(settings.gains["force"], low)


def test_force_control_is_not_switched_on_where_it_would_swing(commands):
    settings = commands.settings
    settings.switch("force", False)
    assert frame(commands, **ASIDE) is None
    with pytest.raises(Refused) as refused:
        settings.switch("force", True)
    assert refused.value.reason == Why.UNSTABLE_GAIN
    assert not settings.on["force"]
    assert frame(commands, xyz=(0.0, 0.0, 0.121)) is None
    settings.switch("force", True)
    assert settings.on["force"]


def test_gains_that_were_forced_allow_a_frame_that_is_no_worse(commands):
    settings = commands.settings
    assert settings.set_gain("force", (2e-3,) * 3 + (0.03,) * 3, forced=True) is not None
    settings.switch("force", True)
    assert frame(commands, xyz=(0.0, 0.0, 0.121), rpy=(0.0, 0.0, 0.4)) is None
    assert str(frame(commands, xyz=(0.0, 0.1, 0.121))).startswith(Why.UNSTABLE_FRAME)


def test_a_payload_aside_of_the_mrf_swings_by_its_moment(commands):
    settings = commands.settings
    settings.set_payload(requests.PayloadRequest(**ENVELOPE, mass=8.0, com=(0.0, 0.0, 0.1)))
    with pytest.raises(Refused) as refused:
        settings.set_payload(requests.PayloadRequest(**ENVELOPE, mass=8.0, com=(0.0, 0.6, 0.1)))
    assert refused.value.reason == Why.UNSTABLE_PAYLOAD


def test_a_followed_moment_is_judged_by_the_lever_of_the_hand():
    commands = Commands.from_cell(load_cell("pa10_hand"))
    settings = commands.settings
    assert settings.set_gain("following", (1.0,) * 6, forced=False) is None
    refused = str(frame(commands, xyz=(0.0, 1.9, 0.121)))
    assert refused.startswith(f"{Why.UNSTABLE_FRAME}: following: gain[0] = 1: a hand of 300 N/m")
    assert settings.set_gain("following", (1.0,) * 3 + (0.0,) * 3, forced=False) is None
    assert frame(commands, xyz=(0.0, 1.9, 0.121)) is None


def written(tmp_path, name, *changes):
    text = load_cell(name).path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "cell.toml"
    path.write_text(text)
    return path


MRF = "T_wrist_mrf = { xyz = [0.0, 0.0, 0.121] }"


def test_check_finds_a_cell_whose_mrf_is_aside_of_its_tool(tmp_path):
    aside = written(tmp_path, "pa10", (MRF, "T_wrist_mrf = { xyz = [0.0, 0.6, 0.121] }"))
    found = {f.check: f for f in judge(load_cell(aside))}["force tool"]
    assert found.status is Severity.ERROR
    assert found.values["loop_gain"] > 6.0 * found.values["bound"]
    shipped = {f.check: f for f in judge(load_cell("pa10"))}["force tool"]
    assert shipped.status is Severity.OK
    # K_F + K_R r² at the sensor, where the hand begins
    assert shipped.values["loop_gain"] == pytest.approx((7.5e-4 + 0.03 * 0.121**2) * 200.0)


def test_a_cell_may_say_that_only_the_end_of_its_tool_touches(tmp_path):
    tool = (MRF, "T_wrist_mrf = { xyz = [0.0, 0.0, 0.6] }")
    end = ("rate_hz = 200", "rate_hz = 200\ncontact_length = 0.1")
    long = {f.check: f for f in judge(load_cell(written(tmp_path, "pa10", tool)))}
    assert long["force tool"].status is Severity.ERROR
    told = {f.check: f for f in judge(load_cell(written(tmp_path, "pa10", tool, end)))}
    assert told["force tool"].status is Severity.OK
    assert told["force tool"].values["lever_m"] == pytest.approx(0.1)


def test_an_mrf_that_no_tool_reaches_is_one_line(tmp_path):
    far = written(tmp_path, "pa10", (MRF, "T_wrist_mrf = { xyz = [0.0, 0.0, 30.0] }"))
    with pytest.raises(ConfigError, match=r"T_wrist_mrf: xyz: 30 m .* farther than 2 m"):
        load_cell(far)


def test_a_joint_tasks_gains_are_judged_at_each_grasp_and_its_mrf_is_free(tmp_path):
    """Each arm gives way at its own grasp, wherever the MRF of the payload is."""
    cell = load_cell("pa10_pair")
    task = cell.joint_tasks[0]
    grasps = [grasp_part(cell, task, i) for i in range(2)]
    bounds = LoopBounds(joint_part(cell, task), grasps)
    far = Pose.from_xyz_rpy((0.0, -1.15, 0.121), (0.0, 0.0, 0.0))
    gains = task.sources.force.gain
    assert bounds.gain("force", gains, far).share == bounds.gain("force", gains).share < 1.0
    assert bounds.gain("force", (1e-3,) * 3 + gains[3:], far).refusal is not None
