"""Tasks that leave axes free: rows, null space and slopes, by numpy and finite differences."""

import math
from itertools import pairwise

import numpy as np
import pytest
from telerobot.config.consistency import check_agreement
from telerobot.config.load import ConfigError, altered, load_cell
from telerobot.server.control.axes import AXES, HeldAxes, faded, holding
from telerobot.server.control.mechanism.objectives import (
    AlongDirection,
    Condition,
    LeastSingularValue,
    Manipulability,
)
from telerobot.server.control.mechanism.potentials import (
    FieldFlow,
    Potential,
    Strengths,
    manipulability_slope,
    shape,
)
from telerobot.server.control.mechanism.resolution import Travel, resolve
from telerobot.server.control.spatial import (
    Pose,
    pose_error,
    rotate_twist,
    rotation_exp,
    rotation_rpy,
)

from ..chains import CHAINS
from .shown import built, joints, shown

MRF = Pose(rotation_rpy(0.3, -0.5, 0.7), np.array([0.05, -0.02, 0.15]))
SETS = [("rz",), ("x",), ("y", "rx"), ("rx", "ry", "rz"), ("x", "y", "z", "rz"), ("z", "ry")]
STEP = 1e-6


def held_of(mechanism, q, held, mrf=MRF):
    k = mechanism.kinematics(q, mrf)
    return k, HeldAxes.of(held, k.T_world_mrf.R, mechanism.held_ranks(held == 1.0, mrf))


def rows(k, held):
    """Rows of the task in the axes of the MRF, by numpy."""
    R = k.T_world_mrf.R
    return np.vstack([R.T @ k.J[:3], R.T @ k.J[3:]])[held == 1.0]


def regular(arm, rng, free):
    while True:
        q = arm.random_posture(rng)
        k, held = held_of(arm.mechanism, q, holding(free))
        if np.linalg.svd(rows(k, holding(free)), compute_uv=False)[-1] > 0.15:
            return q, k, held


@pytest.mark.parametrize("free", SETS)
def test_the_rates_are_the_least_that_do_what_is_held(arm, rng, free):
    for _ in range(5):
        _, k, held = regular(arm, rng, free)
        twist = rng.normal(size=6)
        found = resolve(k.J, twist, arm.p.resolve, None, held.rank, held)
        A = rows(k, holding(free))
        wanted = rotate_twist(k.T_world_mrf.R.T, twist)[holding(free) == 1.0]
        np.testing.assert_allclose(found.dq, np.linalg.pinv(A) @ wanted, atol=1e-9)
        assert found.null.shape == (arm.p.n - len(A), arm.p.n)
        np.testing.assert_allclose(A @ found.null.T, 0.0, atol=1e-9)
        np.testing.assert_allclose(found.null @ found.null.T, np.eye(len(found.null)), atol=1e-12)


def test_what_is_asked_along_a_free_axis_moves_no_joint(arm, rng):
    for fade in (0.0, 0.4):
        q = regular(arm, rng, ("x", "rz"))[0]
        k, held = held_of(arm.mechanism, q, np.array([0.0, 1.0, 1.0, 1.0, 1.0, fade]))
        twist, along = rng.normal(size=6), np.concatenate([k.T_world_mrf.R[:, 0], np.zeros(3)])
        each = [
            resolve(k.J, t, arm.p.resolve, None, held.rank, held).dq
            for t in (twist, twist + 5.0 * along)
        ]
        np.testing.assert_allclose(each[0], each[1], atol=1e-9)


def test_the_rates_of_an_axis_that_fades_go_over_without_a_jump(arm, rng):
    """Beginning, end and each tick between: the ends are the task's with and without the axis."""
    for name in ("y", "rx"):
        q, _, _ = regular(arm, rng, (name,))
        twist, now, ways, nulls = rng.normal(size=6), None, [], []
        for _ in range(50):
            now = faded(now, holding((name,)), 0.02)
            k, held = held_of(arm.mechanism, q, now)
            found = resolve(k.J, twist, arm.p.resolve, None, held.rank, held)
            ways.append(found.dq)
            nulls.append(found.null.T @ found.null)
        k = arm.mechanism.kinematics(q, MRF)
        before = resolve(k.J, twist, arm.p.resolve)
        ways, nulls = [before.dq, *ways], [before.null.T @ before.null, *nulls]
        k, held = held_of(arm.mechanism, q, holding((name,)))
        np.testing.assert_array_equal(now, holding((name,)))
        for each in (ways, nulls):
            steps = [np.abs(b - a).max() for a, b in pairwise(each)]
            assert max(steps) < 0.25 * np.abs(each[-1] - each[0]).max() + 1e-9
            assert max(steps[0], steps[-1]) < 0.06 * np.abs(each[-1] - each[0]).max() + 1e-9


def test_no_singular_value_is_lost_while_an_axis_fades(arm, rng):
    length = arm.p.resolve.characteristic_length
    weight = np.diag([1.0] * 3 + [length] * 3)
    for _ in range(20):
        q = arm.random_posture(rng)
        k, held = held_of(arm.mechanism, q, rng.uniform(0.01, 0.99, 6))
        least = np.linalg.svd(weight @ k.J, compute_uv=False)[-1]
        found = np.linalg.svd(weight @ held.rows(k.J), compute_uv=False)[-1]
        assert found > min(least, length) - 1e-9


def test_a_wrist_that_is_singular_is_none_where_the_attitude_is_free(pa10):
    q = pa10.posture("ready").copy()
    q[5] = 0.0  # the axes of the fifth and the seventh joint are one
    twist = np.array([0.1, 0.0, 0.05, 0.2, 0.3, 0.1])
    k, held = held_of(pa10.mechanism, q, holding(("rx", "ry", "rz")))
    found = resolve(k.J, twist, pa10.p.resolve, None, held.rank, held)
    assert not found.singular
    np.testing.assert_allclose(k.J[:3] @ found.dq, twist[:3], atol=1e-9)


@pytest.mark.parametrize("bent", [0.0, 1e-4, 0.01])
def test_a_stretched_arm_is_led_home_and_not_out(pa10, bent):
    """The elbow's boundary is the place's alone: its curvature is looked at through the rows."""
    q = np.array([0.0, 0.6, 0.0, bent, 0.0, 0.5 * bent, 0.0])
    k, held = held_of(pa10.mechanism, q, holding(("rx", "ry", "rz")), Pose.identity())
    shoulder = np.array([0.0, 0.0, 0.315])
    out = k.T_world_mrf.p - shoulder
    u = np.linalg.svd(k.J[:3])[0][:, 2]
    u = u if u @ out > 0 else -u
    travel = Travel(q - pa10.p.joints.lower, pa10.p.joints.upper - q)
    for sense in (-1.0, 1.0):
        twist = np.concatenate([sense * 0.05 * u, np.zeros(3)])
        found = resolve(k.J, twist, pa10.p.resolve, travel, held.rank, held)
        there = pa10.mechanism.kinematics(q + 0.2 * found.dq, Pose.identity())
        went = float(u @ (there.T_world_mrf.p - k.T_world_mrf.p))
        assert (went < -1e-3) if sense < 0 else (abs(went) < 1e-3)


def test_a_boundary_may_be_left_while_an_axis_fades(pa10):
    """The slack of its row is no joint: it has no limits, and bends nothing."""
    q, aim = np.array([0.0, 0.6, 0.0, 0.0, 0.0, 0.0, 0.0]), holding(("rx", "ry", "rz"))
    travel, before = Travel(q - pa10.p.joints.lower, pa10.p.joints.upper - q), None
    for fade in (0.0, 1e-6, *np.arange(0.02, 1.0, 0.02)):
        k, held = held_of(pa10.mechanism, q, np.maximum(aim, fade), Pose.identity())
        twist = np.concatenate([-0.05 * k.T_world_mrf.R[:, 2], np.zeros(3)])
        found = resolve(k.J, twist, pa10.p.resolve, travel, held.rank, held)
        assert np.abs(found.dq).max() > 0.5
        now = np.abs(found.dq)  # the elbow may go to either side
        assert before is None or np.abs(now - before).max() < (0.1 if fade > 1e-3 else 1e-3)
        before = now


@pytest.mark.parametrize("bent", [0.0, 1e-5, 1e-3])
def test_what_radians_weigh_is_no_matter_where_no_rotation_is_held(pa10, bent):
    """Nor is how motions turn the tool, where an arm comes home from its boundary."""
    q = np.array([0.3, 0.6, 0.5, bent, 0.9, 0.5 * bent, 0.0])
    k, held = held_of(pa10.mechanism, q, holding(("rx", "ry", "rz")), Pose.identity())
    twist = np.concatenate([-0.05 * k.T_world_mrf.R[:, 2], np.zeros(3)])
    travel = Travel(q - pa10.p.joints.lower, pa10.p.joints.upper - q)
    each = [
        resolve(k.J, twist, section, travel, held.rank, held).dq
        for section in (
            pa10.p.resolve,
            pa10.p.resolve.model_copy(update={"characteristic_length": 1.5}),
        )
    ]
    assert np.abs(each[0]).max() > 0.1
    np.testing.assert_allclose(each[0], each[1], atol=1e-9)


def test_ranks_are_those_of_the_rows_whatever_the_axes_of_the_mrf():
    mechanism, _ = CHAINS["planar of three"]
    upright, lying = Pose.identity(), Pose(rotation_rpy(math.pi / 2, 0, 0), np.array([0.1, 0, 0.2]))
    for free, expected in ((("rz",), 2), (("z",), 3), (("x", "y"), 1), (("x", "y", "rz"), 0)):
        assert mechanism.held_ranks(holding(free) == 1.0, upright)[1] == expected
    # Its y axis points along World's z: that is now what the chain does not reach.
    for free, expected in ((("ry",), 2), (("y",), 3), (("x", "z", "ry"), 0)):
        assert mechanism.held_ranks(holding(free) == 1.0, lying)[1] == expected


def test_a_task_of_rows_that_are_never_reached_asks_for_nothing(pa10):
    mechanism, _ = CHAINS["planar of three"]
    q = np.array([0.3, 0.5, -0.4])
    k, held = held_of(mechanism, q, holding(("x", "y", "rz")), Pose.identity())
    found = resolve(k.J, np.ones(6), pa10.p.resolve, None, held.rank, held)
    np.testing.assert_array_equal(found.dq, 0.0)
    np.testing.assert_array_equal(found.null, np.eye(3))


FADES = [
    np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.0]),
    np.array([0.0, 1.0, 1.0, 1.0, 1.0, 1.0]),
    np.array([1.0, 1.0, 0.0, 0.0, 1.0, 0.0]),
    np.array([0.3, 1.0, 1.0, 0.0, 0.6, 1.0]),
]


@pytest.mark.parametrize("held", FADES, ids=str)
def test_manipulability_is_that_of_the_rows_and_its_slope_turns_with_them(pa10, rng, held):
    def of(q):
        k, now = held_of(pa10.mechanism, q, held)
        R = np.kron(np.eye(2), k.T_world_mrf.R)
        part = np.sin(0.5 * np.pi * held)
        A = np.hstack([np.diag(part) @ R.T @ k.J, np.diag(np.cos(0.5 * np.pi * held))])
        return np.sqrt(np.linalg.det((A @ A.T)[np.ix_(held > 0, held > 0)])), k, now

    for _ in range(5):
        q = pa10.random_posture(rng)
        w, k, now = of(q)
        found, slope = manipulability_slope(k.J, 6, now)
        assert found == pytest.approx(w, rel=1e-6)
        expected = [(of(q + a)[0] - of(q - a)[0]) / (2 * STEP) for a in STEP * np.eye(7)]
        np.testing.assert_allclose(slope, expected, atol=1e-6)


def test_the_objective_climbs_the_manipulability_of_the_rows(pa10, rng):
    objective = built(
        Manipulability, joints(pa10.p.joints.lower, pa10.p.joints.upper), pa10.mechanism
    )
    q = pa10.random_posture(rng)
    k, held = held_of(pa10.mechanism, q, holding(("x", "rz")))
    expected = manipulability_slope(k.J, 6, held)[1]
    np.testing.assert_array_equal(objective.rate(shown(q, J=k.J, held=held)), expected)


@pytest.mark.parametrize("free", [("x",), ("x", "rz"), ("rx", "ry", "rz")])
def test_the_field_is_followed_as_it_bends_along_the_rows_that_turn(pa10, rng, free):
    """−V'/|V''| by differences of V where the arm goes: A q' = 0, to the second order."""
    none, h, e = np.zeros((0, 2, 3)), 1e-3, 1e-6
    wide, body = 4.0 * np.ones(7), np.zeros(0, dtype=np.int64)
    of = Potential(-wide, wide, body, Strengths(0.0, 0.0, 0.0, 1.0), 0.0)
    flow = FieldFlow(of, body, 1e-9)

    def there(q):
        k, held = held_of(pa10.mechanism, q, holding(free))
        return rows(k, holding(free)), held, shape(q, k.J, k.T_world_mrf.p, none)

    for _ in range(3):
        q = regular(pa10, rng, free)[0]
        A, held, here = there(q)
        seen, null = flow.look(here, None, None, held), np.linalg.svd(A)[2][len(A) :]
        way = null.T @ null @ seen.value.torque
        slope = np.linalg.norm(way)
        way /= slope
        turned = (there(q + e * way)[0] - there(q - e * way)[0]) @ way / (2.0 * e)
        bent = -np.linalg.pinv(A) @ turned
        V = []
        for s in (-h, 0.0, h):
            _, now, at = there(q + s * way + 0.5 * s**2 * bent)
            V.append(of.at(at, None, None, now).total)
        rates, size = flow.self_motion(seen, null)
        assert size == pytest.approx((V[0] - V[2]) / (2.0 * h), rel=1e-3)
        bend = abs(V[2] - 2.0 * V[1] + V[0]) / h**2
        np.testing.assert_allclose(rates, slope / bend * way, rtol=5e-3)


@pytest.mark.parametrize("kind", [LeastSingularValue, Condition, AlongDirection])
@pytest.mark.parametrize("held", FADES, ids=str)
def test_the_other_measures_of_dexterity_are_the_rows_too(pa10, rng, kind, held):
    within = joints(pa10.p.joints.lower, pa10.p.joints.upper)
    objective = built(kind, within, pa10.mechanism)

    def view(q):
        k, now = held_of(pa10.mechanism, q, held)
        return shown(q, J=k.J, held=now)

    for _ in range(3):
        q = pa10.random_posture(rng)
        found = objective.rate(view(q))
        expected = [
            (objective.value(view(q + a)) - objective.value(view(q - a))) / (2 * STEP)
            for a in STEP * np.eye(7)
        ]
        np.testing.assert_allclose(found, expected, atol=2e-6)


def test_the_potential_of_manipulability_is_the_rows(rng):
    """A planar arm whose attitude is free: w = √det of the two rows of its place, by hand."""
    mechanism, rank = CHAINS["planar of three"]
    wide, none = 3.0 * np.ones(3), np.zeros((0, 2, 3))
    strengths = Strengths(0.0, 0.0, 0.0, 0.4)
    of = Potential(-wide, wide, np.zeros(0, dtype=np.int64), strengths, 0.0, rank=rank)
    for _ in range(5):
        q = rng.uniform(-2.5, 2.5, 3)
        k, held = held_of(mechanism, q, holding(("rz",)), Pose.identity())
        found = of.at(shape(q, k.J, k.T_world_mrf.p, none), None, None, held)

        def w(q):
            J = mechanism.kinematics(q, Pose.identity()).J[:2]
            return np.sqrt(np.linalg.det(J @ J.T))

        assert found.parts["manipulability"] == pytest.approx(-0.4 * w(q), rel=1e-6)
        expected = [0.4 * (w(q + a) - w(q - a)) / (2 * STEP) for a in STEP * np.eye(3)]
        np.testing.assert_allclose(found.torque, expected, atol=1e-6)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("about", [0.0, 1.5, -3.1, 7.0])
def test_the_error_of_a_tool_that_may_spin_is_what_turns_its_axis(rng, axis, about):
    R = rotation_rpy(0.4, 1.1, -0.3)
    held = HeldAxes.of(holding((AXES[3 + axis],)), R, (5, 5))
    e = R[:, axis]
    tilt = np.cross(e, rng.normal(size=3))
    tilt *= 0.7 / np.linalg.norm(tilt)
    target = Pose(rotation_exp(tilt) @ rotation_exp(about * e) @ R, np.array([0.1, 0.2, 0.3]))
    error = held.error(pose_error(target, Pose(R, np.zeros(3))))
    np.testing.assert_allclose(error, [0.1, 0.2, 0.3, *tilt], atol=1e-9)


def test_the_error_of_an_axis_that_fades_goes_over_to_the_whole(rng):
    R, r = rotation_rpy(0.4, 1.1, -0.3), rng.normal(size=3)
    error = np.concatenate([np.zeros(3), r])
    for held, wanted in ((1.0 - 1e-9, r), (1e-9, None)):
        axes = HeldAxes.of(np.array([1.0] * 5 + [held]), R, (5, 5))
        whole = HeldAxes.of(holding(("rz",)), R, (5, 5)).error(error)[3:]
        expected = whole if wanted is None else wanted
        np.testing.assert_allclose(axes.error(error)[3:], expected, atol=1e-6)


def test_the_same_axes_are_seen_from_another_frame(rng):
    R, turn = rotation_rpy(0.4, 1.1, -0.3), rotation_rpy(-1.0, 0.2, 2.0)
    held, twist = (
        HeldAxes.of(np.array([0.0, 1.0, 0.5, 1.0, 0.0, 1.0]), R, (4, 4)),
        rng.normal(size=6),
    )
    there = held.seen(turn)
    expected = rotate_twist(turn, held.part(twist))
    np.testing.assert_allclose(there.part(rotate_twist(turn, twist)), expected, atol=1e-12)
    np.testing.assert_allclose(there.slack[:3], turn @ held.slack[:3], atol=1e-12)


def test_axes_fade_at_one_pace_and_are_what_was_asked_for_in_the_end():
    aim, now, seen = holding(("x", "rz")), None, []
    while now is not aim:
        now = faded(now, aim, 0.02)
        seen.append(now)
    assert len(seen) == 50
    np.testing.assert_allclose(seen[24], [0.5, 1, 1, 1, 1, 0.5])
    back = faded(aim, None, 0.3)
    np.testing.assert_allclose(back, [0.3, 1, 1, 1, 1, 0.3])
    for _ in range(3):
        back = faded(back, None, 0.3)
    assert back is None


@pytest.mark.parametrize(
    ("axes", "complaint"),
    [
        (["x", "x"], "'x' is there twice"),
        (["u"], "free_axes"),
        (list(AXES), "free_axes"),
    ],
)
def test_axes_that_cannot_be_left_free_are_told_by_their_key(axes, complaint):
    with pytest.raises(ConfigError, match=complaint):
        altered(load_cell("pa10"), {"resolve.free_axes": axes})


def test_an_arm_on_a_curve_has_none_to_leave():
    cell = altered(load_cell("snake"), {"resolve.free_axes": ["rz"]})
    with pytest.raises(ConfigError, match=r"resolve\.free_axes: .*curve"):
        check_agreement(cell.path, cell.config, cell.robot, str)
