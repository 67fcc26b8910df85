"""Avoiding precedes following, in the rig: four cases at rate level and at torque level."""

import itertools
import math

import numpy as np
import pytest
from laboratory.papers.hamaguchi import POLE, case_of, distances
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

LEVELS = {"rate": {}, "torque": {"mechanism.operation_mode": "cst"}}


def play(cell, script):
    simulation = Simulation(cell, script)
    return Run(simulation, simulation.run())


@pytest.mark.parametrize("level", ["rate", "torque"])
def test_each_case_keeps_further_away_and_priority_keeps_the_inner_spheres_free(level):
    runs = [
        play(case_of(case, POLE, **LEVELS[level]), load_script("hand_swell")) for case in range(4)
    ]
    least = [distances(run.truths).min() for run in runs]
    assert all(b - a > 0.01 for a, b in itertools.pairwise(least)), least
    assert least[3] > 0.15, least
    for run in runs:
        told = min(min(state.spheres.values()) for state in run.states)
        assert told == pytest.approx(distances(run.truths).min(), abs=2e-3)
        assert run.summary["mode"] == "enabled"
        assert run.summary["limit_violations"] == 0, run.summary["violations"]
        assert [e for e in run.simulation.events if e.severity == "error"] == []


def test_avoiding_begins_again_when_a_hand_leads_the_arm_from_a_posture():
    steps = [
        {"at_s": 0.1, "cmd/posture": {"posture": "ready"}},
        {
            "at_s": 0.5,
            "rig/fault": {"kind": "hand", "target": "force_torque", "vector": [0.0, 6.0, 0.0]},
        },
    ]
    script = Script.model_validate({"duration_s": 2.5, "step": steps})
    run = play(case_of(3, POLE), script)
    assert run.events("posture_reached")
    assert not np.any(run.at(0.45).self_motion)
    late = run.at(2.4)
    assert late.objectives["spheres"][1] > 0.02
    assert late.priority == pytest.approx(math.exp(-50.0 * (late.spheres["elbow"] - 0.15)))
