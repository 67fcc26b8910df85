"""Inside a tunnel a snake gives way to what it meets, and a drive's fault touches no wall."""

from dataclasses import replace

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.server.control.mechanism.backbone.insertion import Backbone
from telerobot.tools.simulation.simulation import simulate


def test_it_gives_way_to_what_blocks_the_way_and_withdraws():
    run = simulate("snake_blocked")
    assert run.ok
    assert run.summary["mode"] == "enabled"
    assert 2.0 < run.summary["wall_force_n"] < 15.0
    deepest = max(s.insertion["depth"] for s in run.states if s.insertion)
    assert deepest < 0.320  # the drive alone would have come to 0.43
    assert any("insertion_speed" in s.limits for s in run.states)
    assert run.states[-1].insertion["depth"] < 0.2
    assert not any(any(t.contact_force) for t in run.truths[-50:])


@pytest.mark.parametrize(("speed", "joint"), [(0.08, "j15"), (0.05, "j25")])
def test_a_drive_that_faults_inside_stops_all_and_touches_no_wall(play, speed, joint):
    run = play(
        {"at_s": 0.3, "cmd/drive": {"rates": [speed]}},
        {"at_s": 1.4, "rig/fault": {"kind": "fault", "target": joint}},
        seconds=2.0,
        cell=load_cell("snake"),
    )
    assert run.summary["mode"] == "fault"
    assert max(map(abs, run.truths[-1].dq)) < 1e-3
    assert run.summary["wall_force_n"] == 0.0
    assert run.summary["min_clearance_m"] > 0.005


def test_when_a_drive_falls_silent_deep_inside_the_others_stop_along_the_curve(play):
    cell = load_cell("snake")
    fits = Backbone.from_cell(cell)
    q = tuple(fits.fits[int(np.abs(fits.lengths - 0.75).argmin())].tolist())
    mechanism = cell.config.mechanism.model_copy(update={"postures": {"start": q, "ready": q}})
    config = cell.config.model_copy(update={"mechanism": mechanism})
    run = play(
        {"at_s": 0.1, "cmd/drive": {"rates": [0.08]}},
        {"at_s": 0.6, "rig/fault": {"kind": "silence", "target": "j8"}},
        seconds=0.85,
        cell=replace(cell, config=config),
    )
    assert run.summary["mode"] == "fault"
    assert max(map(abs, run.truths[-1].dq)) < 0.02
    # Each on its own ramp, they press the links on the wall.
    assert run.summary["min_clearance_m"] > 0.005
    assert run.summary["wall_force_n"] == 0.0


def test_without_touch_a_joint_blocked_inside_holds_up_all_and_lets_the_arm_withdraw(play):
    snake = load_cell("snake")
    unfeeling = replace(snake, config=snake.config.model_copy(update={"touch": None}))
    run = play(
        {"at_s": 0.3, "cmd/drive": {"rates": [0.08]}},
        {"at_s": 1.1, "rig/fault": {"kind": "block", "target": "j22"}},
        {"at_s": 2.2, "cmd/drive": {"rates": [-0.06]}},
        seconds=2.9,
        cell=unfeeling,
    )
    assert run.result.ok
    depth = {t: run.at(t).insertion["depth"] for t in (1.1, 1.6, 2.1, 2.8)}
    assert depth[1.6] < depth[1.1] + 0.03
    assert depth[2.1] == pytest.approx(depth[1.6], abs=1e-4)
    assert "leash:j22" in run.at(2.0).limits
    assert depth[2.8] < depth[2.1] - 0.005
    assert run.summary["wall_force_n"] == 0.0


def test_a_tunnel_that_is_not_where_the_cell_says_is_felt_and_left_again(play):
    cell = load_cell("snake_shifted")
    run = play(
        {"at_s": 0.3, "cmd/drive": {"rates": [0.06]}},
        {"at_s": 3.6, "operator/mode": {"action": "resume"}},
        {"at_s": 4.0, "cmd/drive": {"rates": [-0.06]}},
        seconds=7.0,
        cell=cell,
    )
    assert run.result.ok
    assert len(run.events("touched")) == 1
    depth = {t: run.at(t).insertion["depth"] for t in (3.5, 3.95)}
    deepest = max(s.insertion["depth"] for s in run.states if s.insertion)
    assert deepest < 0.15  # the drive alone would have come to 0.19
    # Still pushed, it may withdraw, and goes no farther.
    assert run.at(3.5).mode == "hold"
    assert run.at(3.95).mode == "enabled"
    assert depth[3.95] <= depth[3.5]
    assert run.states[-1].insertion["depth"] < 0.02
    assert not any(any(t.contact_force) for t in run.truths[-20:])
    assert run.summary["wall_force_n"] < 60.0


def test_a_joint_that_sticks_inside_is_found_by_name_and_the_arm_withdraws(play):
    run = play(
        {"at_s": 0.3, "cmd/drive": {"rates": [0.08]}},
        {"at_s": 1.1, "rig/fault": {"kind": "stick", "target": "j22", "value": 2.0}},
        {"at_s": 1.9, "operator/mode": {"action": "resume"}},
        {"at_s": 2.0, "cmd/drive": {"rates": [-0.06]}},
        seconds=2.8,
        cell=load_cell("snake"),
    )
    assert run.result.ok
    assert {e.values["joint"] for e in run.events("touched")} == {"j22"}
    stopped, end = run.at(1.8), run.states[-1]
    assert stopped.mode == "hold"
    assert end.insertion["depth"] < stopped.insertion["depth"] - 0.02
    assert run.summary["wall_force_n"] == 0.0
    assert run.summary["min_clearance_m"] > 0.005
