"""A sample of the campaign's scenes, and that its judge can tell."""

import dataclasses

import numpy as np
import pytest
from laboratory.campaign.scenes import runs
from laboratory.campaign.scenes.clutter import HOSTILE_S, KINDS, make_clutter
from laboratory.campaign.scenes.movers import PROMISE, Chase, Reach, greatest_beside
from laboratory.campaign.scenes.runs import Hit, SceneSummary, play
from telerobot.config.load import altered, load_cell
from telerobot.tools.simulation.simulation import Simulation

EASY = Reach(0.01, 0.5)


@pytest.fixture(scope="module")
def scenes():
    return [play(seed) for seed in (1, 2, 3, 8, 307, 337)]


def test_a_sample_of_scenes_keeps_every_promise(scenes):
    assert {s.kind for s in scenes} == set(KINDS)
    assert [s.reasons for s in scenes] == [[]] * len(scenes)
    assert any(s.limited_ticks > 100 for s in scenes)
    assert SceneSummary(scenes).kept


@pytest.mark.parametrize("seed", [39, 79, 87, 283, 999])
def test_an_arm_gets_out_of_the_way_of_what_is_near_while_another_comes(seed):
    run = play(seed)
    assert run.kind == "moving"
    assert run.reasons == []


@pytest.mark.parametrize("seed", [71, 651, 1275, 1311])
def test_an_arm_leaves_what_it_is_too_near_to_past_others_that_stand(seed):
    run = play(seed)
    assert run.left
    assert run.reasons == []


def test_the_label_is_of_the_scene_alone():
    cell = load_cell("pa10")
    for seed in range(4):
        scene = make_clutter(cell, seed)
        again = make_clutter(cell, seed)
        assert (scene.cell.config, scene.script) == (again.cell.config, again.script)
        assert scene.keepable == (scene.kind in ("free", "near"))
        assert scene.kind == "moving" or (scene.start_m >= PROMISE) == (scene.kind != "inside")
        assert scene.movers == again.movers
        assert bool(scene.movers) == (scene.kind == "moving")


def test_movers_keep_the_bounds_that_are_stated_of_them():
    """Judged by where the physics has them, tick by tick, until they hit something."""
    cell = load_cell("pa10")
    for seed in (3, 7, 11):
        scene = make_clutter(cell, seed)
        simulation = Simulation(scene.cell, scene.script)
        chase = Chase(scene.cell, scene.movers, simulation)
        bodies = {
            m.obstacle.name: simulation.rig.world.model.body(f"obstacle_{m.obstacle.name}").id
            for m in scene.movers
        }
        places = {name: [] for name in bodies}

        def on_tick(s, chase=chase, places=places, bodies=bodies):
            if s.player.phase.name == "PLAYING":
                chase.run(s.clock.time_s - s.player.start_s)
                for name, body in bodies.items():
                    places[name].append(s.rig.world.data.xpos[body].copy())

        simulation.on_tick = on_tick
        simulation.on_physics = lambda _, chase=chase: chase.step()
        simulation.run(lambda places=places: len(next(iter(places.values()))) > 120)
        for m in scene.movers:
            ways = np.diff(np.array(places[m.obstacle.name]), axis=0)
            speeds = np.linalg.norm(ways, axis=1) / 0.01
            assert 0.5 * m.obstacle.max_speed < speeds.max() <= m.obstacle.max_speed
            if m.obstacle.max_acceleration is not None:
                gained = np.linalg.norm(np.diff(ways, axis=0), axis=1) / 0.01**2
                assert gained.max() <= m.obstacle.max_acceleration * (1 + 1e-6)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"least_m": PROMISE - 1e-4}, "promised"),
        ({"left": False}, "did not leave"),
        ({"closed_m": 0.01}, "own motion"),
        ({"limit_violations": 1}, "limit violations"),
        ({"hits": (Hit("mover0", 1.0, 0.15, 0.9, 0.4, EASY),)}, "hit at 1.00 s by mover0"),
        ({"hits": (Hit("mover0", 1.0, 0.15, 0.1, 0.4, EASY),)}, "hit at 1.00 s by mover0"),
        ({"kind": "inside", "held_m": 0.01, "least_m": 0.008}, "deeper inside"),
    ],
)
def test_what_speaks_against_a_run_is_found(scenes, change, word):
    bad = dataclasses.replace(scenes[0], **change)
    assert any(word in reason for reason in bad.reasons)
    assert not SceneSummary([bad]).kept
    assert any(word in line for line in SceneSummary([bad]).lines())


@pytest.mark.parametrize(
    ("hit", "why"),
    [
        (Hit("mover0", 1.0, 0.25, 0.9, 0.4, EASY), "quicker than 0.2 m/s"),
        (Hit("mover0", 1.0, 0.15, 0.9, 0.1, EASY), "towards no other mover, at 0.10 m/s"),
        (Hit("mover0", 1.0, 0.15, 0.0, 0.4, EASY), "nobody tells of it"),
        (Hit("mover0", 1.0, 0.15, 0.1, 0.4, Reach(0.009, 0.004)), "4.0 mm at most, of 9.0 mm"),
        (Hit("mover0", 1.0, 0.15, 0.9, 0.4, EASY, held=True), "in HOLD"),
    ],
    ids=["fast", "at the root", "silent", "late", "held"],
)
def test_a_hit_that_no_arm_can_avoid_is_counted_and_told_with_its_reason(scenes, hit, why):
    run = dataclasses.replace(scenes[0], hits=(hit,))
    summary = SceneSummary([run])
    assert run.name.endswith(", hit")
    assert summary.kept
    assert (summary.figures()["hits"], summary.figures()["hits_avoidable"]) == (1, 0)
    assert any("hit at 1.00 s by mover0" in line and why in line for line in summary.lines())


@pytest.mark.parametrize(
    ("row", "beside", "greatest"),
    [
        ([1.0, 1.0], [], 3.0),
        ([1.0, 0.0], [[-1.0, 0.0]], 0.0),
        ([1.0, 1.0], [[-1.0, 0.0]], 2.0),
        ([1.0, 1.0], [[-1.0, 0.0], [0.0, -1.0]], 0.0),
        ([1.0, 0.0], [[-1.0, 0.5]], 1.0),
        ([1.0, 0.0], [[-4.0, 1.0]], 0.5),
        ([1.0, 0.0], [[1.0, 0.0]], 1.0),
    ],
)
def test_a_retreat_beside_others_is_the_vertex_that_a_drawing_shows(row, beside, greatest):
    found = greatest_beside(np.array(row), np.array(beside).reshape(-1, 2), np.array([1.0, 2.0]))
    assert found == pytest.approx(greatest, abs=1e-12)


def test_no_retreat_beside_others_is_quicker_than_what_is_found():
    """A judge may excuse too little by it, but never too much."""
    rng = np.random.default_rng(8)
    for _ in range(30):
        row, beside = rng.normal(size=3), rng.normal(size=(int(rng.integers(1, 4)), 3))
        most = rng.uniform(0.5, 2.0, 3)
        tried = rng.uniform(-most, most, (20_000, 3))
        tried = np.vstack([tried, np.sign(tried) * most])
        kept = tried[(tried @ beside.T >= 0.0).all(axis=1)]
        quickest = (kept @ row).max(initial=0.0)
        assert quickest <= greatest_beside(row, beside, most) + 1e-12
        assert greatest_beside(row, beside, most) <= np.abs(row) @ most + 1e-12


def test_an_arm_between_two_movers_is_asked_to_leave_neither_for_the_other():
    """Seed 651: one that is quick is at its forearm, another comes to its elbow from behind."""
    run = play(651)
    hit = run.hits[-1]
    assert [h.mover for h in run.hits] == ["mover0", "mover2"]
    assert hit.speed < 0.2
    assert hit.escape < 0.05 < 0.2 < run.hits[0].escape


def test_movers_do_not_go_into_the_arm(scenes):
    """One meets a link that turns about its own axis there: no joint leads it away."""
    (run,) = (scene for scene in scenes if scene.seed == 3)
    assert min(hit.escape for hit in run.hits) < 1e-6
    assert run.least_m > -0.001


def test_a_mover_that_comes_to_the_arm_has_hit_it(monkeypatch):
    """An arm that keeps clear of nothing is hit: by what, when, and whether that was told of."""
    scene = make_clutter(load_cell("pa10"), 23)
    cell = altered(scene.cell, {"avoidance.enabled": False})
    monkeypatch.setattr(runs, "make_clutter", lambda *_: dataclasses.replace(scene, cell=cell))
    run = play(23)
    (hit,) = run.hits
    assert hit.mover == "mover0"
    assert hit.told_s > 0.05
    assert 0.1 < hit.at_s < HOSTILE_S
    assert hit.speed == scene.movers[0].obstacle.max_speed
    assert run.least_m > -0.001


def test_an_arm_that_is_closed_in_need_not_leave_but_is_told(scenes):
    closed = dataclasses.replace(scenes[0], left=False, closed=True)
    assert closed.reasons == []
    found = SceneSummary([*scenes, closed])
    assert found.kept
    assert (found.figures()["did_not_leave"], found.figures()["closed_in"]) == (0, 1)
    assert any(f"{closed.seed}:" in line and "closed in" in line for line in found.lines())


@pytest.mark.parametrize(("standing", "avoidable"), [("stand", False), ("step_aside", True)])
def test_an_arm_is_not_asked_to_leave_before_it_may(monkeypatch, standing, avoidable):
    """A ball 13 mm off sets out 50 ms before the stick: from then on no joint is quick enough.

    One that steps aside where it stands has had the time, and here does not even try.
    """
    scene = make_clutter(load_cell("pa10"), 1311)
    cell = altered(scene.cell, {"avoidance.standing": standing, "avoidance.enabled": False})
    monkeypatch.setattr(runs, "make_clutter", lambda *_: dataclasses.replace(scene, cell=cell))
    hit = next(hit for hit in play(1311).hits if hit.mover == "mover1")
    assert hit.at_s - hit.told_s == pytest.approx(0.0 if avoidable else 0.04)
    assert (hit.reach.away_m > hit.reach.deep_m) is avoidable
    assert (hit.why_not == "") is avoidable
