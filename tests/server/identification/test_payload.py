import numpy as np
import pytest
from telerobot.drivers.rig.nodes.sensors import response
from telerobot.server.control.spatial import rotation_exp, rotation_log, rotation_rpy
from telerobot.server.identification.payload import NotIdentified, estimate

BIAS = np.array([1.0, -2.0, 3.0, 0.1, -0.2, 0.3])
NOISE = np.array([0.05] * 3 + [0.002] * 3) / np.sqrt(60)
"""Of a mean over 0.6 s."""
R_NOMINAL = rotation_rpy(0.0, 0.0, 0.5)


def attitudes(rng, count):
    turns = rng.normal(size=(count, 3))
    sizes = rng.uniform(0, np.pi, size=(count, 1))
    return np.array(
        [rotation_exp(r) for r in turns / np.linalg.norm(turns, axis=1)[:, None] * sizes]
    )


def readings(R_world_wrist, mass, com, R_wrist_sensor, rng, cross_talk=0.0, noise=NOISE):
    """What a sensor tells that holds a payload up, in the sign of what the arm exerts."""
    matrix = response(cross_talk, rng)
    told = []
    for R in R_world_wrist:
        f = mass * (R @ R_wrist_sensor).T @ [0, 0, 9.81]
        told.append(
            matrix @ np.concatenate([f, np.cross(com, f)]) - BIAS + rng.normal(size=6) * noise
        )
    return np.array(told)


def apart(R_a, R_b):
    return np.rad2deg(np.linalg.norm(rotation_log(R_a.T @ R_b)))


@pytest.mark.parametrize("cross_talk", [0.0, 0.02])
def test_what_is_true_is_found_whatever_the_signs_of_noise_and_cross_talk(cross_talk):
    for seed in range(40):
        rng = np.random.default_rng(seed)
        mass, com = rng.uniform(1, 5), rng.uniform(-0.1, 0.1, 3)
        R_true = R_NOMINAL @ rotation_exp(np.deg2rad(3) * np.array([0.6, -0.64, 0.48]))
        R = attitudes(rng, 20)
        found = estimate(R, readings(R, mass, com, R_true, rng, cross_talk), R_NOMINAL)
        assert found.mass == pytest.approx(mass, rel=0.01)
        assert np.linalg.norm(found.com - com) < 0.005
        assert apart(R_true, found.R_wrist_sensor) < 0.5
        np.testing.assert_allclose(found.bias, BIAS, atol=0.05)
        assert found.mounting_known
        assert (found.calibration is not None) == (cross_talk > 0.0)
        assert found.residual.force < 0.05


def test_with_its_correction_every_reading_at_rest_is_explained():
    rng = np.random.default_rng(3)
    R, mass, com = attitudes(rng, 40), 2.0, np.array([0.05, -0.03, 0.08])
    told = readings(R, mass, com, R_NOMINAL, rng, 0.02)
    found = estimate(R[:20], told[:20], R_NOMINAL)
    assert found.calibration is not None
    assert found.rigid_residual.force > 5 * found.residual.force
    for R_world_wrist, reading in zip(R[20:], told[20:], strict=True):
        f = found.mass * (R_world_wrist @ found.R_wrist_sensor).T @ [0, 0, 9.81]
        weight = np.concatenate([f, np.cross(found.com, f)])
        contact = found.calibration @ (reading + found.bias) - weight
        assert np.linalg.norm(contact[:3]) < 0.1
        assert np.linalg.norm(contact[3:]) < 0.005


def test_without_noise_everything_is_exact():
    rng = np.random.default_rng(4)
    R, com = attitudes(rng, 8), np.array([0.01, 0.02, 0.03])
    told = readings(R, 1.5, com, R_NOMINAL, rng, noise=0.0)
    found = estimate(R, told, np.eye(3))
    assert found.mass == pytest.approx(1.5, rel=1e-9)
    np.testing.assert_allclose(found.com, com, atol=1e-9)
    np.testing.assert_allclose(found.R_wrist_sensor, R_NOMINAL, atol=1e-9)
    np.testing.assert_allclose(found.bias, BIAS, atol=1e-9)


def test_a_payload_too_light_to_show_the_mounting_keeps_the_cells_own():
    rng = np.random.default_rng(5)
    R = attitudes(rng, 20)
    com = np.array([0.0, 0.0, 0.05])
    found = estimate(R, readings(R, 0.1, com, R_NOMINAL, rng), R_NOMINAL)
    assert not found.mounting_known
    assert apart(R_NOMINAL, found.R_wrist_sensor) < 1e-9
    assert found.mass == pytest.approx(0.1, abs=0.005)
    assert np.linalg.norm(found.com - com) < 0.005


def test_a_bare_sensor_has_a_bias_only():
    rng = np.random.default_rng(6)
    R = attitudes(rng, 20)
    found = estimate(R, readings(R, 0.0, np.zeros(3), R_NOMINAL, rng), R_NOMINAL)
    assert found.mass < 0.005
    np.testing.assert_array_equal(found.com, np.zeros(3))
    np.testing.assert_allclose(found.bias, BIAS, atol=0.02)


@pytest.mark.parametrize("count", [1, 3, 20])
def test_attitudes_that_are_few_or_alike_are_refused_with_their_condition(count):
    rng = np.random.default_rng(7)
    R = np.array([rotation_exp(0.05 * rng.normal(size=3)) for _ in range(count)])
    with pytest.raises(NotIdentified, match="condition"):
        estimate(R, readings(R, 2.0, np.zeros(3), R_NOMINAL, rng), R_NOMINAL)


def test_a_sensor_axis_of_the_wrong_sign_is_named():
    rng = np.random.default_rng(8)
    R = attitudes(rng, 20)
    told = readings(R, 2.0, np.zeros(3), R_NOMINAL, rng)
    told[:, 0] *= -1
    with pytest.raises(NotIdentified, match="sign"):
        estimate(R, told, R_NOMINAL)
