"""News that anybody may send: what forged news can do to an arm, judged by the physics.

The virtual world stands still; what is told of it is made up. Nobody touches the stick.
"""

import numpy as np
import pytest
from laboratory.campaign.fuzz.blind import Blind
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.surroundings import AvoidanceSection
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages.perception import FrameNews, ObstacleNews, Sighting
from telerobot.tools.checks.cell import sensors
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

T = 0.01
SILENT = [
    {"at_s": 0.0, "rig/fault": {"kind": "silence", "target": "base"}},
    {"at_s": 0.0, "rig/fault": {"kind": "silence", "target": "carrier"}},
]


def play(name, forge, seconds=2.0, steps=(), listener=lambda topic, message: None):
    """Play a script while `forge` makes up news, from the script's time and the tick."""
    script = Script.model_validate({"duration_s": seconds, "step": list(steps)})
    cell = load_cell(name) if isinstance(name, str) else name
    simulation = Simulation(cell, script, cameras=Blind)

    def tell(simulation):
        since = simulation.clock.time_s - simulation.player.start_s
        if simulation.player.phase.name == "PLAYING" and since > 0.3:
            for topic, news in forge(since - 0.3, simulation.cycle.tick, simulation):
                simulation.link.put(topic, encode(news))

    simulation.on_tick = tell
    simulation.link.listen(listener)
    return Run(simulation, simulation.run())


def tool(run):
    """Return where the tool was since forging began (k, 3) [m]."""
    since = run.simulation.player.start_s + 0.3
    return np.array([truth.pose_mrf[:3] for truth in run.truths if truth.time_s > since])


def travel(run):
    return np.linalg.norm(tool(run) - tool(run)[0], axis=1).max()


def base(since, tick, xyz=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0), **more):
    return t.FRAME_NEWS, FrameNews(name="base", tick=tick, xyz=xyz, rpy=rpy, **more)


def drives_away(since, tick, _simulation):
    yield base(since, tick, (0.0, 0.28 * since, 0.0), (0.0, 0.0, 0.28 * since))


def jerks(since, tick, _simulation):
    to_and_fro = 0.25 if int(since / 0.08) % 2 else -0.25
    yield base(since, tick, twist=(0.0, to_and_fro, 0.0, 0.0, 0.0, to_and_fro))


def steps(since, tick, _simulation):
    yield base(since, tick, (0.0, 0.019 if int(since / 0.1) % 2 else 0.0, 0.0))


def leans(since, tick, _simulation):
    yield base(since, tick, rpy=(0.28 * since, 0.0, 0.0))


@pytest.mark.parametrize("forge", [drives_away, jerks, steps, leans])
def test_forged_news_of_base_moves_an_idle_tool_no_faster_than_the_cell_says(forge):
    run = play("pa10_platform", forge, steps=SILENT)
    frame = run.simulation.cell.config.frames.base
    told = {f.check: f.values for f in sensors(run.simulation.cell)}["news of base"]
    speeds = np.linalg.norm(np.diff(tool(run), axis=0), axis=1) / T
    assert speeds.max() < 1.05 * told["tool_speed"]
    believed = np.array([s.frames["base"][:3] for s in run.states if s.mode == "enabled"])[2:]
    assert np.linalg.norm(believed, axis=1).max() > 1e-3 or forge is leans
    rates = np.diff(believed, axis=0) / T
    assert np.linalg.norm(rates, axis=1).max() < 1.001 * frame.speed
    # Poses differ by the mean of two twists, or by the later one: that is half of it more.
    changes = np.diff(rates, axis=0) / T
    assert np.linalg.norm(changes, axis=1).max() < 1.5 * frame.acceleration
    assert run.summary["limit_violations"] == 0


def rises(since, tick, _simulation):
    yield base(since, tick, (0.0, 0.0, min(0.25 * since, 0.45)))


def jumps(since, tick, _simulation):
    dice = np.random.default_rng(tick)
    yield base(
        since, tick, dice.uniform(-0.6, 0.6, 3).tolist(), dice.uniform(-0.4, 0.4, 3).tolist()
    )
    yield base(since, tick, dice.normal(0.0, 0.02, 3).tolist())


@pytest.mark.parametrize("forge", [rises, jumps])
def test_news_that_contradicts_the_frames_own_sensor_stops_the_arm_before_it_moves_it(forge):
    """It would have folded the arm onto itself, with 4 kN; the sensor told the truth all along."""
    run = play("pa10_platform", forge, 2.5)
    (disputed,) = run.events("frame_disputed")
    assert disputed.values["frame"] == "base"
    assert [e.values["reason"] for e in run.events("stopping")] == ["news of base disputed"]
    assert run.summary["mode"] == "hold"
    assert run.summary["limit_violations"] == 0
    assert travel(run) < 0.05
    assert max(truth.own_contact_peak for truth in run.truths) == 0.0


def test_base_is_not_believed_to_be_further_away_than_the_cell_says():
    run = play("pa10_platform", drives_away, 2.6, SILENT)
    frame = run.simulation.cell.config.frames.base
    (rejected,) = run.events("frame_rejected")
    assert rejected.values["reason"] == "extent"
    assert rejected.values["bound"] in frame.extent
    assert rejected.values["value"] >= rejected.values["bound"]
    # What it still moves on by: until its news is stale, and until it is at rest.
    beyond = frame.speed * frame.timeout_s + frame.speed**2 / (2 * 0.5 * frame.acceleration)
    far = np.linalg.norm([s.frames["base"][:3] for s in run.states], axis=1)
    assert far.max() < frame.extent[0] + beyond
    still = [s.frames["base"] for s in run.states[-20:]]
    assert np.ptp(still, axis=0).max() < 2e-4


def test_what_was_not_believed_is_told_with_reason_value_and_bound():
    def quick(since, tick, _simulation):
        yield base(since, tick, twist=(0.0, 0.4, 0.0, 0.0, 0.0, 0.0))

    def bent(since, tick, _simulation):
        yield base(since, tick, (0.0, 0.0 if since < 0.5 else 0.022, 0.0))

    (rejected,) = play("pa10_platform", quick, 0.5, SILENT).events("frame_rejected")
    assert rejected.values == {"frame": "base", "reason": "speed", "value": 0.4, "bound": 0.3}
    assert "0.4 m/s, bound 0.3 m/s" in rejected.detail
    rejected = play("pa10_platform", bent, 0.9, SILENT).events("frame_rejected")[-1]
    assert rejected.values["reason"] == "acceleration"
    assert rejected.values["value"] == pytest.approx(0.022, abs=1e-3)
    assert rejected.values["bound"] == pytest.approx(0.02, abs=1e-3)


def test_with_the_crf_on_base_or_in_hold_no_news_of_base_moves_an_idle_arm():
    def sways(since, tick, _simulation):
        yield base(since, tick, (0.05 * np.sin(3.0 * since), 0.0, 0.0))

    on_base = {"at_s": 0.1, "operator/frame": {"frame": "crf", "moves_with": "base"}}
    hold = {"at_s": 0.1, "operator/mode": {"action": "hold"}}
    for step in (on_base, hold):
        run = play("pa10_platform", sways, 1.5, [step, *SILENT])
        assert travel(run) < 2e-3  # the sensor's noise does as much
        assert run.states[-1].frame_age_ticks["base"] is not None


def comes(since, tick, _simulation):
    """A ball comes at the upper arm, and stays inside it."""
    if tick % 5 and since > T:
        return
    shape = {"shape": "sphere", "radius": 0.08, "max_speed": 0.6, "stale": "keep"}
    y = max(0.0, 0.3 - 0.5 * since)
    more = {} if since > T else {**shape, "max_acceleration": 5.0}
    velocity = (0.0, -0.5 if y else 0.0, 0.0)
    xyz = (0.15, y, 0.75)
    yield t.OBSTACLE, ObstacleNews(name="forged", tick=tick, xyz=xyz, velocity=velocity, **more)


def test_forged_obstacles_push_the_elbow_of_an_idle_arm_no_faster_than_its_self_motion():
    """Of one that was moved since it was enabled: before, no self-motion leads it away."""
    tap = {"at_s": 0.0, "for_s": 0.1, "cmd/joystick": {"twist": [0.002, 0, 0, 0, 0, 0]}}
    run = play("pa10_hand_pole", comes, steps=[tap])
    config = run.simulation.cell.config
    bound = config.redundancy.max_rate * np.array([d.max_velocity for d in config.mechanism.drives])
    rates = np.abs([s.dq_command for s in run.states])
    assert rates.max() > 0.05
    assert (rates <= 1.05 * bound).all()
    assert travel(run) < 3e-3


@pytest.mark.parametrize("name", ["pa10_scene", "pa10_vision"])
def test_forged_obstacles_do_not_move_an_arm_that_is_to_stand(name):
    """It does not close in, and that is all."""
    cell = load_cell(name)
    avoidance = AvoidanceSection(**{**cell.config.avoidance.model_dump(), "standing": "stand"})
    run = play(altered(cell, {"avoidance": avoidance}), comes)
    assert run.summary["mode"] == "enabled"
    if name == "pa10_scene":
        inside = [gap for s in run.states[-50:] for gap in s.gaps if gap[1] == "forged"]
        assert min(gap[2] for gap in inside) < 0.0
    assert travel(run) < 3e-3
    assert np.abs(run.speeds(0.3, 2.0)).max() < 0.05


def test_forged_obstacles_move_an_arm_that_steps_aside_no_further_than_its_reach():
    run = play("pa10_scene", comes)
    assert run.summary["mode"] == "enabled"
    assert 0.05 < travel(run) < run.simulation.cell.config.avoidance.standing_reach


def test_forged_pictures_move_nothing_until_the_source_is_on_and_then_at_its_own_speed():
    def sees(since, tick, simulation):
        if tick % 5 == 0:
            name, x = simulation.cell.config.cameras[0].name, 0.15 * (since > 1.0)
            pose = (x, 0.0, 0.4, 3.14159, 0.0, 0.0)
            yield (
                t.SIGHTING,
                Sighting(camera=name, tick=tick - 1, poses=(pose,), errors_px=(0.1,), quality=1.0),
            )

    idle = play("pa10_vision", sees, 1.8)
    assert idle.events("view_found")
    assert travel(idle) < 3e-3
    on = [{"at_s": 0.8, "operator/store_view": {"camera": "wrist"}},
          {"at_s": 0.9, "operator/switch": {"source": "vision", "on": True}}]  # fmt: skip
    run = play("pa10_vision", sees, 2.6, on)
    assert run.summary["refused"] == []
    assert travel(run) > 0.02
    vision = run.simulation.cell.config.sources.vision
    rates = np.array([s.sources["vision"] for s in run.states])
    assert np.linalg.norm(rates[:, :3], axis=1).max() < 1.5 * vision.speed


PLACE = (0.7, -0.3, 0.45)
WATCHED = [
    {"at_s": 0.2, "cmd/posture": {"posture": "ready"}},
    {"at_s": 0.2, "obstacle": {"name": "visitor", "shape": "sphere", "radius": 0.12, "xyz": PLACE,
                               "max_speed": 0.3, "velocity": (0.0, 1e-6, 0.0), "stale": "keep"}},
    {"at_s": 2.5, "for_s": 3.5, "cmd/joystick": {"twist": [0, -0.1, 0, 0, 0, 0],
                                                 "expressed_in": "base"}},
]  # fmt: skip


@pytest.mark.parametrize("claim", [{"remove": True}, {"shape": "point", "xyz": (5.0, 5.0, 5.0)}])
def test_nobody_takes_anothers_obstacle_out_of_the_arms_way(claim):
    """The stick leads the tool at an obstacle that another sender says is gone."""

    def steals(since, tick, _simulation):
        if since > 1.5 and tick % 20 == 0:
            news = ObstacleNews(name="visitor", tick=tick, **claim)
            yield t.OBSTACLE.by("thief"), news
            yield t.OBSTACLE, news

    told = []
    run = play("pa10_scene", steals, 6.0, WATCHED, lambda topic, message: told.append(message))
    shown = [message for message in told if isinstance(message, ObstacleNews)]
    assert {news.name for news in shown} == {"visitor"}
    assert len(shown) > 100  # by the script, and in turn
    assert not any(news.remove or np.linalg.norm(news.xyz) > 1.0 for news in shown)
    assert run.summary["min_clearance_m"] > run.simulation.cell.config.avoidance.clearance
    refused = {e.detail for e in run.events("command_refused")}
    assert "sensor/obstacle: script tells of visitor, not thief" in refused
    assert "too: keep" in run.events("obstacle_stale")[-1].detail
