"""A snake is told its tunnel by message: it is refitted at rest, and goes in without touching."""

import pytest
from telerobot.config.load import load_cell
from telerobot.tools.recording.replay import Replay
from telerobot.tools.recording.run_file import read_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation, simulate

HELIX = [[0.60, 2.52, 0.0, 1.2], [0.35, 0.0, 0.0, 0.0]]
OFF = {"at_s": 0.1, "operator/mode": {"action": "disable"}}


def told(pieces, at_s=0.4, **more):
    return {"at_s": at_s, "operator/tunnel": {"pieces": pieces, **more}}


def test_told_before_the_entrance_it_goes_into_its_tunnel_and_touches_nothing():
    run = simulate("snake_told")
    assert run.ok
    assert run.summary["deepest_m"] > 0.8
    assert run.summary["wall_force_n"] == 0.0
    assert run.summary["min_clearance_m"] >= 0.005


def test_not_told_it_runs_into_the_wall_that_it_does_not_know_of(play):
    run = play(
        {"at_s": 0.2, "cmd/insert": {"depth": 0.30}}, seconds=5.0, cell=load_cell("snake_told")
    )
    assert run.summary["wall_force_n"] > 1.0


def test_what_was_told_is_in_the_telemetry_and_the_recording_replays(tmp_path):
    file = tmp_path / "run.mcap"
    steps = [
        OFF, told(HELIX), {"at_s": 0.5, "operator/mode": {"action": "enable"}},
        {"at_s": 0.9, "cmd/drive": {"rates": [0.08]}},
    ]  # fmt: skip
    script = Script.model_validate({"duration_s": 1.6, "step": steps})
    simulation = Simulation(load_cell("snake_told"), script, file)
    run = simulation.run()
    assert run.states[0].tunnel is None
    assert run.states[-1].tunnel == tuple(map(tuple, HELIX))
    assert run.states[-1].insertion["depth"] > 0.02
    replay = Replay(file, read_cell(file))
    known = {tick.inputs[0].settings.tunnel for tick in replay.run()}
    assert len(known) == 2
    assert replay.judgement.difference is None


def test_it_is_told_with_drives_off_only(play):
    run = play(told(HELIX, 0.2), seconds=0.4, cell=load_cell("snake_told"))
    (reply,) = run.summary["refused"]
    assert "a tunnel is told with drives off, mode is enabled" in reply


def test_a_part_that_the_arm_is_in_stays_as_it_is(play):
    # The tip of `snake_helix` stands 0.15 m inside.
    straight, same = [[0.95, 0.0, 0.0, 0.0]], [[0.20, 0.84, 0.0, 0.4], [0.70, 0.0, 0.5, 0.0]]
    run = play(
        OFF, told(straight, 0.4), told(same, 0.5), seconds=0.8, cell=load_cell("snake_helix")
    )
    (reply,) = run.summary["refused"]
    assert "the tip is 0.1500 m inside, where the tunnel would move by 0.0466 m" in reply
    assert run.states[-1].tunnel == tuple(map(tuple, same))


@pytest.mark.parametrize(
    ("cell", "pieces", "words"),
    [
        (
            "snake_told",
            [[0.25, 3.1, 0.0, 0.0], [0.6, 0.0, 0.0, 0.0]],
            "its range is -1.040 to 1.040",
        ),
        ("snake_told", [[0.08, 3.0, 0.0, 0.0]], "pieces[0]: a radius of 0.02667 m is within"),
        ("snake", [[0.5, 0.0, 0.5, 0.0]], "pieces[0].climb: a planar arm cannot follow it"),
        ("pa10", [[0.5, 0.0, 0.0, 0.0]], "the mechanism has no backbone"),
    ],
)
def test_what_the_arm_cannot_pass_is_refused_with_place_and_bound(play, cell, pieces, words):
    run = play(OFF, told(pieces), seconds=0.6, cell=load_cell(cell))
    (reply,) = run.summary["refused"]
    assert words in reply
    assert run.states[-1].tunnel is None


def test_without_pieces_the_cells_own_holds_again(play):
    run = play(OFF, told(HELIX), told([], 0.5), seconds=0.7, cell=load_cell("snake_told"))
    assert run.at(0.45).tunnel is not None
    assert run.states[-1].tunnel is None
    assert [event.detail for event in run.events("tunnel_set")] == ["", "the cell's"]
