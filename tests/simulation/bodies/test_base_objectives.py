"""A base that takes part in redundancy objectives (Zhang 2013, eq. 7), by the physics' truth."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.mechanism.redundancy import Redundancy
from telerobot.server.control.spatial import Pose
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import simulate

REACH = [
    {"at_s": 0.2, "cmd/posture": {"posture": "ready"}},
    {
        "at_s": 2.5,
        "cmd/position": {
            "xyz": (0.0, 0.0, 0.28),
            "rpy": (0.0, 0.0, 0.0),
            "relative_to": "mrf",
            "speed": 0.25,
        },
    },
    {"at_s": 5.0, "operator/frame": {"frame": "crf", "moves_with": "world"}},
    {
        "at_s": 5.2,
        "cmd/position": {"xyz": (0.0, 0.0, 0.0), "rpy": (0.0, 0.0, 0.0), "relative_to": "mrf"},
    },
]
HERE = Pose.identity()


@pytest.fixture(scope="module")
def mechanism():
    return Mechanism.from_cell(load_cell("rover"))


def stretched(objectives, gains, seconds=7.0):
    """The rover reaches out, and holds its tool in World from 5.2 s on."""
    chosen = {f"redundancy.{name}": gain for name, gain in gains.items()}
    cell = altered(load_cell("rover"), {"mechanism.base.objectives": objectives, **chosen})
    result = simulate(cell, Script.model_validate({"duration_s": 5.2 + seconds, "step": REACH}))
    assert result.summary["failure"] is None
    assert result.summary["limit_violations"] == 0
    held = [t for t in result.truths if t.time_s > 5.3]
    tool = np.array([t.pose_mrf[:3] for t in held])
    base = np.array([t.frames["base"][0] for t in held])
    return np.linalg.norm(tool - tool[0], axis=1).max(), base - base[0], result.states[-1]


def whole(mechanism, q):
    """Manipulability (6, 9) of base and arm."""
    J = mechanism.kinematics(np.array(q), HERE, HERE).J
    return float(np.sqrt(np.linalg.det(J @ J.T)))


def test_a_base_that_takes_part_backs_off_until_base_and_arm_are_more_dexterous(mechanism):
    off, base, last = stretched(("manipulability",), {"manipulability": 2.0, "posture": 0.0})
    alone, stands, before = stretched((), {"manipulability": 2.0, "posture": 0.0}, 2.0)
    assert max(off, alone) < 1e-3
    assert np.abs(stands).max() < 1e-3
    assert base[-1] < -0.08
    assert whole(mechanism, last.q) > 1.2 * whole(mechanism, before.q)


def test_a_base_that_takes_part_brings_the_arm_back_to_its_posture():
    off, base, last = stretched(("posture",), {"posture": 0.5})
    _, _, before = stretched((), {"posture": 0.5}, 2.0)
    ready = np.array(load_cell("rover").config.mechanism.postures["ready"])[2:]
    assert off < 1e-3
    assert base[-1] > 0.08
    away = [np.linalg.norm(np.array(state.q)[2:] - ready) for state in (last, before)]
    assert away[0] < 0.75 * away[1]


@pytest.mark.parametrize("objectives", [("manipulability",), ()])
def test_wheels_count_in_what_objectives_climb_where_the_base_takes_part(monkeypatch, objectives):
    wheels, rate = [], Redundancy.rate

    def seen(self, view, *more):
        wheels.append(np.abs(view.J[:, :2]).max())
        return rate(self, view, *more)

    monkeypatch.setattr(Redundancy, "rate", seen)
    stretched(objectives, {"manipulability": 2.0, "posture": 0.0}, 0.2)
    assert bool(wheels[-1] > 0.01) is bool(objectives)
