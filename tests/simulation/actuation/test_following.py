"""The arm follows a hand at rate level (CSP, CSV) and at torque level (CST), and stops safely."""

from functools import cache

import numpy as np
import pytest
from laboratory.campaign.torques import play
from telerobot.config.load import HERE, Cell, altered, load_cell
from telerobot.server.control.spatial import rotation_log, rotation_rpy
from telerobot.server.stability.loops import delays
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ...conftest import shared
from ..conftest import Run

SWITCH = 'operation_mode = "csp"'
FORCE, PUSHED_S = 4.0, 1.0
PUSH = {
    "at_s": 0.6,
    "rig/fault": {"kind": "hand", "target": "force_torque", "vector": [0.0, FORCE, 0.0]},
}
LET_GO = {
    "at_s": 0.6 + PUSHED_S,
    "rig/fault": {"kind": "hand", "target": "force_torque", "on": False},
}


@pytest.fixture(scope="session")
def hand(tmp_path_factory):
    """Return a function from an operation mode to the hand-following cell with that one line."""
    folder = tmp_path_factory.mktemp("hand")
    text = (HERE / "cells" / "pa10_hand.toml").read_text(encoding="utf-8")
    assert text.count(SWITCH) == 1

    @cache
    def cell(mode: str) -> Cell:
        path = folder / f"{mode}.toml"
        path.write_text(text.replace(SWITCH, SWITCH.replace("csp", mode)), encoding="utf-8")
        return load_cell(path)

    return cell


def played(cell, *steps, seconds, before=None):
    simulation = Simulation(
        cell, Script.model_validate({"duration_s": seconds, "step": list(steps)})
    )
    if before is not None:
        before(simulation)
    return Run(simulation, simulation.run())


@pytest.fixture(scope="session")
def pushed(hand):
    """Return a function from a mode to a run in which a hand pushes for a second."""
    return shared(lambda mode: played(hand(mode), PUSH, LET_GO, seconds=2.4))


def path(run):
    """Return times since the push (k,), true tool poses (k, 6) against the first of them."""
    start = run.simulation.player.start_s + PUSH["at_s"]
    t = np.array([truth.time_s for truth in run.truths]) - start
    poses = np.array([truth.pose_mrf for truth in run.truths])
    began = int(np.argmin(np.abs(t)))
    return t[began:], poses[began:], poses[began]


def model(t, source):
    """Return where a mass M with damping B is after a push from 0 to `PUSHED_S` (k,) [m]."""
    tau, v = source.mass / source.damping, FORCE / source.damping

    def since(s):
        s = np.maximum(s, 0.0)
        return v * (s - tau * (1.0 - np.exp(-s / tau)))

    return since(t) - since(t - PUSHED_S)


# --- the promise --------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["csp", "csv", "cst"])
def test_the_pose_answers_a_push_as_the_impedance_with_the_stated_lag_does(pushed, hand, mode):
    run, config = pushed(mode), hand(mode).config
    t, poses, first = path(run)
    moved = poses[:, 1] - first[1]
    lag = sum(delays(hand(mode)).values()) * config.timing.period_s
    expected = model(t - lag, config.sources.following)
    steady = (t > 0.4) & (t < PUSHED_S)
    speed = np.polyfit(t[steady], moved[steady], 1)[0]
    assert speed == pytest.approx(FORCE / config.sources.following.damping, rel=0.02)
    transient = t < 5.0 * config.sources.following.mass / config.sources.following.damping
    error = np.abs(moved - expected)
    assert error[transient].max() < 0.05 * expected[transient].max()
    assert error.max() < 0.05 * expected.max()


@pytest.mark.parametrize("mode", ["csp", "csv", "cst"])
def test_the_attitude_is_held_while_the_hand_leads(pushed, mode):
    _, poses, first = path(pushed(mode))
    R = rotation_rpy(*first[3:])
    turned = [np.linalg.norm(rotation_log(R.T @ rotation_rpy(*pose[3:]))) for pose in poses]
    assert max(turned) < 5e-3
    assert np.abs(poses[:, [0, 2]] - first[[0, 2]]).max() < 5e-3


@pytest.mark.parametrize("force", [(0.0, 0.0, FORCE), (-2.5, 2.0, 2.5)], ids=["up", "aslant"])
def test_in_cst_friction_does_not_turn_the_tool_where_the_arm_sets_off(hand, force):
    push = {"at_s": PUSH["at_s"], "rig/fault": {**PUSH["rig/fault"], "vector": list(force)}}
    _, poses, first = path(played(hand("cst"), push, seconds=1.1))
    R = rotation_rpy(*first[3:])
    turned = [np.linalg.norm(rotation_log(R.T @ rotation_rpy(*pose[3:]))) for pose in poses]
    assert np.linalg.norm(poses[-1, :3] - first[:3]) > 0.07
    assert max(turned) < 5e-3


def test_in_cst_the_attitude_is_held_while_a_weak_hand_comes_and_goes(hand):
    """The hand of the paper: (0, 4, 0) N, as sin² over 6 s."""
    swell = {"at_s": PUSH["at_s"], "rig/fault": {**PUSH["rig/fault"], "value": 6.0}}
    _, poses, first = path(played(hand("cst"), swell, seconds=7.2))
    R = rotation_rpy(*first[3:])
    turned = [np.linalg.norm(rotation_log(R.T @ rotation_rpy(*pose[3:]))) for pose in poses]
    # the mean of sin² is a half: 2 N for 6 s, against 20 N·s/m
    assert poses[-1, 1] - first[1] == pytest.approx(0.6, rel=0.03)
    assert max(turned) < 5e-3


@pytest.mark.parametrize("mode", ["csp", "csv", "cst"])
def test_no_bound_is_broken_on_the_way(pushed, mode):
    run = pushed(mode)
    assert run.summary["limit_violations"] == 0, run.summary["violations"]
    assert run.summary["mode"] == "enabled"
    assert [e for e in run.simulation.events if e.severity == "error"] == []


def test_equal_runs_in_cst_have_equal_hashes(pushed, hand):
    again = played(hand("cst"), PUSH, LET_GO, seconds=2.4)
    assert again.summary["command_hash"] == pushed("cst").summary["command_hash"]


def test_a_torque_is_what_is_sent_in_cst_and_a_position_in_csp(pushed):
    assert pushed("cst").summary["command_hash"] != pushed("csp").summary["command_hash"]
    for run, length in ((pushed("csp"), 6), (pushed("cst"), 4)):
        assert {len(data) for data in rpdos(run.simulation.cell)} == {length}


def rpdos(cell):
    """Return RPDO1s that a short run sends."""
    sent = []

    def listen(simulation):
        simulation.cycle.plant.buses[0].taps.append(
            lambda can_id, data: sent.append(bytes(data)) if 0x200 < can_id < 0x280 else None
        )

    played(cell, seconds=0.05, before=listen)
    return sent


def test_enabling_in_cst_moves_nothing(hand):
    run = played(hand("cst"), seconds=1.0)
    start = np.array(hand("cst").config.mechanism.postures["start"])
    assert np.abs(np.array([truth.q for truth in run.truths]) - start).max() < 1e-3
    assert np.abs(run.truths[-1].dq).max() < 0.02


# --- sensors, switches, stops -------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["csp", "cst"])
def test_a_sensor_that_falls_silent_lets_the_motion_fade(hand, mode):
    silent = {"at_s": 1.2, "rig/fault": {"kind": "silence", "target": "force_torque"}}
    run = played(hand(mode), PUSH, silent, seconds=2.2)
    assert run.events("sensor_stale")
    start = run.simulation.player.start_s
    at = {
        s: np.array(min(run.truths, key=lambda x: abs(x.time_s - start - s)).pose_mrf)
        for s in (1.1, 1.2, 1.6, 2.1)
    }
    assert (at[1.2] - at[1.1])[1] == pytest.approx(0.02, rel=0.1)
    # the force itself goes on, uncompensated: a torque-level arm gives way by F / (M K_p)
    assert abs((at[2.1] - at[1.6])[1]) < (1e-3 if mode == "csp" else 6e-3)
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0


@pytest.mark.parametrize("mode", ["csp", "cst"])
def test_following_is_switched_off_and_on_in_motion_without_a_jump(hand, mode):
    off = {"at_s": 1.2, "operator/switch": {"source": "following", "on": False}}
    on = {"at_s": 2.0, "operator/switch": {"source": "following", "on": True}}
    run = played(hand(mode), PUSH, off, on, seconds=3.0)
    start = run.simulation.player.start_s
    y = [truth.pose_mrf[1] for truth in run.truths if truth.time_s - start > 0.5]
    acceleration = np.diff(y, n=2) / 1e-4
    assert np.abs(acceleration).max() < 6.0  # F/M is 4 m/s², at the push itself
    assert abs(run.speeds(1.85, 1.98)).max() < 0.02
    assert run.summary["limit_violations"] == 0
    assert run.at(2.9).pose_mrf[1] - run.at(2.7).pose_mrf[1] == pytest.approx(0.04, rel=0.05)


STOPS = {
    "hold": {"at_s": 1.2, "operator/mode": {"action": "hold"}},
    "protective stop": {"at_s": 1.2, "operator/protective_stop": {}},
    "lease lost": {"at_s": 1.2, "link": {"cut": True}},
}


@pytest.mark.parametrize("cause", sorted(STOPS))
def test_in_cst_a_verified_stop_ends_in_hold_and_the_hand_moves_nothing(hand, cause):
    run = played(hand("cst"), PUSH, STOPS[cause], seconds=3.4)
    assert run.summary["mode"] == "hold"
    assert run.summary["limit_violations"] == 0
    assert run.events("fault") == []
    start = run.simulation.player.start_s
    late = [t for t in run.truths if t.time_s - start > 2.4]
    q = np.array([t.q for t in late])
    assert np.ptp(q, axis=0).max() < 4e-3
    held = np.array(run.states[-1].q_command)
    assert np.abs(q[-1] - held).max() < 6e-3


QUICK = {
    "a drive's fault": {"kind": "fault", "target": "e1"},
    "a silent drive": {"kind": "silence", "target": "s2"},
    "a joint pushed away": {"kind": "push", "target": "e1", "vector": [0.0, 0.0, -2000.0]},
}


@pytest.mark.parametrize("cause", sorted(QUICK))
def test_in_cst_a_quick_stop_is_the_drives_own_and_ends_at_rest(hand, cause):
    run = played(hand("cst"), PUSH, {"at_s": 1.2, "rig/fault": QUICK[cause]}, seconds=2.6)
    assert run.summary["mode"] == "fault"
    assert [e for e in run.simulation.events if e.severity == "error"]
    held = [i for i, j in enumerate(hand("cst").robot.joints) if j.name != "s2"]
    assert np.abs(run.speeds(2.2, 2.6)[:, held]).max() < 1e-3


def test_in_cst_a_dead_daemon_leaves_drives_that_stop_by_themselves(hand):
    simulation = Simulation(hand("cst"), Script.model_validate({"duration_s": 1.5, "step": [PUSH]}))
    result = simulation.run
    speeds = []

    def die(sim):
        if sim.clock.time_s > sim.player.start_s + 1.2 and sim.cycle.mode == "enabled":
            for _ in range(60):
                sim.rig.advance(0.01)
                sim.buses.hubs[0].time_s = sim.rig.time_s
                speeds.append(np.abs(sim.rig.world.dq).max())

    simulation.on_tick = lambda sim: die(sim) if not speeds else None
    result()
    assert speeds[0] > 0.1
    assert max(speeds[25:]) < 2e-3


def test_in_cst_torques_are_planned_inside_their_bounds_and_what_is_held_back_is_told(hand):
    cell = hand("cst")
    drives = tuple(
        d.model_copy(update={"max_torque_rate": 400.0}) if d.joint == "s1" else d
        for d in cell.config.mechanism.drives
    )
    tight = altered(cell, {"mechanism.drives": drives})
    push = {**PUSH, "rig/fault": {**PUSH["rig/fault"], "vector": [0.0, 8.0, 0.0]}}
    run = played(tight, push, LET_GO, seconds=2.6)
    assert any("torque:s1" in state.limits for state in run.states)
    assert run.events("gate_refused") == []
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0
    # what was held back is no disturbance, and nothing swings afterwards
    assert not any(x.startswith("disturbance") for state in run.states for x in state.limits)
    assert np.abs(run.speeds(2.4, 2.6)).max() < 0.01


RISEN = 10


@pytest.mark.parametrize("way", [(0.6, 0.0, 0.8), (-0.7, 0.5, -0.5), (0.0, -0.6, 0.8)])
def test_in_cst_a_stop_while_a_hand_pushes_is_the_verified_one(hand, way):
    """20 N within 0.2 s, and the stop in the middle of it."""
    rises = [
        {
            "at_s": round(0.6 + 0.02 * i, 2),
            "rig/fault": {
                "kind": "hand",
                "target": "force_torque",
                "vector": [20.0 * x * (i + 1) / RISEN for x in way],
            },
        }
        for i in range(RISEN)
    ]
    run = played(hand("cst"), *rises, {"at_s": 0.78, "operator/protective_stop": {}}, seconds=2.0)
    assert run.events("gate_refused") == []
    assert run.summary["mode"] == "hold"
    assert run.summary["limit_violations"] == 0


@pytest.mark.parametrize("seed", [3, 8, 21, 34])
def test_in_cst_pushes_stops_reversals_and_payloads_are_never_refused(seed):
    """A sample of the campaign's part `torques`."""
    assert play(seed).reasons == []


# --- nobody's force ------------------------------------------------------------------------------

LIGHT = {"kind": "hand", "target": "force_torque", "vector": [0.0, 1.0, 0.0]}


def untold(cell, kg):
    """Return a cell with a load at the tool that nobody told of."""
    return altered(cell, {"rig.payload_mass": kg, "rig.payload_com": (0.0, 0.0, 0.1)})


def places(run, from_s, to_s):
    """Return the tool's true places between two times of the script (k, 3) [m]."""
    start = run.simulation.player.start_s
    kept = [t for t in run.truths if from_s <= t.time_s - start <= to_s]
    return np.array([t.pose_mrf[:3] for t in kept])


def moved(run, from_s, to_s):
    """Return how far the tool has gone between two times of the script (3,) [m]."""
    found = places(run, from_s, to_s)
    return found[-1] - found[0]


@pytest.mark.parametrize("mode", ["csp", "cst"])
def test_a_load_that_nobody_told_of_leads_the_tool_nowhere_and_is_named(hand, mode):
    run = played(untold(hand(mode), 0.2), seconds=3.0)
    (said,) = run.events("force_unchanging")
    assert said.values["force_n"] == pytest.approx(0.2 * 9.81, abs=0.15)
    assert "+0.2 kg" in said.detail
    assert np.linalg.norm(moved(run, 0.0, 3.0)) < 3e-3


def test_a_light_hand_leads_a_tool_with_an_untold_load_at_once_and_the_load_does_not_after(hand):
    """1 N beside the 2 N of the load; both are followed while the hand is there."""
    push, away = (
        {"at_s": 0.5, "rig/fault": LIGHT},
        {"at_s": 1.5, "rig/fault": {**LIGHT, "on": False}},
    )
    run = played(untold(hand("csp"), 0.2), push, away, seconds=2.6)
    assert moved(run, 0.8, 1.5)[:2] == pytest.approx([0.0, 0.7 / 20.0], abs=1e-3)
    assert np.linalg.norm(moved(run, 1.9, 2.6)) < 1e-3


def test_a_load_that_is_lifted_off_leaves_nothing_that_leads_the_tool(hand):
    """The sensor reads nothing then, though it is another wrench than before."""
    lift = {"kind": "hand", "target": "force_torque", "vector": [0.0, 0.0, 0.2 * 9.81]}
    run = played(untold(hand("csp"), 0.2), {"at_s": 0.5, "rig/fault": lift}, seconds=2.0)
    assert np.linalg.norm(moved(run, 0.5, 2.0)) < 5e-3


def test_a_hand_that_stays_the_same_leads_for_three_seconds_and_at_once_when_it_changes(hand):
    """Longer than any hand does; half a newton more is felt as a hand again."""
    light = {"at_s": 0.2, "rig/fault": LIGHT}
    more = {"at_s": 4.2, "rig/fault": {**LIGHT, "vector": [0.0, 1.6, 0.0]}}
    run = played(hand("csp"), light, more, seconds=5.0)
    assert moved(run, 1.0, 3.0)[1] == pytest.approx(2.0 / 20.0, rel=0.02)
    assert np.linalg.norm(moved(run, 3.6, 4.1)) < 1e-3
    assert moved(run, 4.5, 5.0)[1] == pytest.approx(0.5 * 1.6 / 20.0, rel=0.05)
    (said,) = run.events("force_unchanging")
    assert "kg" not in said.detail


def test_what_is_picked_up_and_not_told_leads_the_tool_for_a_second(hand):
    """Vertical, and the same all the while, as no hand's is for so long."""
    weight = {"kind": "hand", "target": "force_torque", "vector": [0.0, 0.0, -2.0]}
    run = played(hand("csp"), {"at_s": 0.2, "rig/fault": weight}, seconds=2.5)
    assert np.linalg.norm(moved(run, 0.2, 2.5)) < 0.13
    assert np.linalg.norm(moved(run, 1.6, 2.5)) < 2e-3


def test_a_told_load_and_no_hand_are_no_unchanging_force(hand):
    run = played(hand("csp"), seconds=2.0)
    assert run.events("force_unchanging") == []
