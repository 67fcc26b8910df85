"""A peg goes into a hole that is not where it is meant to be: some of the campaign's directions."""

import dataclasses
import math

import numpy as np
import pytest
from laboratory.campaign.contact.insertion import (
    DIRECTIONS,
    GENTLE,
    OFFSET,
    ROUGH,
    SQUEEZED,
    TILT,
    Attempt,
    PegInsertion,
    attempt,
    misplaced,
)
from laboratory.oracle.poses import matrix, rotation_vector
from telerobot.config.load import load_cell
from telerobot.protocols import topics as t
from telerobot.tools.scripts.script import load_script
from telerobot.tools.simulation.simulation import simulate


@pytest.mark.parametrize(("direction", "part"), [(4, 1), (20, 1), (23, 2)])
def test_rate_and_force_together_insert_the_peg_gently(direction, part):
    found = attempt(Attempt(direction, stiff=False, part=part))
    assert found.inserted, found
    assert found.limit_violations == 0
    # It was felt on the way: the hole really is off.
    assert found.net_n > 10.0
    # A sum of magnitudes is never below the net force; a tilted peg is pressed from two sides.
    assert found.peak_n > 2.0 * found.net_n


@pytest.mark.parametrize(
    ("found", "why"),
    [
        ({"deep_s": math.inf}, "not inserted"),
        ({"net_n": GENTLE + 1.0}, "pushed beyond 35 N net"),
        ({"peak_n": SQUEEZED + 7.0}, "squeezed beyond 130 N in all"),
        ({"end": "fault: s1"}, "ended early: fault: s1"),
    ],
)
def test_what_speaks_against_an_insertion_is_said(found, why):
    gentle = PegInsertion(23, False, 2, 0.039, 10.5, 23.0, 119.0, 0, "")
    assert gentle.inserted
    assert gentle.reasons == []
    other = dataclasses.replace(gentle, **found)
    assert not other.inserted
    (reason,) = other.reasons
    assert reason.startswith(why)


@pytest.mark.parametrize("direction", [0, 19])
def test_without_force_control_the_same_motion_is_rough(direction):
    found = attempt(Attempt(direction, stiff=True))
    assert not found.inserted
    assert found.net_n > ROUGH > GENTLE
    assert found.limit_violations == 0


def test_the_shipped_insertion_is_played_as_it_is_written():
    result = simulate("pa10_peg")
    assert result.ok
    assert result.summary["refused"] == []
    assert result.summary["mode"] == "enabled"
    assert [e for e in result.summary["events"] if e["severity"] == "error"] == []
    hole = load_cell("pa10_peg").config.rig.holes[0]
    T = matrix(hole.T_world_hole) @ matrix(hole.misplaced)
    depth = (T[:3, 3] - result.truths[-1].pose_mrf[:3]) @ T[:3, 2]
    assert depth > 0.03


def test_both_scripts_ask_the_same_of_the_stick():
    force, stiff = load_script("peg_insert"), load_script("peg_insert_stiff")
    sticks = [
        [(s.at_s, u) for s in script.steps if (u := s.says(t.JOYSTICK))]
        for script in (force, stiff)
    ]
    assert sticks[0] == sticks[1]
    switched = [switch["on"] for s in stiff.steps if (switch := s.says(t.SWITCH))]
    assert switched == [False]


def test_every_direction_is_as_far_off_and_each_is_another():
    poses = [matrix(misplaced(d)) for d in range(DIRECTIONS)]
    for T in poses:
        assert np.linalg.norm(T[:3, 3]) == pytest.approx(OFFSET)
        assert np.linalg.norm(rotation_vector(T[:3, :3])) == pytest.approx(TILT)
    apart = [np.abs(a - b).max() for i, a in enumerate(poses) for b in poses[:i]]
    assert min(apart) > 1e-3
