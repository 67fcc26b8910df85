"""Frames that move and are redefined, judged by the physics: where tool, Base and Carrier were."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.server.control.spatial import Pose, pose_error, rotation_log
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

from ...conftest import shared
from ..conftest import Run

CELLS = {"conveyor": "pa10_platform", "platform": "pa10_platform", "frames_here": "pa10"}


@shared
def shown(name):
    simulation = Simulation(load_cell(CELLS[name]), load_script(name))
    return Run(simulation, simulation.run())


@pytest.fixture(scope="module")
def cell():
    return load_cell("pa10_platform")


def pose(six):
    return Pose.from_xyz_rpy(six[:3], six[3:])


def norm(vectors):
    return np.linalg.norm(vectors, axis=-1)


def window(run, start_s, end_s):
    """Return states and truths between two times of the script."""
    since = run.simulation.player.start_s
    both = zip(run.states, run.truths, strict=True)
    return [(s, t) for s, t in both if start_s <= s.time_s - since < end_s]


def on_carrier(truth):
    return pose(truth.frames["carrier"]).inverse() @ pose(truth.pose_mrf)


def accelerations(run):
    """Return the commanded joint accelerations (k, n), as shares of their bounds."""
    drives = run.simulation.cell.config.mechanism.drives
    dq = np.array([s.dq_command for s in run.states])
    return np.diff(dq, axis=0) / 0.01 / [d.max_acceleration for d in drives]


@pytest.mark.parametrize("name", CELLS)
def test_every_script_plays_without_refusal_fault_or_violation(name):
    run = shown(name)
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    assert [e for e in run.simulation.events if e.severity != "info"] == []


@pytest.mark.parametrize("name", CELLS)
def test_the_twists_in_telemetry_add_up_to_the_sum(name):
    for state, _ in window(shown(name), 2.7, 20.0):
        total = np.sum(list(state.sources.values()), axis=0)
        np.testing.assert_allclose(total, state.twist, rtol=0, atol=1e-15)


# --- a CRF that moves -----------------------------------------------------------------------------


def test_a_target_on_a_conveyor_is_kept_without_a_steady_error():
    """At 0.1 m/s, from noisy poses that come 40 ms late: the mean tells lag, the rest noise."""
    run = shown("conveyor")
    states, truths = zip(*window(run, 5.5, 6.9), strict=True)
    speed = (truths[-1].frames["carrier"][1] - truths[0].frames["carrier"][1]) / 1.39
    assert speed == pytest.approx(0.1, rel=0.01)
    error = np.array([on_carrier(t).p for t in truths]) - [0.0, 0.0, 0.05]
    assert norm(error.mean(axis=0)) < 3e-4
    assert norm(error).max() < 2e-3
    frames = np.array([s.sources["frames"] for s in states])
    np.testing.assert_allclose(frames.mean(axis=0)[:3], [0.0, 0.1, 0.0], atol=2e-3)
    assert {s.ground for s in states} == {"carrier"}


def test_a_stick_pushes_the_tool_aside_on_the_conveyor_and_on_release_it_comes_back():
    run = shown("conveyor")
    aside = on_carrier(window(run, 8.45, 8.5)[0][1]).p - [0.0, 0.0, 0.05]
    assert aside[0] < -0.015
    assert aside[2] > 0.015
    assert abs(aside[1]) < 2e-3
    back = np.array([on_carrier(t).p for _, t in window(run, 12.0, 13.0)]) - [0.0, 0.0, 0.05]
    assert norm(back.mean(axis=0)) < 3e-4
    assert run.summary["tool_error_m"] < 2e-3


CRF_ON_CARRIER = {"frame": "crf", "moves_with": "carrier", "relative_to": "carrier"}
MOVING = [
    {"at_s": 0.1, "operator/frame": CRF_ON_CARRIER},
    {"at_s": 0.2, "rig/motion": {"target": "carrier", "twist": [0.0, 0.08, 0.0, 0.0, 0.0, 0.0]}},
]


def played(cell, steps, seconds):
    script = Script.model_validate({"duration_s": seconds, "step": steps})
    simulation = Simulation(cell, script)
    return Run(simulation, simulation.run())


def test_without_a_goal_the_tool_moves_along_with_what_the_crf_is_fixed_to(cell):
    run = played(cell, MOVING, 2.5)
    (_, before), *_, (_, after) = window(run, 1.5, 2.5)
    moved = on_carrier(after).p - on_carrier(before).p
    assert norm(moved) < 2e-3
    assert after.pose_mrf[1] - before.pose_mrf[1] == pytest.approx(0.079, abs=2e-3)


def test_hold_holds_the_joints_whatever_the_crf_does(cell):
    run = played(cell, [*MOVING, {"at_s": 1.5, "operator/mode": {"action": "hold"}}], 3.0)
    assert run.summary["mode"] == "hold"
    held = np.array([s.q_command for s, _ in window(run, 2.3, 3.0)])
    assert not np.ptp(held, axis=0).any()
    assert not any(s.sources["frames"][1] for s, _ in window(run, 2.3, 3.0))


def test_a_conveyor_that_falls_silent_is_no_longer_followed_and_news_brings_it_back(cell):
    silent = [
        {"at_s": 2.0, "rig/fault": {"kind": "silence", "target": "carrier"}},
        {"at_s": 3.5, "rig/fault": {"kind": "silence", "target": "carrier", "on": False}},
    ]
    run = played(cell, [*MOVING, *silent], 6.0)
    (lost,) = run.events("frame_lost")
    assert lost.values == {"frame": "carrier", "reason": "no_news"}
    stood = [s for s, _ in window(run, 3.0, 3.4)]
    carried = np.array([s.sources["frames"] for s in stood])
    assert norm(carried.mean(axis=0)[:3]) < 5e-3  # what is left is the noise of Base
    assert all(s.frame_age_ticks["carrier"] is None for s in stood)
    ahead = np.array([s.frames["carrier"][1] - t.frames["carrier"][1]
                      for s, t in window(run, 5.5, 6.0)])  # fmt: skip
    assert np.abs(ahead).max() < 2e-3
    after = np.abs(accelerations(run)).max()
    assert after < 1.001
    assert run.summary["limit_violations"] == 0


# --- a Base that moves ----------------------------------------------------------------------------


def test_a_tool_keeps_its_pose_in_world_on_a_platform_that_sways():
    run = shown("platform")
    at = pose(window(run, 3.7, 3.9)[0][1].pose_mrf)
    swaying = [t for _, t in window(run, 7.0, 15.0)]
    # What the sway would do to a tool that stands in Base: the lever times the yaw counts, too.
    base = [pose(t.frames["base"]) for t in swaying]
    carried = [b @ (base[0].inverse() @ at) for b in base]
    sway = np.ptp([c.p[1] for c in carried])
    assert sway > 0.14
    error = np.array([pose(t.pose_mrf).p - at.p for t in swaying])
    turned = np.array([rotation_log(at.R.T @ pose(t.pose_mrf).R) for t in swaying])
    assert norm(error).max() < 4e-3
    assert np.ptp(error[:, 1]) < sway / 30.0
    assert norm(turned).max() < 4e-3
    # It drifts, too, by 8 mm/s: no lag is left of that.
    assert abs(error.mean(axis=0)[0]) < 5e-4


def test_a_platform_whose_twist_is_measured_is_made_up_for_still_better(cell):
    steps = load_script("platform").steps
    run = played(altered(cell, {"rig.frames.twists": True}), steps, 12.0)
    at = pose(window(run, 3.7, 3.9)[0][1].pose_mrf).p
    error = np.array([pose(t.pose_mrf).p - at for _, t in window(run, 7.0, 12.0)])
    before = [pose(t.pose_mrf).p - at for _, t in window(shown("platform"), 7.0, 12.0)]
    assert error[:, 1].std() < 0.8 * np.std(before, axis=0)[1]


def test_the_sensors_weight_is_taken_off_in_the_bases_true_attitude(cell):
    """A platform that leans by 0.2 rad turns the tool's weight in the sensor: 1.9 N of 9.6 N."""
    lean = {
        "at_s": 0.2,
        "rig/motion": {
            "target": "platform",
            "sway": [0.0, 0.0, 0.0, 0.2, 0.0, 0.0],
            "period_s": 8.0,
        },
    }
    on_base = {"at_s": 0.1, "operator/frame": {"frame": "crf", "moves_with": "base"}}
    run = played(cell, [on_base, lean], 5.0)
    attitudes = [t.frames["base"][3] for _, t in window(run, 1.0, 5.0)]
    assert max(attitudes) > 0.15
    forces = np.array([s.wrench_mrf[:3] for s, _ in window(run, 1.0, 5.0)])
    assert norm(forces).max() < 0.8
    # The CRF is fixed to Base: at rest, the joints stand.
    joints = np.array([s.q_command for s, _ in window(run, 1.0, 5.0)])
    assert np.ptp(joints, axis=0).max() < 0.02


# --- frames that are redefined --------------------------------------------------------------------


@pytest.mark.parametrize("at_s", [2.8, 3.8, 4.7, 7.2, 12.0])
def test_no_redefinition_makes_the_joints_jump(at_s):
    """Also under way and in contact: 0.9 of the bounds is what the stick's own start takes."""
    run = shown("frames_here")
    share = accelerations(run)
    since = run.simulation.player.start_s
    near = [i for i, s in enumerate(run.states[1:]) if abs(s.time_s - since - at_s - 0.1) < 0.12]
    assert np.abs(share[near]).max() < 0.5
    jerk = [d.max_jerk / d.max_acceleration for d in run.simulation.cell.config.mechanism.drives]
    assert (np.abs(np.diff(share[near], axis=0)) / 0.01 <= np.array(jerk) * 1.001).all()


def test_a_target_stays_the_wrists_when_the_mrf_is_another():
    run = shown("frames_here")
    before = pose(window(run, 3.7, 3.79)[0][0].target_mrf)
    middle = pose(window(run, 4.0, 4.1)[0][0].target_mrf)
    behind = before @ Pose(np.eye(3), np.array([0.0, 0.0, -0.1]))
    np.testing.assert_allclose(middle.p, behind.p, atol=1e-9)
    after = pose(window(run, 6.4, 6.49)[0][1].pose_mrf)
    np.testing.assert_allclose(after.p, before.p, atol=2e-3)  # the stick's push is forgotten


def test_here_is_where_the_tool_stood_and_a_target_stays_when_the_crf_is_another():
    run = shown("frames_here")
    here, there = run.at(2.75), window(run, 9.7, 9.79)[0]
    away = pose_error(pose(run.at(2.9).pose_crf), pose(here.pose_mrf))
    np.testing.assert_allclose(away, 0.0, atol=1e-4)
    way = np.array(there[1].pose_mrf[:3]) - here.pose_mrf[:3]
    np.testing.assert_allclose(way, [0.083, 0.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(there[0].pose_crf[:3], [0.3, 0.1, 0.2], atol=1e-9)


def test_a_desired_force_in_worlds_axes_is_kept_when_the_mrf_is_another():
    run = shown("frames_here")
    for start_s in (11.5, 12.0, 13.0):
        forces = [t.contact_force[0] for _, t in window(run, start_s, start_s + 0.9)]
        assert np.mean(forces) == pytest.approx(8.0, abs=0.4)
        assert max(forces) < 10.0
    assert run.at(13.5).wrench_mrf[2] == pytest.approx(8.0, abs=0.6)
