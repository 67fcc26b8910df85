"""The simulated handle against mechanics in closed form."""

import math
from itertools import pairwise

import numpy as np
import pytest
from telerobot.config.schema.network import HandleSection, HandSection
from telerobot.drivers.rig.handle import STEP_S, HandPath, SimulatedHandle, jacobian, place

NOTHING = np.zeros(6)


def go(device, seconds, wrench=NOTHING, start_s=0.0):
    for i in range(round(seconds / STEP_S)):
        device.step(np.array(wrench, dtype=float), start_s + i * STEP_S)
    return device


@pytest.mark.parametrize("seed", range(5))
def test_the_jacobian_is_the_slope_of_the_place(seed):
    q = np.random.default_rng(seed).uniform(-0.6, 0.6, 3)
    J, h = jacobian(q), 1e-6
    for i, e in enumerate(np.eye(3)):
        slope = (place(q + h * e) - place(q - h * e)) / (2 * h)
        np.testing.assert_allclose(J[:3, i], slope, atol=1e-9)
    np.testing.assert_array_equal(J[3:], 0.0)


def test_at_its_centre_the_handle_is_at_the_origin():
    np.testing.assert_allclose(place(np.zeros(3)), 0.0, atol=1e-15)


def test_a_reflected_force_moves_the_stick_by_force_over_stiffness_in_its_direction():
    handle, hand = HandleSection(), HandSection()
    force = np.array([-1.5, 0.6, 0.9])
    device = go(SimulatedHandle(handle, hand), 3.0, [*force, 0, 0, 0])
    np.testing.assert_allclose(device.p, force / (handle.spring + hand.stiffness), atol=1e-6)


def test_motors_are_no_stronger_than_they_are_and_make_no_moment():
    handle = HandleSection(max_force=2.0)
    device = go(SimulatedHandle(handle, HandSection()), 3.0, [-30.0, 0, 0, 5.0, 5.0, 5.0])
    np.testing.assert_allclose(device.force, [-2.0, 0, 0])
    np.testing.assert_allclose(device.p, [-2.0 / 300.0, 0, 0], atol=1e-6)


def test_the_hand_is_where_it_means_to_be_and_no_further_than_its_springs_let_it():
    handle, hand = HandleSection(), HandSection()
    device = SimulatedHandle(handle, hand)
    device.path.move(np.array([0.03, 0.0, 0.0]), 0.5, 0.0)
    go(device, 3.0)
    part = hand.stiffness / (hand.stiffness + handle.spring)
    np.testing.assert_allclose(device.p, [0.03 * part, 0, 0], atol=1e-6)
    device.spring = False
    go(device, 3.0, start_s=3.0)
    np.testing.assert_allclose(device.p, [0.03, 0, 0], atol=1e-6)


def test_let_go_the_stick_returns_to_its_centre_as_damped_as_it_is():
    handle = HandleSection(damping=0.5, spring_damping=0.5)
    device = SimulatedHandle(handle, HandSection())
    device.path.move(np.array([0.0, 0.0, 0.02]), 0.5, 0.0)
    go(device, 2.0)
    device.held = False
    heights = [float(go(device, STEP_S, start_s=2.0).p[2]) for _ in range(2000)]
    crossings = [i for i, (a, b) in enumerate(pairwise(heights)) if a * b < 0]
    half_s = float(np.diff(crossings).mean()) * STEP_S
    # The motors' own inertia is felt as J⁻ᵀ I J⁻¹, about 4e-4 / 0.14² = 0.02 kg.
    assert half_s == pytest.approx(math.pi / math.sqrt(handle.spring / 0.42), rel=0.02)
    peaks = [max(abs(h) for h in heights[a:b]) for a, b in pairwise(crossings)]
    expected = math.exp(-1.0 / (2 * 0.42) * half_s)
    assert peaks[2] / peaks[1] == pytest.approx(expected, rel=0.05)


def test_the_hands_work_is_the_force_along_the_way():
    device = SimulatedHandle(HandleSection(), HandSection())
    device.path.move(np.array([0.05, 0.0, 0.0]), 1.0, 0.0)
    device.spring = False
    go(device, 3.0, [-2.0, 0, 0, 0, 0, 0])
    # from where it stands, at rest, to where it stands in the end: force times way
    assert device.work == pytest.approx(2.0 * device.p[0], abs=1e-9)


def test_a_minimum_jerk_path_begins_and_ends_at_rest_and_goes_on_from_where_it_is():
    path = HandPath()
    path.move(np.array([0.1, 0.0, 0.0]), 2.0, 1.0)
    assert path.at(0.5)[0] == pytest.approx([0, 0, 0])
    middle, rate = path.at(2.0)
    assert middle == pytest.approx([0.05, 0, 0])
    assert rate == pytest.approx([1.875 * 0.1 / 2.0, 0, 0])
    path.move(np.zeros(3), 1.0, 2.0)
    assert path.at(2.0)[0] == pytest.approx([0.05, 0, 0])
    assert path.at(4.0)[0] == pytest.approx([0, 0, 0])
