"""The planar arm of Scott and Carignan, section IV: table II of the cell, and figure 4 by physics.

Its task is the tool's place; how the tool turns is the null space's. Potentials stand here once
more, from eqs. 8, 17 and 20 by hand.
"""

import math
from itertools import pairwise

import numpy as np
import pytest
from laboratory.papers.scott import slopes
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

K = 0.1
CHARGE, TIP = np.array([1.5, 1.3]), np.array([2.0, 1.0])
START = np.array([0.0, math.pi / 2, -math.pi / 2])
PRINTED = np.array([-0.36, 1.79, -1.07])
"""The minimum that figure 4 prints."""
TABLE_II = {
    "obstacles": (-0.9161, -0.2268, -0.2858),
    "joint_limits": (0.0, -0.0250, 0.0250),
    "manipulability": (0.0, 0.0, 0.0),
}


def joints(q):
    """Return where the joints and the tip are (4, 2)."""
    a = np.cumsum(q)
    return np.vstack([np.zeros(2), np.cumsum(np.c_[np.cos(a), np.sin(a)], axis=0)])


def rows(q):
    lever = joints(q)[3] - joints(q)[:3]
    return np.array([-lever[:, 1], lever[:, 0]])


def obstacles(q):
    """Each link is charged: the potential of a point beside a segment of length 1."""
    sums = np.linalg.norm(joints(q) - CHARGE, axis=1)
    return K * sum(math.log((a + b + 1.0) / (a + b - 1.0)) for a, b in pairwise(sums))


def joint_limits(q):
    return 0.5 * K / (2.0 * math.pi) * float(q @ q)


def manipulability(q):
    return -K * math.sqrt(np.linalg.det(rows(q) @ rows(q).T))


PARTS = {"obstacles": obstacles, "joint_limits": joint_limits, "manipulability": manipulability}


def total(q):
    return sum(of(q) for of in PARTS.values())


def torque(of, q, step=1e-6):
    """Return −∂V/∂q (3,) by central differences."""
    return np.array([(of(q - a) - of(q + a)) / (2.0 * step) for a in step * np.eye(3)])


def along(of, q):
    """Return −∂V/∂q along the self-motion in which the first joint turns down."""
    way = np.linalg.svd(rows(q))[2][2]
    return float(torque(of, q) @ way) * -np.sign(way[0])


def posture(q1, side):
    """Return the posture with the tip at its place: elbow to the one `side` or the other, ±1."""
    away = TIP - [math.cos(q1), math.sin(q1)]
    bent = side * math.acos(0.5 * float(np.linalg.norm(away)))
    ahead = math.atan2(away[1], away[0])
    return np.array([q1, ahead + bent - q1, -2.0 * bent])


def least(side, low, high):
    """Return the posture of the least potential between two first angles, by golden section."""
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    for _ in range(60):
        a, b = high - ratio * (high - low), low + ratio * (high - low)
        low, high = (low, b) if total(posture(a, side)) < total(posture(b, side)) else (a, high)
    return posture(low, side)


@pytest.fixture(scope="module")
def run():
    simulation = Simulation(load_cell("planar3"), load_script("figure_4"))
    return Run(simulation, simulation.run())


@pytest.mark.parametrize("part", TABLE_II)
def test_the_cell_has_the_slopes_of_table_2(part):
    found = slopes(part)
    np.testing.assert_allclose(found, TABLE_II[part], atol=5.1e-5)
    np.testing.assert_allclose(found, torque(PARTS[part], START), atol=2e-5)


def test_the_arm_slides_to_the_least_potential_and_its_tool_stays(run):
    assert run.result.ok
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    ended, minimum = np.array(run.states[-1].q), least(-1, -0.6, -0.1)
    np.testing.assert_allclose(ended, minimum, atol=3e-4)
    assert abs(along(total, ended)) < 1e-4
    assert run.states[-1].potential["slope"] < 1e-4
    assert run.states[-1].at_goal
    off = [np.subtract(t.pose_mrf[:3], (*TIP, 0.5)) for t in run.truths]
    assert np.linalg.norm(off, axis=1).max() < 3e-3


def test_what_is_printed_is_no_minimum_whatever_the_strengths_but_a_posture_on_the_way(run):
    """Each of the three potentials alone falls further there: no sum of them is at its least."""
    here = posture(PRINTED[0], 1)
    np.testing.assert_allclose(here, PRINTED, atol=0.02)
    assert {name: round(along(of, here), 2) for name, of in PARTS.items()} == {
        "obstacles": 0.10, "joint_limits": 0.01, "manipulability": 0.03,
    }  # fmt: skip
    # From the start to the straight elbow, where the arm goes over to the other side, all falls.
    way = [total(posture(q1, 1)) for q1 in np.arange(0.0, -0.64, -0.01)]
    assert (np.diff(way) < 0.0).all()
    # The run comes by; steps of g Pτ are below the paper's 0.001 rad there with any g below 0.007.
    passed = np.linalg.norm(np.array([s.q_command for s in run.states]) - PRINTED, axis=1)
    assert passed.min() < 0.02
    assert 0.001 / np.linalg.norm(along(total, PRINTED)) == pytest.approx(0.007, abs=2e-4)
    assert total(PRINTED) == pytest.approx(0.170, abs=1e-3)
    assert total(least(-1, -0.6, -0.1)) == pytest.approx(-0.011, abs=1e-3)


def test_its_mirror_image_is_near_the_minimum():
    """Links 2 and 3 exchanged: the tip stays where it is, and |Pτ| is 0.003 and not 0.14 N·m."""
    q1, q2, q3 = PRINTED
    mirrored = np.array([q1, q2 + q3, -q3])
    np.testing.assert_allclose(joints(mirrored)[3], joints(PRINTED)[3], atol=1e-12)
    np.testing.assert_allclose(mirrored, least(-1, -0.6, -0.1), atol=0.04)
    assert abs(along(total, mirrored)) < 0.005
    assert along(total, PRINTED) == pytest.approx(0.143, abs=1e-3)


def test_a_tool_whose_attitude_is_held_leaves_nothing_to_slide():
    steps = [
        {"at_s": 0.1, "operator/free_axes": {"axes": []}},
        *load_script("figure_4").step,
    ]
    script = Script.model_validate({"duration_s": 2.0, "step": steps})
    simulation = Simulation(load_cell("planar3"), script)
    run = Run(simulation, simulation.run())
    assert run.summary["refused"] == []
    np.testing.assert_allclose(run.states[-1].q, START, atol=1e-3)
