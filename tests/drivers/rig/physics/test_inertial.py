"""What an accelerometer and a gyroscope feel, against differences of where the link is."""

import mujoco
import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.section import PoseSection
from telerobot.drivers.rig.physics.world import World

AT = PoseSection(xyz=(0.1, -0.2, 0.3), rpy=(0.4, -0.3, 1.1))
UP = np.array([0.0, 0.0, 9.81])


def rotation(rpy):
    (a, b, c), (sa, sb, sc) = np.cos(rpy), np.sin(rpy)
    x = np.array([[1, 0, 0], [0, a, -sa], [0, sa, a]])
    y = np.array([[b, 0, sb], [0, 1, 0], [-sb, 0, b]])
    z = np.array([[c, -sc, 0], [sc, c, 0], [0, 0, 1]])
    return z @ y @ x


@pytest.fixture
def falling():
    """An arm in the air, its brakes open, with a step so short that differences are exact."""
    cell = altered(load_cell("pa10"), {"rig.physics_step_s": 1e-4, "rig.wall": None})
    world = World(cell)
    for joint in range(world.n):
        world.set_brake(joint, closed=False)
    return world


def placed(world):
    """Where the place is (3,), and its axes (3, 3), in World."""
    mujoco.mj_kinematics(world.model, world.data)
    body = world.model.body("flange").id
    R = world.data.xmat[body].reshape(3, 3)
    return world.data.xpos[body] + R @ np.array(AT.xyz), R @ rotation(AT.rpy)


def test_it_is_the_second_difference_of_its_place_less_gravity_and_the_turning_of_its_axes(
    falling,
):
    torque = np.array([20.0, -60.0, 10.0, 30.0, 3.0, -4.0, 2.0])
    for _ in range(400):
        falling.step(torque)
    mujoco.mj_forward(falling.model, falling.data)
    falling.inertial(0, False, AT)
    falling.step(torque)
    places, axes, dt = [], [], falling.dt
    for k in range(3):
        place, R = placed(falling)
        places.append(place)
        axes.append(R)
        if k == 1:
            mujoco.mj_forward(falling.model, falling.data)
            felt, rate = falling.inertial(0, False, AT)
        falling.step(torque)
    expected = axes[1].T @ ((places[2] - 2.0 * places[1] + places[0]) / dt**2 + UP)
    turn = (axes[2] - axes[0]) / (2.0 * dt) @ axes[1].T
    spin = axes[1].T @ np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
    assert np.linalg.norm(rate) > 0.5
    assert np.linalg.norm(felt - axes[1].T @ UP) > 1.0
    np.testing.assert_allclose(rate, spin, atol=2e-3 * np.linalg.norm(spin))
    np.testing.assert_allclose(felt, expected, atol=1e-2 * np.linalg.norm(expected))


def test_at_rest_it_feels_its_support_alone(falling):
    felt, rate = falling.inertial(0, True, AT)
    np.testing.assert_allclose(felt, rotation(AT.rpy).T @ UP, atol=1e-9)
    np.testing.assert_allclose(rate, 0.0, atol=1e-12)


def test_it_feels_the_mean_of_a_period_not_the_instant_of_its_sample():
    """Drives pull unevenly within a period: the sum over samples is the change of speed."""
    world = World(load_cell("rover"))
    unit = PoseSection()
    gained, start = 0.0, world.data.qvel[0]
    world.inertial(0, True, unit)
    for joint in range(world.n):
        world.set_brake(joint, closed=joint > 1)
    for _ in range(40):
        for k in range(10):
            world.step(np.array([20.0 * (k > 4), 20.0 * (k > 4), *(0.0,) * (world.n - 2)]))
        felt, _ = world.inertial(0, True, unit)
        gained += 0.01 * felt[0]
    assert world.data.qvel[0] - start > 0.2
    assert gained == pytest.approx(world.data.qvel[0] - start, rel=0.05)
