"""A redefined frame moves nothing: judged by the physics, at a point that is fixed to the flange.

Each run is held against the same one without redefinitions. The force/torque sensor is without
noise: what a loop through it makes of the least difference would be 0.1 mm by itself.
"""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.server.control.spatial import Pose, pose_error, sizes
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ...conftest import shared
from ..conftest import Run

TOOL = {"xyz": [0.0, 0.0, 0.121], "rpy": [0.0, 0.0, 0.0]}
QUARTER = {"xyz": [0.0, 0.0, 0.121], "rpy": [0.0, 0.0, 1.5708]}
OTHER = {"xyz": [0.05, -0.04, 0.2], "rpy": [0.3, 1.2, -0.4]}
REST: list = []
MOTION = [
    {"at_s": 0.2, "cmd/position": {"xyz": [0.05, 0.12, 0.05], "rpy": [0.2, 0.5, 0.3],
                               "relative_to": "mrf", "expressed_in": "base"}},
    {"at_s": 0.3, "cmd/joystick": {"twist": [0.02, 0.06, 0.04, 0, 0, 0], "expressed_in": "base"}},
    {"at_s": 0.4, "rig/fault": {"kind": "hand", "target": "force_torque",
                                "vector": [3.0, 4.0, -2.0]}},
    {"at_s": 1.4, "rig/fault": {"kind": "hand", "target": "force_torque", "on": False}},
    {"at_s": 1.5, "cmd/joystick": {"twist": [0.0] * 6, "expressed_in": "base"}},
]  # fmt: skip


def cell(mode):
    quiet = {"mechanism.operation_mode": mode, "rig.force_torque.noise": (0.0,) * 6}
    return altered(load_cell("pa10_hand"), quiet)


def play(mode, steps, seconds=2.0):
    script = Script.model_validate({"duration_s": seconds, "step": steps})
    simulation = Simulation(cell(mode), script)
    return Run(simulation, simulation.run())


@shared
def undisturbed(mode, name):
    return play(mode, {"rest": REST, "motion": MOTION}[name])


def mrf(at_s, frame):
    return {"at_s": at_s, "operator/frame": {"frame": "mrf", **frame}}


ONCE = [mrf(0.7, QUARTER)]
OFTEN = [mrf(0.6 + 0.03 * i, TOOL if i % 2 else OTHER) for i in range(33)]


@pytest.mark.parametrize(
    ("mode", "name", "redefined"),
    [
        ("csp", "rest", ONCE),
        ("csp", "motion", OFTEN),
        ("csv", "motion", OFTEN),
        ("cst", "motion", OFTEN),
    ],
    ids=lambda value: value if isinstance(value, str) else f"{len(value)}",
)
def test_with_a_hand_followed_a_new_mrf_moves_nothing(mode, name, redefined):
    before = undisturbed(mode, name)
    run = play(mode, [*{"rest": REST, "motion": MOTION}[name], *redefined])
    assert run.summary["refused"] == []
    assert run.summary["mode"] == "enabled"
    errors = [
        sizes(pose_error(*(Pose.from_xyz_rpy(t.pose_mrf[:3], t.pose_mrf[3:]) for t in both)))
        for both in zip(before.truths, run.truths, strict=True)
    ]
    far, turned = np.max(errors, axis=0)
    assert far < 1e-4
    assert turned < 5e-4


def test_frames_that_change_33_times_a_second_leave_no_debt_behind():
    """Of turning about points far apart the arm is at rest half a second after the release."""
    far = {"xyz": [0.6, -0.2, 0.3], "rpy": [0.3, 1.2, -0.4]}
    turn = {"twist": [0.02, 0.06, 0.0, 0.0, 0.3, 0.2], "expressed_in": "base"}
    redefined = [mrf(0.4 + 0.03 * i, TOOL if i % 2 else far) for i in range(33)]
    release = {"at_s": 1.4, "cmd/joystick": {"twist": [0.0] * 6, "expressed_in": "base"}}
    run = play("csp", [{"at_s": 0.3, "cmd/joystick": turn}, *redefined, release], 2.5)
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    owed = np.array([s.sources["frames"] for s in run.states])
    assert np.abs(owed).max() < 1e-9
    assert np.abs(run.speeds(2.0, 2.5)).max() < 0.02


def test_what_is_said_in_the_same_period_is_about_the_new_mrf():
    """The displacement of a target is from where the new MRF is, not from where the old one was."""
    target = {"xyz": [0.0, 0.0, 0.03], "rpy": [0, 0, 0], "relative_to": "mrf"}
    steps = [
        {"at_s": 0.5, "operator/frame": {"frame": "mrf", **OTHER}},
        {"at_s": 0.5, "cmd/position": target},
    ]
    run = play("csp", steps, 0.7)
    tool, other = (Pose.from_xyz_rpy(f["xyz"], f["rpy"]) for f in (TOOL, OTHER))
    there = Pose.from_xyz_rpy(run.at(0.48).pose_mrf[:3], run.at(0.48).pose_mrf[3:])
    target = Pose.from_xyz_rpy(run.at(0.6).target_mrf[:3], run.at(0.6).target_mrf[3:])
    way = (there @ tool.inverse() @ other).inverse() @ target
    np.testing.assert_allclose(way.p, [0.0, 0.0, 0.03], atol=1e-3)
    np.testing.assert_allclose(way.R, np.eye(3), atol=2e-3)


def test_an_mrf_aside_of_the_tool_is_refused_while_it_presses_and_nothing_bounces(pa10):
    """0.6 m aside, accommodation about the MRF would be 16 times as quick as the wall bears."""
    steps = [
        {"at_s": 0.2, "cmd/posture": {"posture": "ready"}},
        {"at_s": 3.0, "cmd/joystick": {"twist": [0.05, 0, 0, 0, 0, 0], "expressed_in": "base"}},
        {"at_s": 4.6, "cmd/joystick": {"twist": [0.0075, 0, 0, 0, 0, 0], "expressed_in": "base"}},
        mrf(6.0, {"xyz": [0.0, 0.6, 0.121]}),
    ]
    script = Script.model_validate({"duration_s": 7.0, "step": steps})
    simulation = Simulation(pa10, script)
    run = Run(simulation, simulation.run())
    assert [e.values["reason"] for e in run.events("request_refused")] == ["unstable_frame"]
    start = simulation.player.start_s
    pressed = [np.linalg.norm(t.contact_force) for t in run.truths if t.time_s - start > 6.0]
    assert min(pressed) > 8.0
    assert max(pressed) < 13.0
