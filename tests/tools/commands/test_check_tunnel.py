"""A tunnel that an arm cannot follow is refused, with the place and the number."""

import math

import numpy as np
import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell
from telerobot.config.load import shipped as names
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.model import tunnel

ENTRANCE = "rpy = [0.0, 0.0, 1.5707963267948966]"


@pytest.fixture
def changed(tmp_path):
    """Write a cell that extends `snake` by some keys of its backbone, and load it."""

    def load(lines, more="", extends="snake"):
        path = tmp_path / "cell.toml"
        path.write_text(f'extends = "{extends}"\n{more}\n[mechanism.backbone]\n{lines}\n')
        return load_cell(path)

    return load


def found(cell, name):
    (finding,) = [f for f in tunnel(cell) if f.check == f"tunnel {name}"]
    return finding


@pytest.mark.parametrize("name", [n for n in names("cells") if n.startswith("snake_")])
def test_shipped_tunnels_are_fine(name):
    assert {f.status for f in tunnel(load_cell(name))} == {Severity.OK}


def test_a_plain_arm_has_nothing_to_judge():
    assert not list(tunnel(load_cell("pa10")))


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (
            "tunnel = [{ length = 0.08, bend = 3.0 }]",
            r"tunnel\[0\]: a radius of 0.02667 m is within the half width 0.03 m",
        ),
        ("tunnel = [{ length = 0.3, climb = 1.0 }]", r"tunnel\[0\].climb: a planar arm cannot"),
        ("tunnel = [{ length = 0.3, roll = 0.1 }]", r"tunnel\[0\].roll: a planar arm cannot"),
        (
            "tunnel = [{ length = 0.3, bend = 1.0, roll = 3.2 }]",
            r"tunnel\[0\].roll: value 3.2: .*less than or equal to 3.14",
        ),
        (
            "tunnel = [{ length = 0.3 }, { length = 0.1, open = true }, { length = 0.1 }]",
            "tunnel: open pieces come last",
        ),
        ("start = 0.6", r"start = 0.6 must be above least = 0.63"),
        ("half_width = 0.018", r"half_width = 0.018 must be above link_radius \+ clearance"),
    ],
)
def test_what_no_arm_can_follow_is_refused_when_it_is_read(changed, lines, words):
    with pytest.raises(ConfigError, match=words):
        changed(lines)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (
            f"entrance = {{ xyz = [0.1, 0.6, 0.0], {ENTRANCE} }}",
            r"backbone.entrance: must lie straight ahead of the first joint, along x: 0.16\d+ rad",
        ),
        ("least = 0.605", r"backbone.least: value 0.605: must be at least 1.02 times"),
        (
            "tunnel = [{ length = 0.4, bend = 3.1 }, { length = 0.4, bend = 2.8 }]",
            r"tunnel\[1\]: its centre line comes to 0.0\d+ m of that of tunnel\[0\]: at least",
        ),
        ("start = 1.6", r"backbone.start: value 1.6: the arm is 1.5000 m long"),
    ],
)
def test_what_this_arm_cannot_reach_is_refused(changed, lines, words):
    with pytest.raises(ConfigError, match=words):
        list(tunnel(changed(lines)))


@pytest.mark.parametrize(
    ("feed", "words"),
    [
        (
            '"j1", back = 0.0, front = 0.4',
            r"backbone.feed.joint: value j1: the chain begins with feed",
        ),
        (
            '"feed", back = 0.0, front = 0.5',
            r"backbone.feed.front: value 0.5: must be within -0.04 to 0.44, the range of feed",
        ),
        (
            '"feed", back = 0.4, front = 0.0',
            r"backbone.feed: must take the arm ahead from back to front, along the entrance's x",
        ),
        (
            '"feed", back = 0.0, front = 0.3',
            r"backbone.least: value 0.37: must be at least 1.02 times the way .*, 0.4500 m",
        ),
    ],
)
def test_a_feed_that_is_none_is_refused(changed, feed, words):
    with pytest.raises(ConfigError, match=words):
        list(tunnel(changed(f"feed = {{ joint = {feed} }}", extends="snake_feed")))


def wound(radius, pitch):
    """Return three pieces of a helix, a little more than a turn, and how far turns are apart."""
    rise = pitch / (2.0 * math.pi)
    square = radius**2 + rise**2
    length = 0.36 * 2.0 * math.pi * math.sqrt(square)
    turn = f"length = {length}, bend = {radius / square * length}, roll = {rise / square * length}"
    angle = np.linspace(math.pi, 3.0 * math.pi, 10_001)
    apart = np.sqrt(2.0 * radius**2 * (1.0 - np.cos(angle)) + (rise * angle) ** 2)
    return f"tunnel = [{', '.join([f'{{ {turn} }}'] * 3)}]", float(apart.min())


@pytest.mark.parametrize("pitch", [0.0, 0.04, 0.0602])
def test_a_helix_whose_turns_are_one_tunnel_is_refused_with_how_near_they_come(changed, pitch):
    lines, apart = wound(0.1, pitch)
    assert apart < 0.06
    words = (
        rf"tunnel\[2\]: its centre line comes to {apart:.4f} m of that of tunnel\[0\]: "
        "at least 0.06 m"
    )
    with pytest.raises(ConfigError, match=words):
        list(tunnel(changed(lines, extends="snake_space")))


def test_a_helix_whose_turns_are_apart_is_followed(changed):
    lines, apart = wound(0.15, 0.064)
    assert apart > 0.06
    assert list(tunnel(changed(lines, extends="snake_space")))


def test_a_bend_beyond_the_joints_range_names_joint_angle_and_depth(changed):
    sharp = "tunnel = [{ length = 0.13, bend = 3.14159 }, { length = 0.8 }]"
    finding = found(changed(sharp), "range")
    assert finding.status is Severity.ERROR
    assert abs(finding.values["angle"]) > 1.04


def test_a_bend_too_sharp_for_links_of_this_length_names_how_far_they_are_off(changed):
    finding = found(changed("half_width = 0.0225"), "walls")
    assert finding.status is Severity.WARN
    assert "3.2 mm off the centre line" in finding.text


def test_a_speed_that_joints_cannot_keep_names_the_speed_that_is_kept(changed):
    finding = found(changed("speed = 0.12"), "speed")
    assert finding.status is Severity.WARN
    assert 0.085 < finding.values["kept"] < 0.092


def test_a_start_that_is_no_posture_of_the_curve_is_an_error(changed):
    straight = f"[mechanism.postures]\nstart = {[0.0] * 30}\n"
    assert found(changed("", straight), "start").status is Severity.ERROR


def test_drive_gains_without_regard_to_what_is_outboard_are_an_error(changed):
    rig = "[rig.drive]\nstiffness = [100.0]\ndamping = [1.0]\nintegral = [1000.0]\n"
    finding = found(changed("", rig), "gains")
    assert finding.status is Severity.ERROR


@pytest.mark.parametrize(("times", "status"), [(1.0, Severity.OK), (2.0, Severity.ERROR)])
def test_gains_that_each_loop_takes_may_be_too_much_for_all_together(changed, times, status):
    integral = [times * gain for gain in load_cell("snake30").config.rig.drive.integral]
    finding = found(changed("", f"[rig.drive]\nintegral = {integral}\n"), "gains")
    assert finding.status is status
    assert finding.values["used"] == pytest.approx(0.5 * times, abs=0.05)
