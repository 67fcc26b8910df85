"""A snake is told its tunnel or a gap, at rest or on its way: it goes in, and touches nothing."""

import pytest
from telerobot.config.load import altered, load_cell
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


@pytest.mark.parametrize("before", [[], [{"at_s": 0.1, "operator/mode": {"action": "hold"}}]])
def test_told_with_drives_on_it_stands_still_while_joints_are_fitted_a_part_in_each_period(
    play, before
):
    run = play(*before, told(HELIX, 0.3), seconds=1.0, cell=load_cell("snake_told"))
    assert not run.summary["refused"]
    (event,) = run.events("tunnel_set")
    # 175 free lengths, four in a period.
    assert run.at(0.3 + 0.42).tunnel is None
    assert run.at(0.3 + 0.48).tunnel == tuple(map(tuple, HELIX))
    assert event.values["pieces"] == 2
    depths = [state.insertion["depth"] for state in run.states if state.insertion]
    assert depths == pytest.approx([depths[0]] * len(depths), abs=1e-4)
    assert run.summary["mode"] == ("hold" if before else "enabled")


AHEAD = [[0.30, 0.0, 0.0, 0.0], [0.45, 1.89, 0.0, 0.9], [0.20, 0.0, 0.0, 0.0]]
GO = {"at_s": 0.2, "cmd/drive": {"rates": [0.08]}}


@pytest.fixture
def straight_first():
    """A snake that believes in a straight tunnel, which winds from 0.3 m on."""
    names = ("length", "bend", "climb", "roll")
    pieces = [dict(zip(names, piece, strict=True)) for piece in AHEAD]
    return altered(load_cell("snake_told"), {"rig.tunnel": {"pieces": pieces}})


def test_told_on_the_way_in_it_follows_what_is_ahead_of_its_tip(play, straight_first):
    run = play(GO, told(AHEAD, 1.2), seconds=9.0, cell=straight_first)
    assert run.result.ok
    speeds = [run.at(t).insertion["speed"] for t in (1.5, 1.6, 1.65, 1.7, 1.8, 4.0, 8.0)]
    assert speeds == pytest.approx([0.08] * 7, abs=1e-3)
    assert run.states[-1].insertion["depth"] > 0.55
    assert run.summary["wall_force_n"] == 0.0
    assert run.summary["min_clearance_m"] >= 0.005
    assert run.summary["centre_error_m"] <= 0.006


def test_not_told_on_the_way_in_it_meets_the_wall(play, straight_first):
    run = play(GO, seconds=6.0, cell=straight_first)
    assert run.summary["wall_force_n"] > 1.0


# --- a gap ----------------------------------------------------------------------------------------

FIRST, SECOND = [0.25, 1.5707963267948966, 0.0, 0.0], [0.6, 0.0, 0.0, 0.0]
NEXT = [-0.37, 0.81, 0.0, 0.0, 0.0, 2.6]
GAP = [FIRST, [0.24, *NEXT], SECOND]


def test_told_a_gap_and_what_comes_after_it_it_goes_through_both_and_back():
    run = simulate("snake_gap_told")
    assert run.ok
    assert run.summary["deepest_m"] > 0.82
    assert run.summary["wall_force_n"] == 0.0
    assert run.summary["min_clearance_m"] >= 0.011


def test_a_gap_is_solved_a_step_in_each_period_and_the_recording_of_it_replays(tmp_path):
    file = tmp_path / "run.mcap"
    go = {"at_s": 2.4, "cmd/drive": {"rates": [0.08]}}
    script = Script.model_validate({"duration_s": 2.8, "step": [told(GAP, 0.2), go]})
    run = Simulation(load_cell("snake_gap_told"), script, file).run()
    assert not run.summary["refused"]
    holds = next(s.time_s for s in run.states if s.tunnel) - run.states[0].time_s - 0.2
    # 145 steps of the gap's curve, then 37 of fits.
    assert 1.5 < holds < 2.1
    assert run.states[-1].tunnel == tuple(map(tuple, GAP))
    assert run.states[-1].insertion["depth"] > 0.16
    replay = Replay(file, read_cell(file))
    known = {tick.inputs[0].settings.tunnel for tick in replay.run()}
    assert len(known) == 2
    assert replay.judgement.difference is None


def test_a_gap_where_the_arm_is_in_is_refused(play):
    # The tip stands 0.15 m inside.
    early = [[0.10, 0.6283, 0.0, 0.0], [0.40, *NEXT], SECOND]
    run = play(OFF, told(early), seconds=3.0, cell=load_cell("snake_gap_told"))
    (reply,) = run.summary["refused"]
    assert "the tip is 0.1500 m inside, where the tunnel would move by" in reply
    assert run.states[-1].tunnel is None


def bends_from(depth):
    return [[depth, 0.0, 0.0, 0.0], [0.30, 2.4, 0.0, 0.0], [0.30, 0.0, 0.0, 0.0]]


def test_it_must_stay_as_it_is_up_to_where_the_tip_would_come_to_rest(play, straight_first):
    cell = straight_first
    run = play(GO, told(bends_from(0.5), 1.2), seconds=1.8, cell=cell)
    tip = next(s for s in run.states if s.tunnel).insertion["depth"]
    assert tip == pytest.approx(0.1, abs=0.02)
    near = play(GO, told(bends_from(tip - 0.003), 1.2), seconds=1.8, cell=cell)
    (reply,) = near.summary["refused"]
    assert "the tip comes to rest 0.1" in reply
    assert near.states[-1].tunnel is None
    farther = play(GO, told(bends_from(tip + 0.02), 1.2), seconds=1.8, cell=cell)
    assert not farther.summary["refused"]
    there = {"at_s": 0.2, "cmd/insert": {"depth": tip}}
    at_rest = play(there, told(bends_from(tip - 0.003), 2.4), seconds=3.0, cell=cell)
    assert not at_rest.summary["refused"]
    assert at_rest.states[-1].tunnel is not None


def test_walls_where_the_arm_is_in_stay_as_they_are(play):
    # The tip of `snake_helix` stands 0.15 m inside.
    cell, whole = load_cell("snake_helix"), [[0.10, 0.42, 0.0, 0.2], [0.50, 2.1, 0.0, 1.0]]
    run = play(OFF, told(whole, open=1), seconds=0.6, cell=cell)
    (reply,) = run.summary["refused"]
    assert "the tip is 0.1500 m inside, where walls would end at 0.1000 m, not 0.9500" in reply


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
        (
            "snake_told",
            [[0.35, 3.1, 0.0, 0.05], [0.35, 3.1, 0.0, 0.05]],
            "pieces[1]: its centre line comes to 0.0",
        ),
        ("snake", [[0.5, 0.0, 0.5, 0.0]], "pieces[0].climb: a planar arm cannot follow it"),
        ("pa10", [[0.5, 0.0, 0.0, 0.0]], "the mechanism has no backbone"),
        (
            "snake_gap_told",
            [FIRST, [0.10, *NEXT], SECOND],
            "pieces[1].to: a length of 0.1 m is no more than its chord, 0.2169 m",
        ),
        (
            "snake_gap_told",
            [FIRST, [0.24, -0.37, 0.81, 0.05, 0.0, 0.0, 2.6], SECOND],
            "pieces[1].to: a planar arm cannot leave its plane",
        ),
        (
            "snake_gap_told",
            [FIRST, [0.22, -0.37, 0.81, 0.0, 0.0, 0.0, -1.5], SECOND],
            "the curves across its gaps are not found in 350 steps",
        ),
        ("snake_gap_told", [FIRST, [0.24, *NEXT]], "a gap lies between two pieces with walls"),
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
