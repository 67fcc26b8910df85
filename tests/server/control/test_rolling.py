"""A base on wheels: where it gets to, its columns, and the law that moves it with its arm."""

import math

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.arm import Arm
from telerobot.server.control.bodies.rates import ArmTick
from telerobot.server.control.inputs import DriveRequest, Inputs, Intent, Settings
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.spatial import Pose, pose_error, rotation_rpy, sizes
from telerobot.server.control.stop.limiter import Commanded
from telerobot.server.control.wheels import DifferentialDrive, Rolled
from telerobot.server.recorder import pack, unpack

ROLLING = DifferentialDrive(radius=0.12, track=0.5)


@pytest.fixture(scope="module")
def cell():
    return load_cell("rover")


@pytest.fixture(scope="module")
def arm(cell):
    return Arm.of(cell)


@pytest.fixture(scope="module")
def mechanism(cell):
    return Mechanism.from_cell(cell)


def asked(arm, q, k, base, twist, **more):
    """Return what an arm that may move is asked for."""
    settings = Settings({}, arm.p.T_wrist_tool, Pose.identity(), np.zeros(6))
    inputs = Inputs(0.0, Intent.MOVE, np.zeros(9), settings, **more)
    told = Commanded.at_rest(q)
    tick = ArmTick(inputs, k, k.T_world_wrist, np.zeros(9), told, T_world_base=base)
    tick.objectives, tick.asked = arm.redundancy.objectives, np.asarray(twist)
    return tick


def somewhere(draw, cell):
    """Return a posture (9,) of wheels and arm, and a Base anywhere on a floor of any tilt."""
    low = [max(j.lower, -3.0) for j in cell.robot.joints]
    high = [min(j.upper, 3.0) for j in cell.robot.joints]
    q = draw.uniform(low, high)
    q[:2] = draw.uniform(-50.0, 50.0, 2)
    T = Pose(rotation_rpy(*draw.uniform(-3.0, 3.0, 3)), draw.uniform(-5.0, 5.0, 3))
    return q, T


@pytest.mark.parametrize("name", ["rover", "rover_skid"])
def test_the_jacobian_is_the_slope_of_the_tools_pose_at_any_posture(name):
    draw, h, cell = np.random.default_rng(1), 1e-5, load_cell(name)
    mechanism, rolling = Mechanism.from_cell(cell), DifferentialDrive.from_cell(cell)
    T_wrist_mrf = Pose(rotation_rpy(0.3, -0.2, 0.5), np.array([0.05, -0.02, 0.14]))
    for _ in range(30):
        q, T = somewhere(draw, cell)
        J = mechanism.kinematics(q, T_wrist_mrf, T).J

        def pose(q_there, q=q, T=T):
            base = rolling.roll(Rolled.at(T, q[:2]), q_there[:2])
            return mechanism.pose_wrist(q_there, base) @ T_wrist_mrf

        for j in range(9):
            step = h * np.eye(9)[j]
            slope = pose_error(pose(q + step), pose(q - step)) / (2 * h)
            assert np.abs(J[:, j] - slope).max() < 1e-8


@pytest.mark.parametrize("centre", [0.0, 0.1])
def test_the_base_rolls_as_its_wheels_and_sideways_only_about_its_centre(centre):
    """By the velocities of Zhang 2013, eq. 3, in steps of a hundred-thousandth of the way."""
    way, n = np.array([9.0, 14.0]), 100_000
    x = y = yaw = 0.0
    v, w = 0.5 * 0.12 * way.sum() / n, 0.12 / 0.5 * (way[1] - way[0]) / n
    for _ in range(n):
        c, s = math.cos(yaw + 0.5 * w), math.sin(yaw + 0.5 * w)
        x += v * c + centre * w * s
        y += v * s - centre * w * c
        yaw += w
    R, p = ROLLING._replace(centre=centre).roll(Rolled.at(Pose.identity(), np.zeros(2)), way)
    assert p == pytest.approx([x, y, 0.0], abs=1e-8)
    assert math.atan2(R[1, 0], R[0, 0]) == pytest.approx(math.remainder(yaw, 2 * math.pi), abs=1e-9)


def test_wheels_and_twists_of_a_base_say_the_same():
    for v, w in [(0.5, 0.0), (-0.2, 0.7), (0.0, -1.0)]:
        assert ROLLING.driven(ROLLING.wheels(v, w)) == pytest.approx((v, w), abs=1e-15)


@pytest.mark.parametrize("on_the_way", [0.1, 1.5])
def test_the_tools_error_decays_exponentially_whoever_makes_the_motion(arm, on_the_way):
    """Zhang 2013, eq. 8 with its sign put right: of e = x_d − x is left exp(−K t)."""
    K, dt, n = 1.0, 1e-3, 1000
    mrf = arm.p.T_wrist_tool
    q = np.array([0.0, 0.0, 0.1, -0.7, 0.1, 1.5, 0.1, 0.6, 0.1])
    base = Rolled.at(Pose.identity(), q[:2])
    target = arm.mechanism.pose_wrist(q, base) @ mrf
    turn = rotation_rpy(0.2, 0.1, -0.2)
    target = Pose(turn @ target.R, target.p + np.array([on_the_way, 0.1 * on_the_way, 0.0]))
    first = None
    for _ in range(n):
        k = arm.mechanism.kinematics(q, mrf, base)
        e = pose_error(target, k.T_world_mrf)
        first = sizes(e) if first is None else first
        found = arm.body.rates(asked(arm, q, k, base, K * e))
        assert not found.wheels_commanded
        q = q + dt * found.dq
        base = ROLLING.roll(base, q[:2])
    left = sizes(pose_error(target, arm.mechanism.pose_wrist(q, base) @ mrf))
    assert np.array(left) / first == pytest.approx(math.exp(-K * n * dt), rel=0.02)
    assert base.p[0] > 0.2 * on_the_way


def test_self_motion_of_base_and_arm_does_not_move_the_tool(arm):
    """The oblique projector: a wish of the arm alone is answered by wheels and arm."""
    mrf = arm.p.T_wrist_tool
    q = np.array([3.0, -2.0, 0.3, -0.5, 0.2, 1.2, 0.1, 0.3, 0.1])
    base = Rolled.at(Pose(rotation_rpy(0.0, 0.0, 0.8), np.array([1.0, 2.0, 0.0])), q[:2])
    k = arm.mechanism.kinematics(q, mrf, base)
    for twist in ([0.1, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.05, 0.02, 0.0, 0.1, 0.2]):
        found = arm.body.rates(asked(arm, q, k, base, twist))
        assert k.J @ found.dq == pytest.approx(twist, abs=1e-12)
        assert np.linalg.norm(found.self_motion.dq[:2]) > 1e-3
        assert k.J @ found.self_motion.dq == pytest.approx(np.zeros(6), abs=1e-12)


def test_a_driven_base_goes_as_told_and_the_arm_keeps_the_tool_in_world(arm):
    mrf = arm.p.T_wrist_tool
    q = np.array([0.0, 0.0, 0.1, -0.7, 0.1, 1.5, 0.1, 0.6, 0.1])
    base = Rolled.at(Pose.identity(), q[:2])
    k, twist = arm.mechanism.kinematics(q, mrf, base), np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.1])
    drive, wheels = DriveRequest(speed=0.2, turn=0.1), ROLLING.wheels(0.2, 0.1)
    found = arm.body.rates(asked(arm, q, k, base, twist, drive=drive))
    assert found.wheels_commanded
    assert found.dq[:2] == pytest.approx(wheels)
    assert k.J @ found.dq == pytest.approx(twist, abs=1e-9)
    # Relative to Base the arm does the same whatever the base does.
    carried = arm.body.rates(asked(arm, q, k, base, twist, drive=drive, ground="base"))
    assert carried.dq[:2] == pytest.approx(wheels)
    assert k.J[:, 2:] @ carried.dq[2:] == pytest.approx(twist, abs=1e-9)


def test_a_recorded_base_has_the_angles_of_its_wheels():
    at = Rolled.at(Pose(rotation_rpy(0.0, 0.0, 1.0), np.ones(3)), np.array([3.0, -4.0]))
    read = unpack(pack(at))
    assert type(read) is Rolled
    assert [x.tolist() for x in (*read, read.wheels)] == [x.tolist() for x in (*at, at.wheels)]


def test_each_of_several_places_is_gone_to_from_the_one_before():
    """Not from the first: wheels that turn by turns end elsewhere than along one arc."""
    start = Rolled.at(Pose(rotation_rpy(0.1, -0.2, 0.7), np.array([1.0, 2.0, 0.3])), np.zeros(2))
    wheels = np.array([[2.0, 0.0], [2.0, 5.0], [9.0, 5.0], [9.0, 5.0]])
    R, p = ROLLING.places(start, wheels)
    at = start
    for s, angles in enumerate(wheels):
        at = ROLLING.roll(at, angles)
        np.testing.assert_array_equal(R[s], at.R)
        np.testing.assert_array_equal(p[s], at.p)
    straight = ROLLING.roll(start, wheels[2])
    assert np.linalg.norm(p[2] - straight.p) > 0.01
    np.testing.assert_array_equal(p[3], p[2])
