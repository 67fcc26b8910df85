"""Workspace boundaries and singularities: pushed into, and left again."""

import numpy as np
import pytest

SPEED = 0.1


def outward(run):
    """The level direction from the Base's axis to the tool, and away."""
    out = np.array([run.pose.p[0], run.pose.p[1], 0.0])
    return out / np.linalg.norm(out)


def pushed_out(run, stick, seconds=5.0):
    """Push beyond the arm's reach; return the direction."""
    direction = outward(run)
    run.go(seconds, stick=stick(*(0.4 * direction), 0, 0, 0))
    return direction


def test_pushed_beyond_its_reach_the_arm_comes_to_rest_and_says_why(run, stick):
    direction = pushed_out(run, stick, 8.0)
    output = run.outputs[-1]
    assert {"singularity"} & set(output.limits) or any("joint_limit" in x for x in output.limits)
    J = run.arm.mechanism.kinematics(output.q, run.settings.T_wrist_mrf).J
    assert abs(J[:3] @ output.dq @ direction) < 0.02
    assert (np.abs(output.dq) < 0.2 * run.arm.p.joints.velocity).all()
    run.observe()


@pytest.mark.parametrize("seconds", [5.0, 20.0])
def test_from_the_end_of_its_reach_the_arm_comes_back_at_once(run, stick, seconds):
    direction = pushed_out(run, stick, seconds)
    run.go(0.5)
    before = run.pose.p
    run.go(0.3, stick=stick(*(-SPEED * direction), 0, 0, 0))
    there = run.pose.p
    assert (there - before) @ direction < 0
    for _ in range(100):
        last = run.pose.p
        run.tick(stick=stick(*(-SPEED * direction), 0, 0, 0))
        assert (run.pose.p - last) @ direction / run.arm.p.period_s <= -0.5 * SPEED
    run.observe()


@pytest.mark.parametrize("bend", [0.0, 1e-6, 1e-3, 0.03])
def test_an_arm_that_starts_straight_can_be_pulled_back(arm, start, stick, bend):
    """From σ = 0 exactly, and from next to it."""
    q = arm.posture("ready").copy()
    q[3 if arm.p.n == 7 else 2] = bend
    run = start(arm, q)
    shoulder = np.array([0.0, 0.0, 0.16 if arm.p.n == 6 else 0.315])
    wrist = run.pose.p - shoulder
    inward = -wrist / np.linalg.norm(wrist)
    for _ in range(100):
        output = run.tick(stick=stick(*(SPEED * inward), 0, 0, 0))
    moved = (run.pose.p - output.T_world_mrf.p) @ inward / arm.p.period_s
    assert moved >= 0.5 * SPEED
    run.observe()


def test_the_tool_passes_the_wrists_singularity(ur5e, start, stick):
    """Turning right through it, joints neither jump nor stand."""
    q = ur5e.posture("ready").copy()
    q[4] = 0.25
    run = start(ur5e, q)
    J = ur5e.mechanism.kinematics(q, ur5e.settings.T_wrist_mrf).J
    turn = J[3:, 4] / np.linalg.norm(J[3:, 4])
    run.go(2.0, stick=stick(0, 0, 0, *(-0.4 * turn)))
    assert run.outputs[-1].q[4] < -0.2
    smallest = min(o.found.sigma_min for o in run.outputs)
    assert smallest < ur5e.p.resolve.floor
    run.observe()


@pytest.mark.parametrize("seed", range(3))
def test_near_singularities_the_tool_leaves_its_line_little(arm, start, stick, seed):
    """Damping slows and bends a little; it throws the tool nowhere."""
    rng = np.random.default_rng(seed)
    run = start(arm)
    direction = np.array([*rng.normal(size=2), 0.3])
    direction /= np.linalg.norm(direction)
    before = run.pose.p
    run.go(4.0, stick=stick(*(0.2 * direction), 0, 0, 0))
    moved = run.pose.p - before
    assert moved @ direction > 0.02
    run.observe()
