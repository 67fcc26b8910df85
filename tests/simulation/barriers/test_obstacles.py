"""Obstacles in whole runs: clearances by the physics, news that fails, and what operators see."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.protocols import topics as t
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run


@pytest.fixture(scope="module")
def cluttered():
    return load_cell("pa10_scene")


def play(cell, script) -> Run:
    script = script if isinstance(script, Script) else load_script(script)
    simulation = Simulation(cell, script)
    return Run(simulation, simulation.run())


def names(run: Run) -> list[str]:
    return [event.name for event in run.simulation.events]


@pytest.mark.parametrize("name", ["obstacle_drive_into", "obstacle_comes", "obstacle_teleport"])
def test_every_shipped_script_keeps_the_promise(cluttered, name):
    run = play(cluttered, name)
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    assert run.summary["min_clearance_m"] > cluttered.config.avoidance.clearance
    assert [e for e in run.simulation.events if e.severity == "error"] == []
    stopped = sum("verified_stop" in s.limits for s in run.states)
    assert stopped < 0.01 * len(run.states)


def test_switched_off_the_same_stick_drives_into_the_table(cluttered):
    script = load_script("obstacle_drive_into")
    off = type(script.step[0]).model_validate({"at_s": 0.1, "operator/avoidance": {"on": False}})
    run = play(cluttered, script.model_copy(update={"step": (off, *script.step)}))
    assert run.summary["min_clearance_m"] < 0.001
    assert not run.states[-1].avoiding
    assert run.states[-1].gaps == ()


def test_operators_see_the_nearest_pairs_and_which_barriers_act(cluttered):
    run = play(cluttered, "obstacle_drive_into")
    state = run.at(5.5)
    assert state.avoiding
    link, other, gap, active = state.gaps[0]
    assert active
    assert f"clearance:{link}:{other}" in state.limits
    assert gap == pytest.approx(0.025, abs=0.002)


def test_an_obstacle_that_appears_on_the_arm_falls_silent_and_is_taken_back(cluttered):
    run = play(cluttered, "obstacle_teleport")
    every = names(run)
    order = [n for n in every[every.index("obstacle_set") :] if n in TOLD]
    for name in TOLD:
        assert name in order
    assert order.index("obstacle_stale") < order.index("stopping")
    # After it was removed, the arm goes on.
    assert run.at(5.5).mode == "enabled"
    assert run.states[-1].pose_mrf[1] < run.at(4.3).pose_mrf[1] - 0.1


TOLD = ("obstacle_set", "stop_worsened", "obstacle_stale", "stopping", "obstacle_removed")


def test_while_news_is_stale_that_calls_for_a_stop_the_arm_cannot_be_resumed(cluttered):
    steps = [
        {"at_s": 0.3, "sensor/obstacle": {**GHOST, "xyz": (1.5, 0.0, 0.5)}},
        {"at_s": 1.5, "operator/mode": {"action": "resume"}},
    ]
    run = play(cluttered, Script.model_validate({"duration_s": 2.0, "step": steps}))
    assert run.summary["mode"] == "hold"
    assert len(run.summary["refused"]) == 1
    assert "the news of obstacle ghost is stale" in run.summary["refused"][0]


def test_news_that_jumps_is_told_and_malformed_news_changes_nothing(cluttered):
    steps = [
        {"at_s": 0.3, "sensor/obstacle": {**GHOST, "xyz": (1.5, 0.0, 0.5), "stale": "keep"}},
        {"at_s": 0.5, "raw": {"topic": t.OBSTACLE.key, "hex": "82a17601"}},
        {"at_s": 0.6, "sensor/obstacle": {"name": "nobody", "xyz": (1.0, 0.0, 0.5)}},
        {"at_s": 0.7, "sensor/obstacle": {"name": "table", "xyz": (3.0, 0.0, 0.5)}},
        {"at_s": 0.8, "sensor/obstacle": {"name": "ghost", "xyz": (1.5, 0.5, 0.5)}},
    ]
    run = play(cluttered, Script.model_validate({"duration_s": 1.2, "step": steps}))
    reasons = [e.values.get("reason") for e in run.simulation.events if e.name == "command_refused"]
    assert reasons == ["not_messagepack", "unknown_obstacle", "fixed_obstacle"]
    assert "obstacle_jumped" in names(run)
    assert run.summary["mode"] == "enabled"


GHOST = {
    "name": "ghost", "shape": "sphere", "radius": 0.1, "max_speed": 0.1, "timeout_s": 0.3,
}  # fmt: skip


def test_the_physics_has_every_solid_obstacle_where_the_cell_says(cluttered):
    world = Simulation(cluttered, load_script("obstacle_comes")).rig.world
    for obstacle in cluttered.config.obstacles:
        if obstacle.shape != "sight_line":
            body = world.model.body(f"obstacle_{obstacle.name}")
            assert world.data.xpos[body.id] == pytest.approx(np.array(obstacle.xyz))
    before = world.distances.nearest()
    world.place("visitor", world.mrf_pose()[0] + np.array([0.0, 0.0, 0.2]))
    after = world.distances.nearest()
    assert after.other == "obstacle_visitor"
    assert after.distance < before.distance
    assert after.distance == pytest.approx(0.2 - 0.12 - 0.012, abs=0.03)


def test_a_cell_that_says_nothing_of_avoidance_cannot_switch_it_on(pa10):
    step = {"at_s": 0.1, "operator/avoidance": {"on": True}}
    run = play(pa10, Script.model_validate({"duration_s": 0.3, "step": [step]}))
    assert "says nothing of avoidance" in run.summary["refused"][0]


def test_equal_runs_among_obstacles_send_equal_frames(cluttered):
    script = load_script("obstacle_comes").model_copy(update={"duration_s": 5.0})
    first, second = (play(cluttered, script).summary["command_hash"] for _ in range(2))
    assert first == second


def moving(name):
    return {"name": name, "velocity": (0.0, -0.1, 0.0), "max_speed": 0.2}


@pytest.mark.parametrize("place", [None, (3.0, 3.0, 0.5)])
def test_a_script_removes_an_obstacle_that_moves(cluttered, place):
    """It is gone for the daemon, and stands still where it was, or where the script puts it."""
    steps = [
        {"at_s": 0.2, "obstacle": {**moving("visitor"), "xyz": (1.5, 0.5, 0.5)}},
        {"at_s": 0.6, "obstacle": {"name": "visitor", "remove": True}},
    ]
    if place is not None:
        put = {"kind": "place", "target": "visitor", "vector": place}
        steps.append({"at_s": 0.7, "rig/fault": put})
    run = play(cluttered, Script.model_validate({"duration_s": 1.2, "step": steps}))
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert names(run).count("obstacle_removed") == 1
    removed = next(e for e in run.simulation.events if e.name == "obstacle_removed")
    later = [e for e in run.simulation.events if e.tick > removed.tick]
    assert [e for e in later if e.name in ("command_refused", "obstacle_set")] == []
    world = run.simulation.rig.world
    stands = world.data.mocap_pos[world.model.body("obstacle_visitor").mocapid[0]]
    assert stands == pytest.approx(place or (1.5, 0.46, 0.5), abs=0.002)
