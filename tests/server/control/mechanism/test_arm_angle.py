"""The arm angle: against a closed form and finite differences, and chains that have none."""

import math

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.mechanism.arm_angle import ArmAngle
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.spatial import Pose, rotation_exp, rotation_rpy

from ..chains import CHAINS, chain

UPPER, FORE = 0.45, 0.5
"""Upper arm and forearm of the PA-10 [m]."""
SHOULDER = np.array([0.0, 0.0, 0.315])
MRF = Pose(rotation_rpy(0.3, -0.5, 0.7), np.array([0.05, -0.02, 0.15]))
STEP = 1e-6
HERE = "0 0 0"
IIWA = ("0 0 0.36", HERE, "0 0 0.42", HERE, "0 0 0.4", HERE, HERE, "0 0 0.126")
PANDA = (
    "0 0 0.333",
    HERE,
    "0 0 0.316",
    "0.0825 0 0",
    "-0.0825 0 0.384",
    HERE,
    "0.088 0 0",
    "0 0 0.107",
)
"""From joint to joint, as the makers of these arms tell."""


@pytest.fixture(scope="module")
def pa10():
    return Mechanism.from_cell(load_cell("pa10"))


def about(axis, angle):
    return rotation_exp(angle * np.eye(3)["xyz".index(axis)])


def elbow_and_wrist(q):
    """Elbow and wrist seen from the shoulder, by the axes Z Y Z Y of paper 001."""
    R = about("z", q[0]) @ about("y", q[1]) @ about("z", q[2])
    E = R @ [0.0, 0.0, UPPER]
    return E, E + R @ about("y", q[3]) @ [0.0, 0.0, FORE]


def by_the_arm_without_its_third_joint(q):
    """φ, as the turn about ŵ that takes the elbow of the arm with q3 = 0 to where it is."""
    E, W = elbow_and_wrist(q)
    reach = np.linalg.norm(W)
    # The elbow of the reference, up from the line to the wrist by the law of cosines.
    lift = math.acos((UPPER**2 + reach**2 - FORE**2) / (2.0 * UPPER * reach))
    turn, fall = math.atan2(W[1], W[0]), math.acos(W[2] / reach)
    reference = about("z", turn) @ about("y", fall - lift) @ [0.0, 0.0, UPPER]
    w = W / reach
    assert w @ reference == pytest.approx(w @ E, abs=1e-12)
    a, b = reference - w * (w @ reference), E - w * (w @ E)
    angle = math.atan2(w @ np.cross(a, b), a @ b)
    assert rotation_exp(angle * w) @ reference == pytest.approx(E, abs=1e-12)
    return angle


def apart(a, b):
    return abs((a - b + math.pi) % (2.0 * math.pi) - math.pi)


def read(mechanism, q, mrf=MRF):
    return mechanism.arm_angle.look(mechanism.kinematics(q, mrf))


def test_the_angle_is_that_of_the_closed_form(pa10):
    rng = np.random.default_rng(5)
    for _ in range(300):
        q = rng.uniform(-2.5, 2.5, 7)
        found, own = read(pa10, q).angle, by_the_arm_without_its_third_joint(q)
        assert math.isnan(found) or apart(found, own) < 1e-9


def test_it_is_zero_with_the_elbow_up_and_positive_right_handed_about_the_way_to_the_wrist(pa10):
    up = np.array([0.4, 0.7, 0.0, 1.2, 0.3, 0.5, -0.2])
    assert read(pa10, up).angle == pytest.approx(0.0, abs=1e-12)
    aside = up.copy()
    aside[2] = 0.3
    E, W = elbow_and_wrist(aside)
    lies = np.cross(np.array([0.0, 0.0, 1.0]), W) @ E
    assert lies * read(pa10, aside).angle < 0.0  # ŵ × V points to negative angles


def test_neither_the_tool_nor_the_first_joint_nor_base_matters():
    mechanism = Mechanism.from_cell(load_cell("pa10"))
    q = np.array([0.4, 0.7, 0.5, 1.2, 0.3, 0.5, -0.2])
    here = read(mechanism, q).angle
    turned = q + np.eye(7)[0]
    assert read(mechanism, turned).angle == pytest.approx(here, abs=1e-12)
    base = Pose(rotation_rpy(1.0, 0.4, -0.3), np.array([0.3, -0.2, 0.9]))
    moved = mechanism.arm_angle.look(mechanism.kinematics(q, Pose.identity(), base))
    assert moved.angle == pytest.approx(here, abs=1e-12)


def arm_of(name):
    made = {"iiwa": IIWA, "panda": PANDA}
    return chain("zyzyzyz", *made[name]) if name in made else Mechanism.from_cell(load_cell(name))


@pytest.mark.parametrize("name", ["pa10", "ranger", "rover", "rover_bridge", "iiwa", "panda"])
def test_its_slope_is_that_of_finite_differences(name):
    mechanism = arm_of(name)
    rng, tried = np.random.default_rng(7), 0
    while tried < 20:
        q = rng.uniform(-2.0, 2.0, mechanism.n)
        found = read(mechanism, q)
        if math.isnan(found.angle) or np.abs(found.slope).max() > 20.0:
            continue
        tried += 1
        for j in range(mechanism.n):
            step = STEP * np.eye(mechanism.n)[j]
            up, down = read(mechanism, q + step).angle, read(mechanism, q - step).angle
            change = (up - down + math.pi) % (2.0 * math.pi) - math.pi
            assert found.slope[j] == pytest.approx(0.5 * change / STEP, abs=2e-7)


@pytest.mark.parametrize(
    "q",
    [
        [0.3, 0.7, 0.2, 0.0, 0.1, 0.4, 0.0],  # stretched: the elbow is on no circle
        [0.3, 0.0, 0.2, 0.0, 0.1, 0.4, 0.0],  # upright
        # the wrist above the shoulder: the first axis goes through it
        [0.3, -math.atan2(FORE * math.sin(1.2), UPPER + FORE * math.cos(1.2)), 0.0, 1.2, 0, 0, 0],
    ],
)
def test_where_there_is_no_angle_none_is_told(pa10, q):
    found = read(pa10, np.array(q))
    assert math.isnan(found.angle)
    assert np.isfinite(found.slope).all()


def test_arms_of_a_shoulder_an_elbow_and_a_wrist_have_it_and_others_have_none():
    def samples(mechanism):
        rng = np.random.default_rng(3)
        return [mechanism.wrist(rng.uniform(-3, 3, mechanism.n)) for _ in range(5)]

    for name in ("ur5e", "planar3", "gantry", "snake", "snake_space"):
        assert Mechanism.from_cell(load_cell(name)).arm_angle is None
    for mechanism, _ in CHAINS.values():
        assert ArmAngle.of(samples(mechanism)) is None
    # seven joints with axes that are all apart, and a wrist or a shoulder that is
    assert chain("zyzyzyz").arm_angle is None
    apart = "0.02 0 0"
    assert chain("zyzyzyz", *IIWA[:5], apart, *IIWA[6:]).arm_angle is None
    assert chain("zyzyzyz", IIWA[0], apart, *IIWA[2:]).arm_angle is None
