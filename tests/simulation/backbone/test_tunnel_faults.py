"""Inside a tunnel a snake gives way to what it meets, and a drive's fault touches no wall."""

import numpy as np
import pytest
from laboratory.oracle.arm import OracleArm
from laboratory.oracle.tunnel import Tunnel
from telerobot.config.load import altered, load_cell
from telerobot.server.control.backbone.insertion import Backbone
from telerobot.tools.simulation.simulation import simulate


@pytest.fixture(scope="module")
def inside():
    """Make `snake` start at a free length [m], `off` (n,) the curve [rad]."""
    cell = load_cell("snake")
    fits = Backbone.from_cell(cell)

    def start(s1, off=0.0):
        q = fits.fits[int(np.abs(fits.lengths - s1).argmin())] + off
        postures = dict.fromkeys(("start", "ready"), tuple(q.tolist()))
        return altered(cell, {"mechanism.postures": postures})

    return start


def test_it_gives_way_to_what_blocks_the_way_and_withdraws():
    run = simulate("snake_blocked")
    assert run.ok
    assert run.summary["mode"] == "enabled"
    # In every physics step, over both sides of a link: 9.6 N net at the end of a period.
    assert 2.0 < run.summary["wall_force_n"] < 20.0
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


def test_when_a_drive_falls_silent_deep_inside_the_others_stop_along_the_curve(play, inside):
    run = play(
        {"at_s": 0.1, "cmd/drive": {"rates": [0.08]}},
        {"at_s": 0.6, "rig/fault": {"kind": "silence", "target": "j8"}},
        seconds=0.85,
        cell=inside(0.75),
    )
    assert run.summary["mode"] == "fault"
    assert max(map(abs, run.truths[-1].dq)) < 0.02
    # Each on its own ramp, they press the links on the wall.
    assert run.summary["min_clearance_m"] > 0.005
    assert run.summary["wall_force_n"] == 0.0


@pytest.mark.parametrize("bus", ["tail", "head"])
def test_when_a_whole_bus_falls_silent_inside_all_joints_stop_and_touch_no_wall(play, inside, bus):
    run = play(
        {"at_s": 0.1, "cmd/drive": {"rates": [0.08]}},
        {"at_s": 0.7, "rig/fault": {"kind": "unplug", "target": bus}},
        seconds=1.1,
        cell=inside(0.75),
    )
    (fault,) = run.events("fault")
    assert (fault.values["device"], fault.values["cause"]) == (f"bus {bus}", "bus_silent")
    assert run.at(0.65).insertion["speed"] == pytest.approx(0.08)
    assert np.abs(run.speeds(0.65, 0.7)).max() > 0.5
    assert max(map(abs, run.truths[-1].dq)) < 0.01
    assert run.summary["wall_force_n"] == 0.0
    assert run.summary["min_clearance_m"] > 0.0015


def test_enabled_inside_off_its_curve_it_can_be_jogged_back_and_nothing_else(play, inside):
    # Two joints near the head are off; the tip is 10 mm off the centre line.
    off = np.zeros(30)
    off[[27, 29]] = 0.06, -0.10
    back = [0.0] * 27 + [-0.20, 0.0, 1 / 3]
    run = play(
        {"at_s": 0.2, "cmd/drive": {"rates": [0.05]}},
        {"at_s": 0.4, "for_s": 0.2, "cmd/joystick": {"twist": [0.0, 0.0, 0.05, 0.0, 0.0, 0.0]}},
        {"at_s": 0.6, "cmd/insert": {"depth": 0.2}},
        {"at_s": 0.8, "for_s": 0.3, "cmd/jog": {"rates": back}},
        {"at_s": 1.2, "cmd/drive": {"rates": [-0.05]}},
        seconds=1.6,
        cell=inside(0.95, off),
    )
    assert run.result.ok
    for t in (0.1, 0.35, 0.55, 0.75):
        assert run.at(t).mode == "enabled"
        assert run.at(t).insertion is None
        assert run.at(t).limits == ("off_backbone",)
        assert not any(run.at(t).dq_command)
    assert "off_backbone" not in run.at(1.0).limits
    assert run.at(1.58).insertion["depth"] < run.at(1.3).insertion["depth"] - 0.008
    assert run.summary["wall_force_n"] == 0.0


def test_enabled_with_a_link_beyond_a_wall_it_says_so_and_when_it_is_out_again(play, inside):
    off = np.zeros(30)
    off[[24, 27]] = 0.15, -0.30
    cell = inside(0.95, off)
    # The walls are not where the cell has them: nothing but the curve says that it is beyond one.
    cell = altered(cell, {"rig.tunnel.shift": (0.0, 0.0, 1.0)})
    back = [0.0] * 24 + [-0.15, 0.0, 0.0, 0.30, 0.0, 0.0]
    run = play({"at_s": 0.5, "for_s": 0.9, "cmd/jog": {"rates": back}}, seconds=1.8, cell=cell)
    (beyond,), (out,) = run.events("beyond_wall"), run.events("off_wall")
    assert beyond.values["beyond_m"] == pytest.approx(0.0144, abs=1e-3)
    assert beyond.time_s < out.time_s
    truth = Tunnel(cell.config.mechanism.backbone)
    arm = OracleArm.of(cell)

    def room_left(time_s):
        q = min(run.truths, key=lambda t: abs(t.time_s - time_s)).q
        links = arm.frames(np.array(q))[1:, :3, 3]
        points = np.concatenate((links, 0.5 * (links[1:] + links[:-1])))
        return 0.030 - 0.015 - truth.off_centre(points)

    assert room_left(beyond.time_s) == pytest.approx(-beyond.values["beyond_m"], abs=1e-3)
    assert -1e-3 < room_left(out.time_s) < 3e-3


@pytest.mark.parametrize(("half_width", "from_m"), [(0.012, 0.25), (0.0175, 0.0)])
def test_a_tunnel_told_wide_that_is_narrow_is_felt_by_name_and_let_go_of(play, half_width, from_m):
    """Head on an edge, or wedged along all of it; without touch that ends in a drive's FAULT."""
    cell = load_cell("snake")
    cell = altered(
        cell,
        {
            "mechanism.backbone.half_width": 0.06,
            "rig.tunnel.half_width": half_width,
            "rig.tunnel.narrow_from": from_m,
        },
    )
    run = play({"at_s": 0.3, "cmd/drive": {"rates": [0.08]}}, seconds=4.6, cell=cell)
    assert len(run.events("touched")) == 1
    assert run.events("touched")[0].values["joint"].startswith("j")
    assert run.summary["mode"] == "hold"
    assert run.events("fault") == []
    late = [sum(map(abs, truth.contact_force)) for truth in run.truths[-30:]]
    assert max(late) < 60.0


@pytest.mark.parametrize(("joint", "speed"), [("j8", 0.03), ("j22", 0.08)])
def test_with_a_locked_joint_the_others_bend_around_it_out_to_the_entrance(
    play, inside, joint, speed
):
    run = play(
        {"at_s": 0.1, "cmd/drive": {"rates": [speed]}},
        {"at_s": 0.6, "rig/fault": {"kind": "block", "target": joint}},
        {"at_s": 1.3, "operator/mode": {"action": "resume"}},
        {"at_s": 1.35, "cmd/drive": {"rates": [-0.08]}},
        seconds=9.0,
        cell=inside(0.95),
    )
    assert {e.values["joint"] for e in run.events("touched")} == {joint}
    (locked,) = run.events("joint_locked")
    assert locked.values["joint"] == joint
    assert run.at(1.25).mode == "hold"
    assert run.at(1.25).insertion["depth"] > 0.55
    assert (
        run.states[-1].insertion["depth"] < 0.06
    )  # it was 0.54 and 0.48 when a link neared a wall
    assert f"locked:{joint}" in run.states[-1].limits
    assert run.summary["wall_force_n"] == 0.0
    assert run.summary["min_clearance_m"] > 0.0015
    assert run.summary["limit_violations"] == 0


def test_with_a_locked_joint_an_arm_withdraws_and_is_not_inserted(play, inside):
    run = play(
        {"at_s": 0.1, "cmd/drive": {"rates": [0.03]}},
        {"at_s": 0.6, "rig/fault": {"kind": "block", "target": "j8"}},
        {"at_s": 1.3, "operator/mode": {"action": "resume"}},
        {"at_s": 1.35, "cmd/drive": {"rates": [-0.08]}},
        {"at_s": 2.4, "cmd/drive": {"rates": [0.05]}},
        seconds=3.0,
        cell=inside(0.95),
    )
    assert run.at(2.4).insertion["depth"] < run.at(1.34).insertion["depth"] - 0.02
    assert run.at(2.95).insertion["depth"] <= run.at(2.5).insertion["depth"] + 1e-3
    assert "locked:j8" in run.at(2.95).limits
    assert run.summary["wall_force_n"] == 0.0


def test_without_touch_a_joint_blocked_inside_holds_up_all_and_lets_the_arm_withdraw(play):
    snake = load_cell("snake")
    unfeeling = altered(snake, {"touch": None})
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
    assert depth[2.1] == pytest.approx(depth[1.6], abs=1e-3)
    assert "locked:j22" in run.at(2.0).limits
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


def test_a_joint_whose_drive_misses_setpoints_is_late_and_not_taken_for_locked(play):
    """It stands for a period, and its command goes on."""
    lost = {"kind": "drop", "target": "j27", "value": 0.1}
    run = play(
        {"at_s": 0.25, "rig/fault": lost},
        {"at_s": 0.3, "cmd/drive": {"rates": [0.05]}},
        {"at_s": 2.5, "cmd/drive": {"rates": [-0.05]}},
        seconds=3.0,
        cell=load_cell("snake"),
    )
    assert run.events("joint_locked") == []
    assert run.at(2.5).insertion["depth"] > 0.1
    assert run.at(2.99).insertion["depth"] < run.at(2.5).insertion["depth"]
