"""A jog or a posture that leads the tool into something: it stops, gives way, and never faults."""

import numpy as np
import pytest
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

TOUCHES_N = 1.0
READY = {"at_s": 0.2, "cmd/posture": {"posture": "ready"}}
OVER_THE_TABLE = {"at_s": 0.2, "cmd/posture": {"q": [0.0, 0.46, 0.0, 2.1, 0.0, -0.7792, 0.0]}}
ABOVE_THE_TABLE = {"at_s": 0.1, "cmd/posture": {"q": [0.0, 0.515, 0.0, 2.1, 0.0, -0.7792, 0.0]}}
INTO_THE_TABLE = {"cmd/posture": {"q": [0.0, 1.0, 0.0, 2.0221, 0.0, -0.7585, 0.0]}}
FORCE_OFF = {"at_s": 0.2, "operator/switch": {"source": "force", "on": False}}


def jog(at_s, s2, **more):
    return {"at_s": at_s, "cmd/jog": {"rates": [0.0, s2, 0.0, 0.0, 0.0, 0.0, 0.0]}, **more}


@pytest.fixture
def press(pa10):
    """Run steps; return the run, and the physics' contact force from the touch on, each step."""

    def run(*steps, seconds, cell=pa10):
        script = Script.model_validate({"duration_s": seconds, "step": list(steps)})
        simulation, forces = Simulation(cell, script), []
        world = simulation.rig.world
        simulation.on_physics = lambda _: forces.append(world.contacts.total(0))
        ran, pressed = Run(simulation, simulation.run()), np.array(forces)
        touched = pressed > TOUCHES_N
        return ran, pressed[np.argmax(touched) :] if touched.any() else pressed[:0]

    return run


@pytest.mark.parametrize(
    ("steps", "most_n"),
    [
        ((ABOVE_THE_TABLE, jog(0.9, 0.01)), 456.0),
        ((ABOVE_THE_TABLE, jog(1.0, 0.01)), 456.0),
        ((OVER_THE_TABLE, jog(1.5, 0.1)), 456.0),
        ((OVER_THE_TABLE, jog(1.5, 0.3)), 508.0),
        ((OVER_THE_TABLE, FORCE_OFF, jog(1.5, 0.3)), 800.0),
        ((READY, {"at_s": 1.8, **INTO_THE_TABLE}), 2082.0),
    ],
    ids=[
        "slow jog",
        "slow jog a little lower",
        "jog",
        "fast jog",
        "fast jog, force control off",
        "posture at full speed",
    ],
)
def test_a_tool_that_joints_lead_into_a_table_stops_and_lets_go_of_it(press, steps, most_n):
    """With force control, half of 913, 1016 and 4164 N at most, in any physics step."""
    run, force = press(*steps, seconds=4.4)
    assert len(force) > 1200
    assert force.max() < most_n
    assert run.events("fault") == []
    assert len(run.events("touched")) == 1
    assert run.states[-1].mode == "hold"
    assert force[1100:].max() < 30.0
    assert run.summary["limit_violations"] == 0


def test_a_slow_jog_presses_with_half_of_what_it_did(press):
    """864 N without accommodation, which goes on beside the joints' rates."""
    run, force = press(OVER_THE_TABLE, jog(1.5, 0.1), seconds=3.4)
    assert 100.0 < force.max() < 430.0
    (gave,) = run.events("gave_way")
    assert gave.values["force_n"] < 10.0


def test_the_tool_of_a_jog_or_a_posture_is_no_quicker_than_the_cell_says(press, pa10):
    limits = pa10.config.limits
    away = {"at_s": 1.8, "cmd/posture": {"q": [1.6, 0.3072, 0.0, 2.0221, 0.0, -0.7585, 0.0]}}
    for steps, bound in (
        ((READY, {"at_s": 1.8, "cmd/jog": {"rates": [-0.9, 0, 0, 0, 0, 0, 0]}}), limits.jog_speed),
        ((READY, away), limits.posture_speed),
    ):
        run, _ = press(*steps, seconds=3.4)
        at = np.array([run.at(t).pose_mrf[:3] for t in (2.6, 3.0)])
        assert np.linalg.norm(at[1] - at[0]) / 0.4 == pytest.approx(bound, rel=0.03)
        assert "tool_speed" in run.at(2.8).limits


def test_after_it_gave_way_it_may_be_resumed_and_jogged_out(press):
    run, _ = press(
        OVER_THE_TABLE,
        jog(1.5, 0.1, for_s=1.0),
        {"at_s": 3.6, "operator/mode": {"action": "resume"}},
        jog(3.8, -0.1),
        seconds=4.6,
    )
    assert len(run.events("touched")) == 1
    assert run.states[-1].mode == "enabled"
    assert run.states[-1].pose_mrf[2] > run.at(3.7).pose_mrf[2] + 0.03


def test_a_jog_out_of_contact_is_no_collision(press):
    """A stick presses the wall with 40 N; the jog leads away from it."""
    push = {"twist": [0.03, 0, 0, 0, 0, 0], "expressed_in": "base"}
    run, force = press(
        READY,
        {"at_s": 1.8, "cmd/joystick": push, "for_s": 5.0},
        {"at_s": 6.8, "cmd/jog": {"rates": [0.0, -0.05, 0.0, 0.0, 0.0, 0.0, 0.0]}},
        seconds=8.0,
    )
    assert force.max() > 35.0
    assert force[-1] == 0.0
    assert run.events("touched") == []
    assert run.states[-1].mode == "enabled"
