import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.config.schema.null_space import OBJECTIVES
from telerobot.server.control.arm import Arm as ArmControl
from telerobot.server.control.inputs import ObjectiveGains
from telerobot.server.control.mechanism.model import Dynamics
from telerobot.server.control.mechanism.objectives import View
from telerobot.server.control.mechanism.potentials import manipulability_slope
from telerobot.server.control.mechanism.redundancy import Redundancy
from telerobot.server.control.parameters import Parameters
from telerobot.server.control.tick import Control

OFF = dict.fromkeys(OBJECTIVES, 0.0)
SWUNG = np.array([0.3, 0.0, -0.4, 0.0, 0.3, 0.1, 0.0])
"""From `ready`: the elbow swung aside [rad]."""


@pytest.fixture
def swung(pa10, start):
    """A run with the elbow aside, its null space idle."""
    run = start(pa10, pa10.posture("ready") + SWUNG)
    run.set(objectives=objectives(run))
    return run


def redundancy_of(p, mechanism):
    dynamics = Dynamics(mechanism, p.rotor_inertia, p.T_wrist_sensor)
    return Redundancy(p.joints, dynamics, p.redundancy, p.pull_posture)


def objectives(run, to="ready", **gains):
    return ObjectiveGains(OFF | gains, run.arm.posture(to))


def null_space(run):
    J = run.arm.mechanism.kinematics(run.sent[-1], run.settings.T_wrist_mrf).J
    return np.eye(run.arm.p.n) - np.linalg.pinv(J) @ J


def held(run, before):
    """The tool did not notice."""
    assert np.linalg.norm(run.pose.p - before.p) < 2e-3
    np.testing.assert_allclose(run.pose.R, before.R, atol=5e-3)
    run.observe()


def test_an_objective_that_is_off_is_not_computed(swung, monkeypatch):
    monkeypatch.setattr(swung.arm.mechanism, "mass_matrix", None)
    output = swung.go(0.3, stick=None)
    assert output.found.self_motion.norms == {}
    assert not output.dq.any()


def test_manipulability_rises_until_its_slope_in_the_null_space_is_flat(swung):
    control, before = swung.arm.control, swung.pose
    swung.set(objectives=objectives(swung, manipulability=10.0))

    def w():
        k = control.arms[0].mechanism.kinematics(swung.sent[-1], swung.settings.T_wrist_mrf)
        return manipulability_slope(k.J)[0]

    found = [w()]
    for _ in range(8):
        swung.go(2.0)
        found.append(w())
    assert (np.diff(found) > -1e-7).all()
    assert found[-1] > 1.01 * found[0]
    held(swung, before)


def test_a_posture_takes_what_freedom_is_left(swung):
    before = swung.pose
    swung.set(objectives=objectives(swung, posture=1.0))
    swung.go(12.0)
    away = swung.arm.posture("ready") - swung.sent[-1]
    assert np.linalg.norm(null_space(swung) @ away) < 1e-3
    assert np.linalg.norm(away) < np.linalg.norm(SWUNG)
    held(swung, before)


def test_least_energy_moves_the_tool_alike_with_less_of_it(pa10, start, stick):
    energies, tools = [], []
    for share in (0.0, 1.0):
        run = start(pa10, pa10.posture("ready") + SWUNG)
        run.set(objectives=objectives(run, least_energy=share))
        total = 0.0
        for _ in range(150):
            output = run.tick(stick=stick(-0.03, 0.05, 0.02, 0.0, 0.1, 0.0))
            M = pa10.mechanism.mass_matrix(output.q)
            total += 0.5 * output.dq @ M @ output.dq
        run.observe()
        energies.append(total)
        tools.append(run.pose)
    assert energies[1] < 0.98 * energies[0]
    np.testing.assert_allclose(tools[0].p, tools[1].p, atol=1e-3)


def test_the_sum_of_all_keeps_its_own_speed_bound(swung):
    swung.set(
        objectives=objectives(swung, "park", mid_range=10.0, manipulability=10.0, posture=10.0)
    )
    bound = swung.arm.p.redundancy.max_rate * swung.arm.p.joints.velocity
    output = swung.go(0.5)
    assert (np.abs(output.found.self_motion.dq) <= bound * (1 + 1e-9)).all()
    assert np.abs(output.found.self_motion.dq / bound).max() == pytest.approx(1.0)
    assert set(output.found.self_motion.norms) == {"mid_range", "manipulability", "posture"}


@pytest.mark.parametrize("factor", [1.0, 0.3])
@pytest.mark.parametrize("task", [0.0, 0.5, 3.0])
def test_self_motion_is_the_projected_sum_as_far_as_its_bound_and_the_task_leave_room(
    pa10, rng, factor, task
):
    redundancy, p, q = redundancy_of(pa10.p, pa10.mechanism), pa10.p, pa10.posture("ready") + SWUNG
    V = factor * p.joints.velocity
    for size in (1e-3, 1.0, 100.0):
        J = rng.normal(size=(6, 7))
        null, dq_task = np.linalg.svd(J)[2][6:], task * V * rng.uniform(-1.0, 1.0, 7)
        asked = {name: size * rng.normal(size=7) for name in ("field", "spheres")}
        gains = {"field": 0.7, "spheres": 1.3, "posture": 2.0}
        objectives = ObjectiveGains(OFF | gains, np.zeros(7))
        found = redundancy.rate(
            View(q, J, dq_task, null, objectives.posture, asked), objectives, factor
        )
        P = np.eye(7) - np.linalg.pinv(J) @ J
        parts = {name: gains[name] * P @ z for name, z in (asked | {"posture": -q}).items()}
        free = sum(parts.values())
        # As much of it as fits: of every joint, then beside the task's rates, slowed as a whole.
        bound = p.redundancy.max_rate * V
        share = min(1.0, (bound / np.abs(free)).min())
        slowed = dq_task / max(1.0, (np.abs(dq_task) / V).max())
        room = np.where(free > 0.0, V - slowed, V + slowed)
        share *= min(1.0, (np.maximum(room, 0.0) / np.abs(share * free)).min())
        np.testing.assert_allclose(found.dq, share * free, rtol=1e-9, atol=1e-12)
        for name, part in parts.items():
            assert found.norms[name] == pytest.approx(share * np.linalg.norm(part), rel=1e-9)


def test_gains_and_posture_change_while_running_without_a_jump(swung, rng):
    swung.tick()
    for _ in range(15):
        gains = {name: float(rng.choice([0.0, 0.5, 3.0])) for name in OFF}
        gains["least_energy"] = min(gains["least_energy"], 1.0)
        named = str(rng.choice(["ready", "start", "park"]))
        swung.set(objectives=objectives(swung, named, **gains))
        before = swung.outputs[-1].found.self_motion.dq
        first = swung.tick().found.self_motion.dq
        assert np.abs(first - before).max() < 0.15
        swung.go(0.4)
    swung.observe()


def test_a_changed_gain_is_ramped_and_told(swung):
    swung.go(0.1)
    swung.set(objectives=objectives(swung, posture=1.0))
    told = [swung.tick().objectives.gains["posture"] for _ in range(300)]
    assert (np.diff(told) >= 0).all()
    assert told[14] == pytest.approx(1.0 - np.exp(-1.0), abs=1e-6)
    assert told[-1] == 1.0


def test_a_cell_says_what_the_null_space_is_for(pa10, start):
    p = Parameters.from_cell(
        altered(
            pa10.cell,
            {
                "redundancy.mid_range": 0.0,
                "redundancy.posture": 2.0,
                "redundancy.posture_name": "park",
            },
        )
    )
    found = redundancy_of(p, pa10.mechanism).objectives
    assert found.gains == OFF | {"posture": 2.0, "reflex": 1.0}
    np.testing.assert_array_equal(found.posture, pa10.posture("park"))
    seeded = Control([ArmControl(p, pa10.mechanism)]).seed(pa10.posture("ready"))
    assert seeded.arms[0].objectives is not None


def test_six_joints_have_nothing_spare(ur5e, start):
    run = start(ur5e, ur5e.posture("ready"))
    run.set(objectives=objectives(run, "park", posture=5.0, manipulability=5.0, mid_range=5.0))
    output = run.go(0.5)
    assert not output.found.self_motion.dq.any()
    np.testing.assert_array_equal(output.q, run.q)
