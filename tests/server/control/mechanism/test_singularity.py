"""Singular is not a fault: nothing raises, nothing jumps, and every arm can come back."""

import numpy as np
import pytest
from laboratory.campaign.kernels.crossings import Singular, arms
from pydantic import ValidationError
from telerobot.config.load import load_cell
from telerobot.config.schema.cell import ResolveSection
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.mechanism.resolution import resolve
from telerobot.server.control.spatial import Pose, pose_error

from ..chains import CHAINS

HERE = Pose.identity()
P = ResolveSection()
W = np.diag([1.0] * 3 + [P.characteristic_length] * 3)


@pytest.fixture(params=CHAINS, name="chain")
def _chain(request):
    """Return each chain that does not reach all axes, and how many it does."""
    return CHAINS[request.param]


# Thirty joints in a plane are singular only where all are straight: no draw gets there.
@pytest.mark.parametrize("name", [name for name in arms() if name not in ("snake", "snake_feed")])
def test_rates_do_not_jump_where_an_arm_crosses_a_singularity(name):
    """`make campaign ARGS="--only crossings"` tries more."""
    cell = load_cell(name)
    arm, rng = Singular(Mechanism.from_cell(cell), cell), np.random.default_rng(4)
    crossings = 0
    for _ in range(25):
        jumps, crossed = arm.line(rng).jumps()
        assert jumps == []
        crossings += crossed
    # Thirty joints are seldom singular; ways along joints beside the chain cross nothing.
    seldom = bool(cell.config.mechanism.beside_chain)
    assert crossings > (5 if seldom else 10 if len(cell.robot.joints) < 20 else 1)


@pytest.mark.parametrize("name", ["planar of five", "five joints", "planar of three"])
def test_nor_where_one_that_does_not_reach_all_axes_does(name):
    arm, rng = Singular(CHAINS[name][0], load_cell("pa10")), np.random.default_rng(5)
    assert [arm.line(rng).jumps()[0] for _ in range(15)] == [[]] * 15


def bound(p: ResolveSection) -> float:
    """Return the greatest gain that the documentation of the damping allows [1/m]."""
    return float(1.0 / (2.0 * p.damping * np.sqrt(1.0 - (p.damping / p.singular_region) ** 2)))


def test_exactly_singular_postures_are_answered_within_the_bound(arm, rng):
    """All joints at multiples of a right angle: singular several times over."""
    p, mechanism = arm.p.resolve, arm.mechanism
    right = np.pi / 2 * rng.integers(-1, 3, (200, arm.p.n))
    for q in (*right, np.zeros(arm.p.n)):
        J = mechanism.kinematics(q, arm.settings.T_wrist_mrf).J
        for twist in (*0.1 * np.eye(6), 0.1 * rng.normal(size=6)):
            dq = resolve(J, twist, p).dq
            assert np.linalg.norm(dq) <= bound(p) * np.linalg.norm(W @ twist) * (1.0 + 1e-9)


def test_an_arm_that_does_not_reach_all_axes_is_known_to_be_one(chain, arm):
    mechanism, rank = chain
    assert mechanism.rank == rank
    assert arm.mechanism.rank == 6


def test_what_it_reaches_it_does_and_the_rest_it_leaves(chain, rng):
    """Of a stick with parts along all axes, the answer is that of least squares."""
    mechanism, rank = chain
    regular = 0
    for _ in range(40):
        J = mechanism.kinematics(rng.uniform(-2.5, 2.5, mechanism.n), HERE).J
        twist = 0.1 * rng.normal(size=6)
        found = resolve(J, twist, P, rank=rank)
        s = np.linalg.svd(W @ J, compute_uv=False)
        assert found.sigma_min == pytest.approx(s[rank - 1], abs=1e-12)
        assert found.null.shape == (mechanism.n - rank, mechanism.n)
        np.testing.assert_allclose(J @ found.null.T, 0.0, atol=1e-9)
        if s[rank - 1] > 2.0 * P.singular_region:
            regular += 1
            expected = np.linalg.pinv(W @ J, rcond=1e-9) @ W @ twist
            np.testing.assert_allclose(found.dq, expected, atol=1e-9)
            assert not found.singular
    assert regular > 0


@pytest.mark.parametrize(("name", "joints"), [("planar of three", 3), ("planar of five", 5)])
@pytest.mark.parametrize("z", [0.0, 0.05])
def test_a_straight_planar_arm_comes_back_with_a_stick_that_is_not_in_its_plane(name, joints, z):
    mechanism, rank = CHAINS[name]
    q = np.zeros(joints)
    reach = mechanism.kinematics(q, HERE).T_world_mrf.p[0]
    for _ in range(100):
        J = mechanism.kinematics(q, HERE).J
        q = q + 0.01 * resolve(J, np.array([-0.1, 0, z, 0, 0, 0]), P, rank=rank).dq
    assert mechanism.kinematics(q, HERE).T_world_mrf.p[0] < reach - 0.05


@pytest.mark.parametrize("wrong", [{"damping": 0.05}, {"damping": 0.08}, {"floor": 0.06}])
def test_a_damping_that_bounds_nothing_is_refused(wrong):
    """At λm = σ0 its bound is infinite, beyond it is none."""
    ((name, value),) = wrong.items()
    with pytest.raises(ValidationError, match=f"{name} = {value} must be below singular_region"):
        ResolveSection(**wrong)


@pytest.mark.parametrize("damping", [0.001, 0.02, 0.049])
@pytest.mark.parametrize("region", [0.05, 0.3])
def test_every_damping_that_is_allowed_keeps_its_bound(pa10, rng, damping, region):
    p = ResolveSection(damping=damping, singular_region=region)
    for _ in range(150):
        q = pa10.random_posture(rng)
        q[3] = rng.choice([0.0, 1e-3, 0.02, 0.1])
        twist = 0.1 * rng.normal(size=6)
        dq = resolve(pa10.mechanism.kinematics(q, HERE).J, twist, p).dq
        assert np.linalg.norm(dq) <= bound(p) * np.linalg.norm(W @ twist) * (1.0 + 1e-9)


@pytest.mark.parametrize("speed", [1e-5, 1e-3, 5e-3, 0.012, 0.02])
def test_slow_commands_are_damped_less_and_joints_stay_slow(pa10, rng, speed):
    """What they may be answered with never grows where the command shrinks."""
    most = max(P.damping / 4.0, min(P.damping, speed))
    allowed = speed / (2.0 * most * np.sqrt(1.0 - (most / P.singular_region) ** 2))
    worst = 0.0
    for _ in range(150):
        q = pa10.random_posture(rng)
        q[3], q[5] = rng.choice([0.0, 1e-3, 0.02, 0.1, 1.0]), rng.choice([0.0, 0.01, 0.05, 1.0])
        J = pa10.mechanism.kinematics(q, HERE).J
        U = np.linalg.svd(W @ J)[0]
        for direction in (*U.T, *-U.T):
            dq = resolve(J, np.linalg.solve(W, speed * direction), P).dq
            worst = max(worst, float(np.linalg.norm(dq)))
    assert 0.8 * allowed < worst <= allowed * (1.0 + 1e-9)


@pytest.mark.parametrize("bend", [0.02, 0.04])
def test_what_is_left_of_a_way_is_gone_within_seconds_beside_the_wrists_singularity(ur5e, bend):
    """Damped as a quick command is, more than 0.8 mm of it would be left after four seconds."""
    goal = np.array([0.0, -1.2, 1.6, -1.5, bend, 0.0])
    target = ur5e.mechanism.kinematics(goal, HERE).T_world_mrf
    q, left = goal + np.array([0.0, 0.0, 0.0, 0.5, 0.0, -0.5]), []
    for _ in range(400):
        at = ur5e.mechanism.kinematics(q, HERE)
        error = pose_error(target, at.T_world_mrf)
        left.append(float(np.linalg.norm(W @ error)))
        q = q + 0.01 * resolve(at.J, 4.0 * error, P).dq
    assert left[0] > 0.04
    assert left[-1] < 1e-4
