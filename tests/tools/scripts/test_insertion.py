"""A stick that drives a peg in and searches where it jams, against a plate with a hole."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from telerobot.tools.scripts.generators import CAUGHT, GENTLE, ROUND, InsertionMotion
from telerobot.tools.scripts.script import DrivenInsertion, Step

T, SPEED, GAIN = 0.01, 0.004, 3e-4
RIM_M = 0.002
"""The plate is so far ahead [m]."""
CATCHES = 0.002
"""A peg falls in so near the hole's axis [m]."""


class Plate:
    """What a stick's twist does to a tool that presses a plate with a hole off its way."""

    def __init__(self, hole=(0.0, 0.0)):
        self.hole = np.array(hole)
        self.at, self.force, self.turned = np.zeros(3), np.zeros(3), np.zeros(3)
        self.past = []

    def state(self):
        told = SimpleNamespace(
            pose_mrf_measured=(*self.at, *self.turned),
            wrench_mrf=(*self.force, 0.0, 0.0, 0.0),
        )
        return SimpleNamespace(of=lambda _task: told)

    def move(self, motion, seconds):
        for _ in range(round(seconds / T)):
            said = motion.fields(len(self.past) * T, self.state())
            u = np.array(said["twist"][:3])
            self.turned = self.turned + T * np.array(said["twist"][3:])
            held = self.at[0] >= RIM_M and math.dist(self.at[1:], self.hole) > CATCHES
            self.force = np.array([u[0] / GAIN if held else 0.0, 0.0, 0.0])
            self.at = self.at + T * (u * [0.0, 1.0, 1.0] if held else u)
            self.past.append((said, self.at, self.turned))
        return self.at


def insertion(**more):
    told = {"velocity": (SPEED, 0.0, 0.0), "expressed_in": "world", "way": 0.03, **more}
    return InsertionMotion(DrivenInsertion.model_validate(told))


def test_where_nothing_holds_it_up_it_goes_straight_to_the_end_of_its_way():
    plate = Plate()
    at = plate.move(insertion(search=0.005), 12.0)
    np.testing.assert_allclose(at, [0.03, 0.0, 0.0], atol=2 * T * SPEED)
    assert not np.any(plate.past[-1][0]["twist"])


def test_beside_the_hole_it_finds_it_in_a_spiral_and_presses_more_gently_meanwhile():
    plate = Plate((0.003, -0.004))
    at = plate.move(insertion(search=0.007), 45.0)
    assert at[0] >= 0.03 - 2 * T * SPEED
    searched = [said["twist"] for said, *_ in plate.past if any(said["twist"][1:3])]
    assert len(searched) > 100
    assert {round(u[0] / SPEED, 9) for u in searched} == {GENTLE}
    assert max(math.hypot(u[1], u[2]) for u in searched) <= 1.6 * ROUND
    # Once it is caught it goes on straight.
    caught = next(k for k, (_, at, _) in enumerate(plate.past) if at[0] > RIM_M + 2.0 * CAUGHT)
    assert not any(any(said["twist"][1:3]) for said, *_ in plate.past[caught:])


def test_without_a_search_it_presses_on_as_a_stick_does():
    plate = Plate((0.005, 0.0))
    plate.move(insertion(), 10.0)
    assert all(said["twist"] == (SPEED, 0.0, 0.0, 0.0, 0.0, 0.0) for said, *_ in plate.past)


def test_a_hole_farther_off_than_it_searches_is_not_found_and_it_stays_about_where_it_jammed():
    plate = Plate((0.02, 0.0))
    at = plate.move(insertion(search=0.004), 60.0)
    assert at[0] == pytest.approx(RIM_M, abs=2 * T * SPEED)
    assert max(math.hypot(*at[1:]) for _, at, _ in plate.past) < 0.0065


@pytest.mark.parametrize("swing", [True, False], ids=["swings", "leans"])
def test_the_spiral_turns_to_and_fro_about_the_way_or_leans_and_drifts_nowhere(swing):
    plate = Plate((0.02, 0.0))
    plate.move(insertion(search=0.006, tilt=0.005, swing=swing), 30.0)
    turned = np.array([turned for _, _, turned in plate.past])
    about, across = np.abs(turned[:, 0]).max(), np.abs(turned[:, 1:]).max()
    most, none = (about, across) if swing else (across, about)
    assert 0.003 < most < 0.0055
    assert none < 1e-4


@pytest.mark.parametrize("searches", [False, True], ids=["driven", "searching"])
def test_a_payload_with_several_pegs_is_kept_from_turning_about_one_that_stands(searches):
    """A single tool may turn: a hole that leans turns it."""
    for swing in (True, False):
        plate, motion = Plate((0.02, 0.0)), insertion(search=0.006, swing=swing)
        plate.move(motion, 4.0 if searches else 0.2)
        plate.turned = np.array([0.0, -0.004, 0.02])
        plate.move(motion, T)
        turns = np.array(plate.past[-1][0]["twist"][3:])
        assert turns[0] == 0.0
        assert (turns[1] > 0.0 > turns[2]) if swing else not turns.any()
        assert np.linalg.norm(turns) <= 0.021
        plate.move(motion, 3.0)
        assert (np.abs(plate.turned[1:]).max() < 1e-3) == swing


def test_it_may_be_driven_along_the_tools_own_axis():
    plate = Plate((0.003, 0.0))
    at = plate.move(insertion(expressed_in="mrf", search=0.006), 45.0)
    assert at[0] > 0.02
    assert plate.past[0][0]["expressed_in"] == plate.past[0][0]["relative_to"] == "mrf"


@pytest.mark.parametrize("velocity", [[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]])
def test_a_speed_that_is_none_or_too_fast_is_an_error(velocity):
    with pytest.raises(ValueError, match=r"m/s: 0\.0001 to 0\.1 is expected"):
        Step.model_validate({"at_s": 0.0, "insertion": {"velocity": velocity, "way": 0.01}})


def test_a_step_of_it_is_a_stick_that_ends_when_it_is_told():
    step = Step.model_validate(
        {
            "at_s": 0.0,
            "for_s": 2.0,
            "insertion": {"task": "beam", "velocity": [0.004, 0, 0], "way": 0.01},
        }
    )
    assert step.streams == {"cmd/joystick:beam"}
