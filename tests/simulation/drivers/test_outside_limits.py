"""Joints that stand outside their limits: enabling moves nothing, and they only come back in."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

CASES = {"csp": "pa10", "csv": "pa10", "cst": "pa10_hand_torque"}
W1, S1 = 5, 0
"""Joints that can be beyond their limits without the arm touching itself."""


def standing(mode, joint, beyond, sense=1):
    """Return a cell whose arm starts with a joint beyond a limit [rad], and where it is."""
    cell = load_cell(CASES[mode])
    limit = cell.robot.joints[joint]
    q = np.array(cell.config.mechanism.postures["ready"])
    q[joint] = limit.upper + beyond if sense > 0 else limit.lower - beyond
    start = {"mechanism.operation_mode": mode, "mechanism.postures.start": tuple(q)}
    return altered(cell, start), q


def played(cell, *steps, seconds):
    """Return a finished simulation, and the joints (k, n) in every physics step of it [rad]."""
    simulation = Simulation(
        cell, Script.model_validate({"duration_s": seconds, "step": list(steps)})
    )
    way = []
    simulation.on_physics = lambda s: way.append(s.rig.world.q.copy())
    result = simulation.run()
    assert result.ok, result.summary
    assert result.summary["mode"] == "enabled"
    return simulation, np.array(way)


def told(simulation, name):
    return [e for e in simulation.events if e.name == name]


@pytest.mark.parametrize("mode", CASES)
@pytest.mark.parametrize(
    ("joint", "sense", "beyond"),
    [(W1, -1, 0.005), (W1, -1, 0.03), (S1, 1, 0.1), (W1, -1, 0.0)],
)
def test_enabling_moves_nothing_wherever_the_joints_stand(mode, joint, sense, beyond):
    cell, q = standing(mode, joint, beyond, sense)
    simulation, way = played(cell, seconds=0.4)
    assert np.abs(way - q).max() < 1e-3
    found = told(simulation, "outside_limit")
    assert len(found) == (beyond > 0)
    for event in found:
        assert event.values["joint"] == cell.robot.joints[joint].name
        assert event.values["beyond_rad"] == pytest.approx(beyond, abs=1e-4)


@pytest.mark.parametrize("name", ["pa10_hand", "pa10_pair", "pa10_platform", "snake_space"])
def test_enabling_moves_nothing_in_other_bodies_either(name):
    cell = load_cell(name)
    rig = cell.config.rig
    if (
        rig.frames is not None
    ):  # the noise of a Base's pose is followed by the tool that holds World
        frames = rig.frames.model_copy(update={"noise": (0.0, 0.0)})
        rig = rig.model_copy(update={"frames": frames})
        cell = altered(cell, {"rig": rig})
    _, way = played(cell, seconds=0.4)
    assert np.abs(way - way[0]).max() < 1e-3


STICK = {"twist": [0.0, 0.05, 0.0, 0.0, 0.0, 0.2], "expressed_in": "base"}
JOG = [0.0] * 7


def jog(joint, rate):
    return {"cmd/jog": {"rates": [*JOG[:joint], rate, *JOG[joint + 1 :]]}}


@pytest.mark.parametrize("mode", CASES)
@pytest.mark.parametrize(
    ("what", "step"),
    [
        ("jog", jog(W1, 0.3)),
        ("posture", {"cmd/posture": {"posture": "ready"}}),
        ("stick", {"cmd/joystick": STICK}),
    ],
)
def test_a_joint_outside_comes_back_in_at_bounded_rates_and_never_goes_further_out(
    mode, what, step
):
    beyond = 0.03
    cell, q = standing(mode, W1, beyond, sense=-1)
    simulation, way = played(cell, {"at_s": 0.1, **step}, seconds=1.0)
    w1, bound = way[:, W1], cell.config.mechanism.drives[W1].max_velocity
    assert w1.min() > q[W1] - 1e-3
    assert np.abs(np.diff(w1)).max() / simulation.rig.dt < 1.05 * bound
    commanded = np.array([s.q_command[W1] for s in simulation.states if s.mode == "enabled"])
    assert np.diff(commanded).min() >= -1e-9 or commanded.min() > cell.robot.joints[W1].lower
    if what != "stick":  # which may have no need of this joint
        assert w1[-1] > cell.robot.joints[W1].lower


@pytest.mark.parametrize("beyond", [0.03, -0.01])
def test_jogged_outwards_a_joint_at_its_limit_stands_and_so_do_the_others(beyond):
    cell, q = standing("csp", W1, beyond, sense=-1)
    simulation, way = played(cell, {"at_s": 0.2, **jog(W1, -0.3)}, seconds=1.0)
    assert np.abs(way - q).max() < 1e-3
    assert any("joint_limit:w1" in s.limits for s in simulation.states)


def test_a_stop_on_the_way_in_leads_inwards():
    cell, _ = standing("csp", W1, 0.1, sense=-1)
    steps = {"at_s": 0.2, **jog(W1, 0.5)}, {"at_s": 0.3, "operator/mode": {"action": "hold"}}
    simulation = Simulation(cell, Script.model_validate({"duration_s": 1.0, "step": steps}))
    result = simulation.run()
    assert result.summary["mode"] == "hold"
    assert result.summary["limit_violations"] == 0
    commanded = [s.q_command[W1] for s in simulation.states if s.mode in ("enabled", "stopping")]
    assert np.diff(commanded).min() >= -1e-9
    assert commanded[-1] - commanded[0] > 0.005


def test_the_next_enable_takes_the_drives_room_back_once_the_joint_is_inside():
    cell, _ = standing("csp", W1, 0.03, sense=-1)
    simulation, _ = played(
        cell,
        {"at_s": 0.2, **jog(W1, 0.3)},
        {"at_s": 1.2, "operator/mode": {"action": "disable"}},
        {"at_s": 1.8, "operator/mode": {"action": "enable"}},
        seconds=2.5,
    )
    drive = simulation.rig.drives["w1"]
    limits = sorted(drive.objects[0x607D, i] / drive.drive.counts_per_radian for i in (1, 2))
    limit = cell.robot.joints[W1]
    assert limits == pytest.approx([limit.lower, limit.upper], abs=1e-4)
    assert len(told(simulation, "outside_limit")) == 1
