"""Load shares of two arms that change while the beam moves (Williams 1997, section 3)."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

GRAVITY = 9.81
MASS = 5.0
AT = np.array([[0.0, 0.55, 0.0], [0.0, -0.55, 0.0]])
"""The grasps, seen from the middle of the beam [m]."""
DEAR = [[3.0] * 6, [1.0] * 6]
MOVES = {
    "at_s": 0.3,
    "for_s": 3.0,
    "cmd/joystick": {"task": "beam", "twist": [-0.02, 0, 0.03, 0, 0, 0], "expressed_in": "world"},
}


def shared(weights):
    """Return what each arm carries along the vertical [N], by the conditions' dense solution."""
    W = np.diag(np.concatenate(weights))
    G = np.zeros((6, 12))
    for i, (x, y, z) in enumerate(AT):
        G[:, 6 * i : 6 * i + 6] = np.eye(6)
        G[3:, 6 * i : 6 * i + 3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    conditions = np.block([[2.0 * W, G.T], [G, np.zeros((6, 6))]])
    wrench = np.array([0, 0, MASS * GRAVITY, 0, 0, 0])
    return np.linalg.solve(conditions, np.concatenate([np.zeros(12), wrench]))[[2, 8]]


def played(*steps, seconds):
    script = Script.model_validate({"duration_s": seconds, "step": list(steps)})
    simulation = Simulation(load_cell("pa10_pair"), script)
    return Run(simulation, simulation.run())


def asked(weights, at_s=1.0):
    return {"at_s": at_s, "operator/load_shares": {"task": "beam", "weights": weights}}


@pytest.fixture(scope="module")
def changed():
    return played(MOVES, asked(DEAR), seconds=4.0)


def test_the_forces_at_the_grasps_follow_the_shares_while_the_beam_moves(changed):
    assert changed.summary["refused"] == []
    assert changed.summary["mode"] == "enabled"
    told = {round(s.time_s, 3): s.tasks["beam"] for s in changed.states if "beam" in s.tasks}
    pairs = [
        (truth, told[round(truth.time_s, 3)])
        for truth in changed.truths
        if round(truth.time_s, 3) in told
    ]
    assert len(pairs) > 300
    # Half of the difference of both: what speeds the beam up is common to them.
    true = np.array([t.beam.grasps[0][2] - t.beam.grasps[1][2] for t, _ in pairs]) / 2.0
    meant = np.array([s.carried["left"][0] - s.carried["right"][0] for _, s in pairs]) / 2.0
    assert np.abs(true - meant).max() < 0.8  # of 10 N that go over
    forces = np.array([[g[2] for g in t.beam.grasps] for t in changed.truths])
    np.testing.assert_allclose(forces[:60].mean(axis=0), shared([[1.0] * 6] * 2), atol=0.2)
    np.testing.assert_allclose(forces[-60:].mean(axis=0), shared(DEAR), atol=0.2)
    assert np.abs(np.diff(true)).max() < 0.25  # [N] a period
    assert np.abs(np.diff(meant)).max() < 0.25  # 10 N without a ramp


def test_the_load_goes_over_without_strain_and_without_leaving_the_path(changed):
    bound = load_cell("pa10_pair").joint_tasks[0].most_internal
    strains = [s.tasks["beam"].internal_force for s in changed.states if "beam" in s.tasks]
    assert max(strains) < 3.0 < bound
    assert max(t.beam.internal_force for t in changed.truths) < 12.0  # what W means is among it
    plain = played(MOVES, seconds=4.0)
    paths = [np.array([t.beam.pose for t in run.truths]) for run in (changed, plain)]
    off = np.abs(paths[0] - paths[1])
    assert np.linalg.norm(off[:, :3], axis=1).max() < 0.1e-3
    assert off[:, 3:].max() < 0.1e-3
    assert np.ptp(paths[0][:, 2]) > 0.05


def test_the_state_tells_the_weights_in_effect_and_what_each_arm_carries(changed):
    first, last = changed.states[5], changed.states[-1].tasks["beam"]
    assert first.tasks["beam"].shares == {"left": (1.0,) * 6, "right": (1.0,) * 6}
    assert last.shares == {"left": (3.0,) * 6, "right": (1.0,) * 6}
    for name, force in zip(("left", "right"), shared(DEAR), strict=True):
        assert last.carried[name] == pytest.approx((force, force), abs=0.3)
    assert changed.states[-1].shares == {}  # an arm alone has none
    (event,) = changed.events("load_shared")
    assert "3.0" in event.values["left"]


def test_shares_that_an_arm_does_not_bear_are_refused_with_arm_value_and_bound():
    run = played(
        asked([[1000.0] * 6, [1.0] * 6], 0.2),
        asked([[1.0] * 6], 0.3),
        {"at_s": 0.4, "operator/load_shares": {"task": "right", "weights": DEAR}},
        asked(DEAR, 0.5),
        asked([], 0.6),
        seconds=1.0,
    )
    reasons = [event.values["reason"] for event in run.events("request_refused")]
    assert reasons == ["overloaded", "out_of_range", "not_now"]
    first, second, _ = (event.detail for event in run.events("request_refused"))
    # 5 kg at 0.55 m are 27 N·m, and the sensor has 16.38.
    assert "right: axis Tx of its sensor reads 26" in first
    assert "at most 16.38 N·m" in first
    assert "left, right" in second
    assert run.states[-1].tasks["beam"].shares["left"] == pytest.approx((1.0,) * 6, abs=0.02)
