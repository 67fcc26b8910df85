"""A snake of thirty joints goes through its tunnels and out again, and touches no wall."""

import numpy as np
import pytest
from laboratory.oracle.arm import OracleArm
from laboratory.oracle.tunnel import Tunnel
from telerobot.config.load import load_cell
from telerobot.tools.simulation.simulation import simulate


@pytest.fixture(scope="module")
def snake():
    return load_cell("snake")


def off_centre(truths):
    """How far links were off the centre line [m], by other means than the run's own judge."""
    cell = load_cell("snake")
    arm, tunnel = OracleArm.of(cell), Tunnel(cell.config.mechanism.backbone)
    worst = 0.0
    for truth in truths:
        links = arm.frames(np.array(truth.q))[1:, :3, 3]
        between = 0.5 * (links[1:] + links[:-1])
        worst = max(worst, tunnel.off_centre(np.concatenate((links, between))))
    return worst


def test_it_goes_through_the_maze_and_comes_out_again():
    run = simulate("snake")
    assert run.ok
    assert run.summary["mode"] == "enabled"
    assert max(s.insertion["depth"] for s in run.states if s.insertion) > 0.865
    assert run.states[-1].insertion["depth"] == pytest.approx(0.15, abs=1e-3)
    assert run.summary["min_clearance_m"] >= 0.008
    assert run.summary["centre_error_m"] <= 0.0045
    assert run.summary["wall_force_n"] == 0.0
    assert run.summary["centre_error_m"] == pytest.approx(off_centre(run.truths), abs=1e-9)


@pytest.mark.parametrize("name", ["snake_space", "snake_helix"])
def test_in_space_it_goes_through_its_tunnel_and_comes_back_and_stops(play, name):
    run = play(
        {"at_s": 0.3, "cmd/drive": {"rates": [0.08]}},
        {"at_s": 5.0, "cmd/drive": {"rates": [-0.08]}},
        {"at_s": 6.5, "operator/mode": {"action": "hold"}},
        seconds=7.2,
        cell=load_cell(name),
    )
    assert run.result.ok
    depth = {t: run.at(t).insertion["depth"] for t in (5.0, 7.1)}
    assert depth[5.0] > 0.5
    assert depth[7.1] < depth[5.0] - 0.08
    assert run.summary["min_clearance_m"] >= 0.005
    assert run.summary["centre_error_m"] <= 0.006
    assert run.summary["wall_force_n"] == 0.0


def test_a_stop_on_the_way_touches_no_wall_and_it_goes_on(play, snake):
    run = play(
        {"at_s": 0.3, "cmd/drive": {"rates": [0.08]}},
        {"at_s": 2.0, "operator/mode": {"action": "hold"}},
        {"at_s": 2.6, "operator/mode": {"action": "enable"}},
        {"at_s": 2.6, "cmd/drive": {"rates": [-0.08]}},
        seconds=4.0,
        cell=snake,
    )
    assert run.result.ok
    held, end = run.at(2.5), run.states[-1]
    assert held.mode == "hold"
    assert held.insertion["depth"] > 0.25
    assert end.insertion["depth"] < held.insertion["depth"] - 0.05
    assert run.summary["min_clearance_m"] >= 0.008
    assert run.summary["wall_force_n"] == 0.0


def test_a_stick_along_the_head_inserts_it_and_aside_does_nothing(play, snake):
    run = play(
        {"at_s": 0.3, "cmd/joystick": {"twist": [0, 0.05, 0, 0, 0, 0], "expressed_in": "mrf"}},
        {"at_s": 1.3, "cmd/joystick": {"twist": [0.05, 0, 0, 0, 0, 0], "expressed_in": "mrf"}},
        seconds=2.3,
        cell=snake,
    )
    assert run.result.ok
    start, aside, along = (run.at(t).insertion["depth"] for t in (0.2, 1.2, 2.2))
    assert aside == pytest.approx(start, abs=1e-4)
    assert along == pytest.approx(start + 0.045, abs=0.01)
    assert run.summary["wall_force_n"] == 0.0


def test_it_is_driven_to_a_depth(play, snake):
    run = play({"at_s": 0.3, "cmd/insert": {"depth": 0.20}}, seconds=2.5, cell=snake)
    assert run.result.ok
    assert run.states[-1].insertion["depth"] == pytest.approx(0.20, abs=1e-3)
    assert run.states[-1].at_goal
    assert not run.at(0.5).at_goal


@pytest.mark.parametrize(
    ("topic", "fields", "words"),
    [
        ("cmd/drive", {"rates": [0.5]}, "rates: 0.5 m/s: at most 0.08 either way"),
        ("cmd/drive", {"rates": [0.01, 0.01]}, "rates: 2 values: one is expected"),
        ("cmd/insert", {"depth": 1.2}, "depth: 1.2 m: at most 0.8700 m"),
    ],
)
def test_what_it_cannot_do_is_refused(play, snake, topic, fields, words):
    run = play({"at_s": 0.3, topic: fields}, seconds=0.6, cell=snake)
    assert {f"{topic}: {words}"} == {e.detail for e in run.events("command_refused")}
    assert run.states[-1].insertion["depth"] == pytest.approx(0.15, abs=1e-3)


def test_an_arm_without_a_backbone_is_not_inserted(play, pa10):
    run = play({"at_s": 0.3, "cmd/drive": {"rates": [0.01]}}, seconds=0.6, cell=pa10)
    assert {e.detail for e in run.events("command_refused")} == {
        "cmd/drive: the mechanism has no backbone to be inserted"
    }


def test_a_posture_off_its_curve_is_told_and_only_jogged(play, snake):
    # The tip comes 10 mm off, and stays clear of the wall.
    jog = {"rates": [0.0] * 29 + [0.5]}
    run = play(
        {"at_s": 0.3, "for_s": 0.4, "cmd/jog": jog},
        {"at_s": 0.9, "for_s": 0.3, "cmd/drive": {"rates": [0.05]}},
        {"at_s": 1.2, "cmd/posture": {"posture": "ready"}},
        {"at_s": 2.9, "cmd/insert": {"depth": 0.17}},
        seconds=4.4,
        cell=snake,
    )
    off = run.at(1.1)
    assert off.insertion is None
    assert "off_backbone" in off.limits
    assert not any(off.dq_command)
    assert run.states[-1].insertion["depth"] == pytest.approx(0.17, abs=1e-3)
    assert run.result.ok
    assert run.summary["wall_force_n"] == 0.0


def test_it_goes_over_a_gap_into_the_next_tunnel(play):
    run = play(
        {"at_s": 0.3, "cmd/insert": {"depth": 0.60}}, seconds=6.8, cell=load_cell("snake_gap")
    )
    assert run.result.ok
    assert run.states[-1].insertion["depth"] == pytest.approx(
        0.60, abs=1e-3
    )  # the gap ends at 0.49
    assert run.summary["min_clearance_m"] >= 0.008
    assert run.summary["wall_force_n"] == 0.0
