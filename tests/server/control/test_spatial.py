import numpy as np
import pinocchio as pin
import pytest
from laboratory.papers.williams import at_wrist
from telerobot.server.control import spatial
from telerobot.server.control.spatial import (
    Motion,
    Pose,
    cross,
    differ,
    dot,
    exceeds,
    from_target,
    jacobian_at,
    largest,
    motion_at,
    moved,
    moved_near,
    pose_error,
    product,
    right_jacobian,
    rotate_twist,
    rotation_exp,
    rotation_log,
    rotation_rpy,
    sizes,
    skew,
    turned,
    twist_at,
    vector_rate,
    within,
    wrench_to,
)

ANGLES = (0.0, 1e-12, 1e-8, 1e-6, 1e-4, 0.1, 1.0, 2.0, 3.0, 3.1, np.pi - 1e-4, np.pi - 1e-7)


def vectors(rng, angle):
    """Rotation vectors of one length: the axes, and random ones."""
    directions = np.vstack([np.eye(3), -np.eye(3), rng.normal(size=(20, 3))])
    return angle * directions / np.linalg.norm(directions, axis=1)[:, None]


@pytest.mark.parametrize("angle", ANGLES)
def test_exponential_agrees_with_pinocchio(angle, rng):
    for r in vectors(rng, angle):
        np.testing.assert_allclose(rotation_exp(r), pin.exp3(r), atol=1e-13)


@pytest.mark.parametrize("angle", ANGLES)
def test_logarithm_agrees_with_pinocchio_and_undoes_the_exponential(angle, rng):
    for r in vectors(rng, angle):
        R = pin.exp3(r)
        np.testing.assert_allclose(rotation_log(R), pin.log3(R), atol=2e-8)
        np.testing.assert_allclose(rotation_log(R), r, atol=1e-9)


def test_logarithm_of_a_half_turn_is_the_axis_either_way(rng):
    for r in vectors(rng, np.pi):
        found = rotation_log(2.0 * np.outer(r, r) / np.pi**2 - np.eye(3))
        assert np.linalg.norm(found) == pytest.approx(np.pi)
        np.testing.assert_allclose(np.linalg.norm(np.cross(found, r)), 0.0, atol=1e-7)


@pytest.mark.parametrize("angle", [*ANGLES, 4.0, 6.0])
def test_right_jacobian_agrees_with_pinocchio(angle, rng):
    for r in vectors(rng, angle):
        np.testing.assert_allclose(right_jacobian(r), pin.Jexp3(r), atol=1e-9)


@pytest.mark.parametrize("angle", [1e-5, 9e-5, 1.1e-4])
def test_small_vectors_have_a_right_jacobian_to_its_second_order(angle, rng):
    """Jr = 1 − r̂/2 + r̂²/6 − …: what is left out is of third order."""
    for r in vectors(rng, angle):
        hat = skew(r)
        np.testing.assert_allclose(
            right_jacobian(r),
            np.eye(3) - hat / 2 + hat @ hat / 6,
            rtol=0.0,
            atol=0.05 * angle**3 + 2e-12,
        )


@pytest.mark.parametrize("angle", [1e-3, 9.9e-3, 1.1e-2])
def test_the_rates_of_small_vectors_are_right_to_the_fourth_order(angle, rng):
    """Jr⁻¹ = 1 + r̂/2 + r̂²/12 − r̂⁴/720 + …, by Bernoulli's numbers."""
    for r in vectors(rng, angle):
        hat = skew(r)
        square = hat @ hat
        series = np.eye(3) + hat / 2 + square / 12 - square @ square / 720
        np.testing.assert_allclose(
            vector_rate(r, np.ones(3)), series @ np.ones(3), rtol=0.0, atol=3e-12
        )


def test_right_jacobian_turns_rates_of_the_vector_into_body_rates(rng):
    for r in rng.uniform(-1.5, 1.5, (20, 3)):
        dr, h = rng.normal(size=3), 1e-6
        turned = rotation_exp(r - h * dr).T @ rotation_exp(r + h * dr)
        np.testing.assert_allclose(
            rotation_log(turned) / (2 * h), right_jacobian(r) @ dr, atol=1e-8
        )


@pytest.mark.parametrize("angle", [*ANGLES, 1e-2, 1.1e-2, 4.0, 6.0])
def test_the_rate_of_a_vector_is_what_the_right_jacobian_makes_of_a_body_rate(angle, rng):
    for r in vectors(rng, angle):
        w = rng.normal(size=3)
        np.testing.assert_allclose(pin.Jexp3(r) @ vector_rate(r, w), w, atol=1e-8)


def test_an_attitude_seen_from_a_target_has_the_rate_of_finite_differences(rng):
    for _ in range(20):
        R_target, R = (rotation_exp(r) for r in rng.uniform(-1.0, 1.0, (2, 3)))
        w, h = rng.normal(size=3), 1e-6
        r, dr = from_target(R_target, R, w)
        np.testing.assert_allclose(R_target @ pin.exp3(r), R, atol=1e-13)
        before, after = (rotation_log(R_target.T @ rotation_exp(s * h * w) @ R) for s in (-1, 1))
        np.testing.assert_allclose((after - before) / (2 * h), dr, atol=1e-8)


def test_roll_pitch_yaw_is_that_of_urdf(rng):
    for rpy in rng.uniform(-np.pi, np.pi, (50, 3)):
        np.testing.assert_allclose(rotation_rpy(*rpy), pin.rpy.rpyToMatrix(*rpy), atol=1e-14)


def test_a_pose_survives_the_way_through_xyz_rpy(random_pose):
    for _ in range(50):
        T = random_pose()
        numbers = T.to_xyz_rpy()
        back = Pose.from_xyz_rpy(numbers[:3], numbers[3:])
        np.testing.assert_allclose(back.R, T.R, atol=1e-12)
        np.testing.assert_array_equal(back.p, T.p)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_a_pose_survives_gimbal_lock(pitch, rng):
    for roll, yaw in rng.uniform(-3, 3, (20, 2)):
        T = Pose.from_xyz_rpy((0.0, 0.0, 0.0), (roll, pitch, yaw))
        back = Pose.from_xyz_rpy(T.p, T.to_xyz_rpy()[3:])
        np.testing.assert_allclose(back.R, T.R, atol=1e-7)


def half_way_up(sign, angle):
    """An attitude whose pitch is a right angle, without a rounding: what remains is one angle."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[0.0, -s, sign * c], [0.0, c, sign * s], [-sign, 0.0, 0.0]])


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("angle", [-2.5, -0.4, 0.0, 1.0, 3.0])
def test_where_roll_and_yaw_are_one_angle_it_is_the_yaw(sign, angle):
    R = half_way_up(sign, angle)
    numbers = Pose(R, np.zeros(3)).to_xyz_rpy()
    assert numbers[3:] == pytest.approx((0.0, sign * np.pi / 2, angle))
    np.testing.assert_allclose(Pose.from_xyz_rpy(numbers[:3], numbers[3:]).R, R, atol=1e-15)


def test_a_frame_in_itself_changes_no_pose(random_pose):
    T = random_pose()
    np.testing.assert_array_equal(Pose.identity().R, np.eye(3))
    for same in (Pose.identity() @ T, T @ Pose.identity()):
        np.testing.assert_array_equal(same.R, T.R)
        np.testing.assert_array_equal(same.p, T.p)


def test_gravity_is_that_of_pinocchios_world():
    np.testing.assert_array_equal(spatial.GRAVITY, pin.Model().gravity.linear)


def test_a_step_moves_a_pose_in_the_axes_of_the_world(random_pose, rng):
    for _ in range(20):
        T, step = random_pose(), rng.normal(size=6)
        found = moved(T, step)
        np.testing.assert_allclose(found.R, pin.exp3(step[3:]) @ T.R, atol=1e-14)
        np.testing.assert_allclose(found.p, T.p + step[:3], atol=1e-15)


def test_poses_compose_and_invert_as_pinocchios_do(random_pose):
    for _ in range(20):
        a, b = random_pose(), random_pose()
        expected = pin.SE3(a.R, a.p) * pin.SE3(b.R, b.p)
        np.testing.assert_allclose((a @ b).R, expected.rotation, atol=1e-14)
        np.testing.assert_allclose((a @ b).p, expected.translation, atol=1e-14)
        np.testing.assert_allclose((a @ a.inverse()).R, np.eye(3), atol=1e-14)
        np.testing.assert_allclose((a @ a.inverse()).p, 0.0, atol=1e-14)


def test_the_quick_cross_product_is_the_cross_product(rng):
    for a, b in rng.normal(size=(20, 2, 3)):
        np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-15)
        np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-15)


def test_eq_1_agrees_with_pinocchio(rng, random_pose):
    for _ in range(30):
        T_wrist_mrf, twist = random_pose(), rng.normal(size=6)
        expected = pin.SE3(T_wrist_mrf.R, T_wrist_mrf.p).act(pin.Motion(twist))
        np.testing.assert_allclose(at_wrist(twist, T_wrist_mrf), expected.vector, atol=1e-13)


def test_eq_1_means_the_same_motion_in_whatever_axes(rng, random_pose):
    for _ in range(30):
        T_wrist_mrf, R_k_wrist, twist = random_pose(), random_pose().R, rng.normal(size=6)
        in_k = twist_at(rotate_twist(R_k_wrist @ T_wrist_mrf.R, twist), -R_k_wrist @ T_wrist_mrf.p)
        in_wrist = at_wrist(twist, T_wrist_mrf)
        np.testing.assert_allclose(in_k, rotate_twist(R_k_wrist, in_wrist), atol=1e-13)


def test_eq_5_agrees_with_pinocchio(rng, random_pose):
    for _ in range(30):
        T_mrf_sensor, wrench = random_pose(), rng.normal(size=6)
        expected = pin.SE3(T_mrf_sensor.R, T_mrf_sensor.p).act(pin.Force(wrench))
        np.testing.assert_allclose(wrench_to(T_mrf_sensor, wrench), expected.vector, atol=1e-13)


def test_eqs_1_and_5_are_dual_in_power(rng, random_pose):
    for _ in range(100):
        T_wrist_mrf, twist_mrf, wrench_wrist = random_pose(), rng.normal(size=6), rng.normal(size=6)
        twist_wrist = at_wrist(twist_mrf, T_wrist_mrf)
        wrench_mrf = wrench_to(T_wrist_mrf.inverse(), wrench_wrist)
        assert wrench_mrf @ twist_mrf == pytest.approx(wrench_wrist @ twist_wrist, abs=1e-12)


def test_the_pose_error_held_for_a_second_leads_to_the_target(random_pose):
    for _ in range(30):
        T, target = random_pose(), random_pose()
        error = pose_error(target, T)
        np.testing.assert_allclose(T.p + error[:3], target.p, atol=1e-14)
        np.testing.assert_allclose(pin.exp3(error[3:]) @ T.R, target.R, atol=1e-9)
        assert np.linalg.norm(error[3:]) <= np.pi + 1e-9


def test_a_turned_attitude_and_its_twist_agree_with_finite_differences(rng):
    for _ in range(20):
        R_target, r, rates = (
            rotation_exp(rng.normal(size=3)),
            rng.normal(size=3),
            rng.normal(size=6),
        )
        R, twist = turned(R_target, r, rates)
        np.testing.assert_allclose(R, R_target @ rotation_exp(r), atol=1e-14)
        step = 1e-6
        ahead = R_target @ rotation_exp(r + step * rates[3:])
        np.testing.assert_allclose(twist[3:], rotation_log(ahead @ R.T) / step, atol=1e-5)
        np.testing.assert_array_equal(twist[:3], rates[:3])
        np.testing.assert_allclose(
            sizes(twist), (np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:]))
        )


@pytest.mark.parametrize("size", [0.1, 1.0, 10.0])
def test_a_step_leads_a_pose_on_but_not_far_from_another(rng, size):
    slack = (0.02, 0.1)
    for _ in range(20):
        near = Pose(rotation_exp(rng.normal(size=3)), rng.normal(size=3))
        T = Pose(pin.exp3(rng.normal(0.0, 0.02, 3)) @ near.R, near.p + rng.normal(0.0, 0.005, 3))
        step = size * rng.normal(0.0, np.repeat([0.005, 0.02], 3))
        free = Pose(pin.exp3(step[3:]) @ T.R, T.p + step[:3])
        away = pose_error(free, near)
        share = np.minimum(1.0, slack / np.array(sizes(away)))
        found = moved_near(T, step, near, slack)
        expected = away * np.repeat(share, 3)
        np.testing.assert_allclose(pose_error(found, near), expected, atol=1e-9)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_pitch_that_rounding_has_beyond_a_right_angle_is_a_right_angle(sign):
    R = Pose.from_xyz_rpy((0.0, 0.0, 0.0), (0.0, sign * np.pi / 2, 0.3)).R.copy()
    R[2, 0] = -sign * (1.0 + 1e-15)
    assert Pose(R, np.zeros(3)).to_xyz_rpy()[3:] == pytest.approx((0.0, sign * np.pi / 2, 0.3))


def test_a_jacobian_at_another_point_gives_the_twist_there(rng):
    J, lever, dq = rng.normal(size=(6, 7)), rng.normal(size=3), rng.normal(size=7)
    before = J.copy()
    np.testing.assert_allclose(jacobian_at(J, lever) @ dq, twist_at(J @ dq, lever), atol=1e-12)
    np.testing.assert_array_equal(J, before)


def test_poses_differ_in_place_or_attitude_alone():
    a = Pose(rotation_rpy(0.1, 0.2, 0.3), np.array([1.0, 2.0, 3.0]))
    assert not differ(a, a)
    assert not differ(a, Pose(a.R.copy(), a.p.copy()))
    assert differ(a, Pose(a.R, a.p + np.array([0.0, 1e-15, 0.0])))
    assert differ(a, Pose(a.R @ rotation_exp(np.array([1e-9, 0.0, 0.0])), a.p))


@pytest.mark.parametrize(
    ("twist", "share"),
    [
        ([0.3, 0.0, 0.4, 0.0, 0.0, 0.0], 0.5),  # 0.5 m/s of 0.25
        ([0.0, 0.0, 0.0, 0.0, 2.0, 0.0], 0.25),  # 2 rad/s of 0.5
        ([0.3, 0.0, 0.4, 0.0, 2.0, 0.0], 0.25),
    ],
)
def test_a_twist_is_slowed_as_a_whole(twist, share):
    twist = np.array(twist)
    np.testing.assert_allclose(within(twist, (0.25, 0.5)), share * twist, atol=1e-15)


def test_a_twist_inside_its_bounds_is_the_same_and_nobody_writes_to_that_of_nothing():
    twist = np.array([0.1, 0.0, 0.0, 0.0, 0.2, 0.0])
    assert within(twist, (0.25, 0.5)) is twist
    with pytest.raises(ValueError, match="read-only"):
        spatial.NO_TWIST[0] = 1.0


def test_a_body_at_rest_is_at_rest_at_every_point_of_it():
    rest = Motion.at_rest(np.zeros(6))
    assert motion_at(rest, np.array([1.0, 0.0, 0.0]), (1.0, 1.0), np.ones(6)) is rest


def test_a_body_that_begins_to_turn_is_quickened_at_a_point_aside():
    """Change of the twist alone, about z; a metre along x: the change is along y."""
    begins = Motion(np.zeros(6), np.zeros(6), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5]))
    found = motion_at(begins, np.array([1.0, 0.0, 0.0]), (1.0, 1.0), np.ones(6))
    np.testing.assert_allclose(found.ddq, [0.0, 0.5, 0.0, 0.0, 0.0, 0.5], atol=1e-15)


@pytest.mark.parametrize("shape", [(0, 6), (3, 3), (6, 7), (1, 12)])
def test_a_product_is_numpys_whatever_the_strides(rng, shape):
    A, x = rng.normal(size=shape), rng.normal(size=shape[1])
    assert product(A, x) == pytest.approx(A @ x, abs=1e-14)
    assert product(A.T.copy().T, x) == pytest.approx(A @ x, abs=1e-14)
    assert dot(x, x) == pytest.approx(x @ x, rel=1e-14)
    for n in (shape[1] - 1, shape[1] + 1):
        with pytest.raises(IndexError):
            product(rng.normal(size=(2, n)), x)
        with pytest.raises(IndexError):
            dot(np.zeros(n), x)


def test_the_largest_part_is_numpys_even_where_one_is_not_a_number(rng):
    for n in (1, 6, 7):
        for _ in range(50):
            x = rng.normal(size=n) * 10.0 ** rng.integers(-9, 9)
            assert largest(x) == np.abs(x).max()
            x[rng.integers(n)] = np.nan
            assert np.isnan(largest(x))
    assert largest(np.zeros(6)) == 0.0
    assert largest(np.array([1.0, -np.inf])) == np.inf


def test_what_is_not_a_number_is_beyond_every_bound(rng):
    for _ in range(200):
        x, bounds = rng.normal(size=7), rng.uniform(0.5, 3.0, size=7)
        assert exceeds(x, bounds) == (np.abs(x) > bounds).any()
    assert not exceeds(np.array([-1.0, 1e9]), np.array([1.0, np.inf]))
    assert exceeds(np.array([0.0, np.nan]), np.array([1.0, np.inf]))
