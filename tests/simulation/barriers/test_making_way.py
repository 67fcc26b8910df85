"""An arm that nobody tells to move makes way for what comes, as its cell says, and comes back.

Judged by the physics: the ball is there, and what it hits counts. Its news needs no lease.
"""

import numpy as np
import pytest
from telerobot.config.load import Cell, altered, load_cell
from telerobot.config.schema.surroundings import AvoidanceSection
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages.perception import ObstacleNews
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

TOOL = np.array([0.62, 0.0, 0.42])
"""Middle of the last links in `ready` [m]."""
COMES_S = 2.6


def scene(**avoidance) -> Cell:
    cell = load_cell("pa10_scene")
    told = {**cell.config.avoidance.model_dump(), **avoidance}
    section = AvoidanceSection.model_validate(told)
    return altered(cell, {"avoidance": section})


def visitor(at_s, xyz, velocity):
    told = {"name": "visitor", "xyz": tuple(xyz), "velocity": tuple(velocity)}
    return {"at_s": at_s, "obstacle": {**told, "max_speed": 0.4}}


def comes(way, speed, to=TOOL, until_s=COMES_S + 3.0):
    """Return steps: a ball comes along a way, stops where the arm was, and goes again."""
    way = np.array(way) / np.linalg.norm(way)
    far = to + way * (0.14 + speed * (until_s - COMES_S))
    near = far - way * speed * (until_s - COMES_S)
    return [
        visitor(COMES_S, far, -speed * way),
        visitor(until_s, near, np.zeros(3)),
        visitor(until_s + 0.5, near, speed * way),
    ]


def play(cell, steps, seconds) -> Run:
    steps = [{"at_s": 0.2, "cmd/posture": {"posture": "ready"}}, *steps]
    simulation = Simulation(cell, Script.model_validate({"duration_s": seconds, "step": steps}))
    return Run(simulation, simulation.run())


def places(run, since_s=COMES_S):
    """Return where the tool was since a time of the script (k, 3) [m]."""
    start = run.simulation.player.start_s
    return np.array([x.pose_mrf[:3] for x in run.truths if x.time_s - start > since_s])


def travel(run, since_s=COMES_S):
    found = places(run, since_s)
    return np.linalg.norm(found - found[0], axis=1)


@pytest.mark.parametrize(
    ("way", "speed"), [((0, -1, 0), 0.1), ((1, 0, 0.5), 0.2), ((0.3, 1, 0.6), 0.2)]
)
def test_an_arm_that_stands_makes_way_for_a_ball_and_comes_back(way, speed):
    run = play(load_cell("pa10_scene"), comes(way, speed), COMES_S + 9.0)
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    assert run.summary["min_clearance_m"] > 0.02
    assert travel(run).max() > 0.05
    assert travel(run)[-1] < 1e-3


def test_one_that_is_to_stand_is_hit_by_the_same_ball():
    run = play(scene(standing="stand"), comes((0, -1, 0), 0.1)[:2], COMES_S + 3.2)
    assert run.summary["min_clearance_m"] < 0.0


def test_by_self_motion_alone_the_elbow_makes_way_and_the_tool_stays():
    elbow = comes((0, 1, 0.2), 0.15, to=np.array([0.15, 0.0, 0.75]))
    run = play(scene(standing="self_motion"), elbow, COMES_S + 6.0)
    assert run.summary["mode"] == "enabled"
    assert run.summary["min_clearance_m"] > 0.02
    q = np.array([s.q_command for s in run.states if s.mode == "enabled"])
    assert np.ptp(q[-700:], axis=0).max() > 0.1
    assert travel(run).max() < 0.005


@pytest.mark.parametrize("in_hold", [False, True])
def test_in_hold_it_makes_way_only_if_the_cell_says_so(in_hold):
    hold = {"at_s": COMES_S - 0.4, "operator/mode": {"action": "hold"}}
    steps = [hold, *comes((0, -1, 0), 0.1)]
    run = play(scene(standing_in_hold=in_hold), steps, COMES_S + (7.0 if in_hold else 2.0))
    assert run.summary["mode"] == "hold"
    if in_hold:
        assert run.summary["min_clearance_m"] > 0.02
        assert travel(run).max() > 0.05
        assert travel(run)[-1] < 1e-3
    else:
        assert travel(run).max() < 1e-3


def tell(cell, forge, seconds) -> Run:
    """Play while `forge` makes up news: from the time since it began and the true tool."""
    step = {"at_s": 0.2, "cmd/posture": {"posture": "ready"}}
    simulation = Simulation(cell, Script.model_validate({"duration_s": seconds, "step": [step]}))

    def on_tick(simulation):
        since = simulation.clock.time_s - simulation.player.start_s - COMES_S
        tick = simulation.cycle.tick
        if simulation.player.phase.name == "PLAYING" and since > 0.0 and tick % 5 == 0:
            told = forge(since, simulation.rig.world.mrf_pose()[0])
            news = {"name": "told", "shape": "sphere", "radius": 0.1, "stale": "keep", **told}
            news = {"tick": tick, "max_speed": 0.4, **news}
            simulation.link.put(t.OBSTACLE, encode(ObstacleNews.model_validate(news)))

    simulation.on_tick = on_tick
    return Run(simulation, simulation.run())


def test_noisy_news_of_what_stands_beside_it_moves_nobody():
    rng, beside = np.random.default_rng(1), np.array([0.62, -0.2, 0.45])

    def noisy(since, tool):
        return {"xyz": tuple(beside + rng.normal(0.0, 0.003, 3))}

    def noisy_and_sure(since, tool):
        return {
            **noisy(since, tool),
            "velocity": tuple(rng.normal(0.0, 0.02, 3)),
            "max_acceleration": 2.0,
        }

    for forge in (noisy, noisy_and_sure):
        assert travel(tell(load_cell("pa10_scene"), forge, COMES_S + 2.5)).max() < 2e-3


@pytest.mark.parametrize("reach", [0.1, 0.25])
def test_a_chaser_that_is_made_up_drives_no_arm_further_than_its_reach(reach):
    chaser = np.array([0.62, -0.5, 0.45])

    def chases(since, tool):
        nonlocal chaser
        velocity = 0.3 * (tool - chaser) / np.linalg.norm(tool - chaser)
        chaser = chaser + 0.05 * velocity
        return {"xyz": tuple(chaser), "velocity": tuple(velocity), "max_acceleration": 2.0}

    run = tell(scene(standing_reach=reach), chases, COMES_S + 5.0)
    assert run.summary["mode"] == "enabled"
    assert 0.8 * reach < travel(run).max() < reach
