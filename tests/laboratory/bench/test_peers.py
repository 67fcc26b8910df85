"""The benchmark against other libraries: its scenes, its labels and its judge, without them."""

import json
import sys

import numpy as np
import pytest
from laboratory.bench.peers import cli
from laboratory.bench.peers.controllers.with_telerobot import Telerobot
from laboratory.bench.peers.generator import COPIES, generate
from laboratory.bench.peers.geometry import PeerGeometry
from laboratory.bench.peers.labels import labelled
from laboratory.bench.peers.reference import Reference
from laboratory.bench.peers.report import COLUMNS, as_json, rows
from laboratory.bench.peers.run import PeerResult, run
from laboratory.bench.peers.scenes import PeerScene, Target, Thing, read, write
from telerobot.config.load import load_cell
from telerobot.server.control.spatial import Pose, pose_error

UPRIGHT_TOP = 0.315 + 0.450 + 0.500 + 0.080 + 0.110
"""Height of the hand's upper end when the PA-10 stands upright [m]."""


@pytest.fixture(scope="module")
def cell():
    return load_cell("pa10")


@pytest.fixture(scope="module")
def ready(cell):
    return np.array(cell.config.mechanism.postures["ready"])


def ball(xyz, radius=0.05, **more):
    return Thing(name="ball", shape="sphere", xyz=xyz, radius=radius, **more)


def scene_of(cell, start, targets, things=()):
    geometry = PeerGeometry(cell, ())
    poses = [geometry.tool(q).to_xyz_rpy() for q in targets]
    return PeerScene(
        seed=1,
        cell="pa10",
        start=tuple(start.tolist()),
        things=tuple(things),
        targets=tuple(Target(xyz=T[:3], rpy=T[3:]) for T in poses),
    )


# --- scenes ----------------------------------------------------------------------------------


def test_equal_seeds_give_equal_scenes_and_others_do_not(cell):
    assert generate(cell, 3) == generate(cell, 3)
    assert generate(cell, 3).things != generate(cell, 4).things


def test_scenes_survive_being_written(cell, tmp_path):
    scenes = (generate(cell, 5),)
    write(scenes, tmp_path / "scenes.json")
    assert read(tmp_path / "scenes.json") == scenes


def test_an_arm_starts_clear_wherever_things_swing_to(cell):
    for seed in range(6):
        scene = generate(cell, seed)
        geometry = PeerGeometry(cell, scene.things)
        for time_s in np.linspace(0.0, 20.0, 41):
            geometry.move(float(time_s))
            assert geometry.clearance(np.array(scene.start)).things > 0.02


def test_a_thing_keeps_its_stated_bounds():
    thing = ball((0.5, 0.0, 0.5), swing=(0.1, 0.05, 0.0), frequency=0.8, phase=0.3)
    times = np.linspace(0.0, 10.0, 2001)
    places = np.array([thing.at(float(t)).centre for t in times])
    speeds = np.linalg.norm(np.gradient(places, times, axis=0), axis=1)
    told = np.array([thing.at(float(t)).velocity for t in times])
    assert speeds.max() <= thing.max_speed * (1.0 + 1e-6)
    assert np.abs(np.gradient(places, times, axis=0) - told)[1:-1].max() < 1e-5
    rates = np.linalg.norm(np.gradient(told, times, axis=0), axis=1)
    assert rates.max() <= thing.max_acceleration * (1.0 + 1e-6)


def test_copies_of_a_swing_are_never_far_from_the_thing():
    thing = ball((0.5, 0.0, 0.5), swing=(0.12, 0.0, 0.09), frequency=0.8)
    copies = np.array([copy.xyz for copy in thing.swept(COPIES)])
    for time_s in np.linspace(0.0, 8.0, 200):
        away = np.linalg.norm(copies - thing.at(float(time_s)).centre, axis=1)
        assert away.min() <= 0.15 / (COPIES - 1) + 1e-9


# --- labels ----------------------------------------------------------------------------------


def test_a_target_in_the_open_is_feasible(cell, ready):
    scene = labelled(cell, scene_of(cell, ready, [ready + 0.2]), COPIES)
    assert scene.feasible


def test_a_target_inside_a_thing_is_not_feasible_nor_what_comes_after_it(cell, ready):
    inside = PeerGeometry(cell, ()).tool(ready + 0.3).p
    things = [ball(tuple(inside.tolist()), radius=0.08)]
    scene = labelled(cell, scene_of(cell, ready, [ready + 0.3, ready], things), COPIES)
    assert [target.feasible for target in scene.targets] == [False, False]
    assert scene.targets[0].why == "no clear posture found"


def test_a_target_that_a_thing_swings_through_is_not_feasible(cell, ready):
    x, y, z = PeerGeometry(cell, ()).tool(ready + 0.3).p.tolist()
    aside = ball((x, y, z + 0.3), swing=(0.0, 0.0, 0.3), frequency=0.3)
    assert not labelled(cell, scene_of(cell, ready, [ready + 0.3], [aside]), COPIES).feasible


def test_a_target_is_not_feasible_when_the_way_to_it_is_shut(cell):
    """A turn of the base by half a turn, with a board on either side that no posture passes."""
    start = np.array([0.0, 0.9, 0.0, 0.9, 0.0, 0.9, 0.0])
    boards = [
        Thing(name=name, shape="box", xyz=(0.0, y, 0.9), half_size=(2.0, 0.05, 0.9))
        for name, y in (("left", 0.3), ("right", -0.3))
    ]
    lid = Thing(name="lid", shape="box", xyz=(0.0, 0.0, 1.0), half_size=(2.0, 0.3, 0.05))
    back = start + np.array([np.pi - 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    scene = labelled(cell, scene_of(cell, start, [back], [*boards, lid]), COPIES)
    assert not scene.feasible


# --- the judge -------------------------------------------------------------------------------


def test_clearance_is_the_distance_of_the_real_shapes(cell):
    above = PeerGeometry(cell, (ball((0.0, 0.0, UPRIGHT_TOP + 0.15)),))
    assert above.clearance(np.zeros(7)).things == pytest.approx(0.10, abs=1e-6)
    inside = PeerGeometry(cell, (ball((0.0, 0.0, UPRIGHT_TOP + 0.03)),))
    assert inside.clearance(np.zeros(7)).things == pytest.approx(-0.02, abs=1e-6)


def test_the_judges_jacobian_is_the_slope_of_its_pose(cell, ready):
    geometry, h = PeerGeometry(cell, ()), 1e-6
    J = geometry.jacobian(ready)
    for i, aside in enumerate(h * np.eye(7)):
        slope = pose_error(geometry.tool(ready + aside), geometry.tool(ready - aside)) / (2 * h)
        assert np.abs(J[:, i] - slope).max() < 1e-8


def test_the_reference_keeps_its_speed_and_ends_at_the_target():
    start, target = Pose.identity(), Pose.from_xyz_rpy((0.3, 0.1, 0.0), (0.2, -0.4, 0.5))
    reference = Reference.between(start, target, 0.15, 0.5)
    times = np.linspace(0.0, reference.duration_s, 4001)
    places = np.array([reference.at(float(t)).p for t in times])
    speed = np.linalg.norm(np.gradient(places, times, axis=0), axis=1).max()
    assert speed <= 0.15 * (1.0 + 1e-6)
    assert np.abs(pose_error(target, reference.at(reference.duration_s))).max() < 1e-9
    assert reference.off_path(np.array([0.15, 0.05, 0.02])) == pytest.approx(0.02)
    assert reference.off_path(np.array([0.3, 0.1, 0.0]) * 1.1) == pytest.approx(0.1 * 0.1**0.5)


class Straight:
    """Turns the joints straight to a posture, whatever is in the way."""

    def __init__(self, way):
        self.way = way

    def aim(self, target):
        """Nothing to do."""

    def step(self, q, tick, reference):
        return q + self.way / 200 if tick < 200 else q


def test_an_arm_that_moves_into_a_thing_collides_by_its_own_motion(cell, ready):
    way = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    middle = PeerGeometry(cell, ()).tool(ready + 0.5 * way).p
    scene = scene_of(cell, ready, [ready + way], [ball(tuple(middle.tolist()))])
    result = run("straight", lambda cell, scene: Straight(way), cell, scene)
    assert (result.collisions, result.own_collisions, result.reached) == (1, 1, 1)
    # The MRF, which passes through the ball's centre, is 11 mm ahead of the hand's end.
    assert result.clearance_m == pytest.approx(-(0.05 - 0.011), abs=1e-3)
    assert result.off_path_m > 0.0


def test_a_thing_that_runs_into_a_standing_arm_is_not_the_arms_doing(cell, ready):
    x, y, z = PeerGeometry(cell, ()).tool(ready).p.tolist()
    hits = ball((x, y, z + 0.3), swing=(0.0, 0.0, -0.28), frequency=1.5)
    scene = scene_of(cell, ready, [ready + 0.3], [hits])
    result = run("still", lambda cell, scene: Straight(np.zeros(7)), cell, scene)
    assert result.collisions > 0
    assert (result.own_collisions, result.reached, result.stuck) == (0, 0, 1)


def test_telerobot_reaches_targets_in_the_open_inside_all_its_bounds(cell, ready):
    scene = labelled(cell, scene_of(cell, ready, [ready + 0.15, ready - 0.1]), COPIES)
    result = run("telerobot", Telerobot, cell, scene)
    assert (result.reached, result.stuck, result.no_command) == (2, 0, 0)
    assert max(result.acceleration, result.jerk) <= 1.0
    assert result.off_path_m < 2e-3


# --- the table -------------------------------------------------------------------------------


def test_a_target_that_was_reached_by_going_nearer_than_told_counts_as_reached_and_not_as_kept():
    def told(clearance_m, reached):
        result = PeerResult("pink", 1, True, False, targets=2, tick_us=[1.0])
        result.clearance_m, result.reached = clearance_m, reached
        return as_json(result)

    ((*_, cells),) = rows([told(0.0195, 2), told(0.0185, 1)])
    assert dict(zip(COLUMNS[2:6], cells, strict=False)) == {
        "runs": "2", "targets reached": "3 of 4", "kept": "2", "stuck": "0",
    }  # fmt: skip


# --- the command -----------------------------------------------------------------------------


def test_the_command_writes_scenes_runs_and_table(tmp_path, capsys):
    files = {name: tmp_path / name for name in ("scenes", "json", "markdown")}
    options = [word for name, file in files.items() for word in (f"--{name}", str(file))]
    assert cli.main(["--seeds", "11:12", "--controllers", "telerobot", *options]) == 0
    assert [scene.seed for scene in read(files["scenes"])] == [11]
    runs = json.loads(files["json"].read_text())["runs"]
    assert [r["seed"] for r in runs] == [11]
    assert all(r["tick_us"]["p50"] > 0.0 and r["acceleration"] <= 1.0 for r in runs)
    assert all(r["own_collisions"] == 0 for r in runs)
    table = files["markdown"].read_text().splitlines()
    assert table[0].startswith("| scenes | controller |")
    assert "telerobot" in table[2]
    assert "telerobot" in capsys.readouterr().out


def test_a_library_that_is_missing_is_named_in_one_line(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mink", None)
    assert cli.main(["--seeds", "0", "--controllers", "mink"]) == 2
    error = capsys.readouterr().err
    assert "mink" in error
    assert "make bench-peers" in error
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize("words", ["x", "5:5", "3:1", "-1:2"])
def test_seeds_that_are_none_are_bad_usage(words):
    with pytest.raises(SystemExit) as ended:
        cli.main([f"--seeds={words}"])
    assert ended.value.code == 2
