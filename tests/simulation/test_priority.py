"""Avoiding precedes following, in the rig: four cases at rate level and at torque level."""

import itertools
import math

import numpy as np
import pytest
from telerobot.config.load import HERE, load_cell
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

from .conftest import Run

CASES = (
    'joints = []\nprecedence = false',
    'joints = ["s1"]\nprecedence = false',
    'joints = ["s1", "s3"]\nprecedence = false',
    'joints = ["s1", "s3"]\nprecedence = true',
)  # fmt: skip
TORQUE = '\n[mechanism]\noperation_mode = "cst"\n'
POLE, HALF = np.array([0.4, 0.3, 0.78]), np.array([0.05, 0.05, 0.175])


@pytest.fixture(scope="module")
def beside_the_pole(tmp_path_factory):
    """Return a function from a case and a level to the shipped cell with those lines."""
    folder = tmp_path_factory.mktemp("pole")
    text = (HERE / "cells" / "pa10_hand_pole.toml").read_text(encoding="utf-8")
    assert text.count(CASES[3]) == 1

    def cell(case, level):
        path = folder / f"{level}_{case}.toml"
        changed = text.replace(CASES[3], CASES[case]) + (TORQUE if level == "torque" else "")
        path.write_text(changed, encoding="utf-8")
        return load_cell(path)

    return cell


def play(cell, script):
    simulation = Simulation(cell, script)
    return Run(simulation, simulation.run())


def distances(run):
    """Return how far elbow and middle of the forearm truly are from the pole (k, 2) [m]."""
    found = []
    for truth in run.truths:
        elbow = np.array([0.0, 0.0, 0.315]) + turned(truth.q[:2], 0.45)
        forearm = elbow + turned(truth.q[:4], 0.25)
        out = np.maximum(np.abs(np.array([elbow, forearm]) - POLE) - HALF, 0.0)
        found.append(np.linalg.norm(out, axis=1))
    return np.array(found)


def turned(angles, length):
    """Return a link's vector (3,) [m] after rotations about z, y, z, y, as drawn in the paper."""
    v = np.array([0.0, 0.0, length])
    for i in reversed(range(len(angles))):
        c, s = math.cos(angles[i]), math.sin(angles[i])
        about_z, about_y = [[c, -s, 0], [s, c, 0], [0, 0, 1]], [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        v = np.array(about_y if i % 2 else about_z) @ v
    return v


@pytest.mark.parametrize("level", ["rate", "torque"])
def test_each_case_keeps_further_away_and_priority_keeps_the_inner_spheres_free(
    beside_the_pole, level
):
    runs = [play(beside_the_pole(case, level), load_script("hand_swell")) for case in range(4)]
    least = [distances(run).min() for run in runs]
    assert all(b - a > 0.01 for a, b in itertools.pairwise(least)), least
    assert least[3] > 0.15, least
    for run in runs:
        told = min(min(state.spheres.values()) for state in run.states)
        assert told == pytest.approx(distances(run).min(), abs=2e-3)
        assert run.summary["mode"] == "enabled"
        assert run.summary["limit_violations"] == 0, run.summary["violations"]
        assert [e for e in run.simulation.events if e.severity == "error"] == []


def test_avoiding_begins_again_when_a_hand_leads_the_arm_from_a_posture(beside_the_pole):
    steps = [
        {"at_s": 0.1, "cmd/posture": {"posture": "ready"}},
        {
            "at_s": 0.5,
            "rig/fault": {"kind": "hand", "target": "force_torque", "vector": [0.0, 6.0, 0.0]},
        },
    ]
    script = Script.model_validate({"duration_s": 2.5, "step": steps})
    run = play(beside_the_pole(3, "rate"), script)
    assert run.events("posture_reached")
    assert not np.any(run.at(0.45).self_motion)
    late = run.at(2.4)
    assert late.objectives["spheres"][1] > 0.02
    assert late.priority == pytest.approx(math.exp(-50.0 * (late.spheres["elbow"] - 0.15)))
