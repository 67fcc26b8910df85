"""An arm on two CAN buses: it moves as on one, and a bus that dies stops all of it."""

import struct

import can
import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.bus import BusSection
from telerobot.drivers.bus import InProcessBus
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.judge import judge
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.observer import Observer
from telerobot.tools.simulation.simulation import Simulation, simulate

from ..conftest import STICK, Run

MOVING = {"at_s": 0.3, "cmd/joystick": STICK}
BUSES = (
    BusSection(name="left", channel="239.0.0.1"),
    BusSection(name="right", channel="239.0.0.2"),
)


@pytest.fixture(scope="module")
def split(pa10):
    """The PA-10 with shoulder and elbow on one bus, wrist and sensor on another, nodes 1 to 3."""
    mechanism = pa10.config.mechanism
    drives = tuple(
        d.model_copy(update={"bus": "left" if i < 4 else "right", "node": i % 4 + 1})
        for i, d in enumerate(mechanism.drives)
    )
    return altered(
        pa10, {"mechanism.drives": drives, "mechanism.force_torque.bus": "right", "buses": BUSES}
    )


def test_an_arm_on_two_buses_moves_as_on_one(play, pa10, split):
    one, two = (play(MOVING, seconds=1.5, cell=cell) for cell in (pa10, split))
    assert two.summary["q_final"] == one.summary["q_final"]
    assert [s.wrench_mrf for s in two.states[-50:]] == [s.wrench_mrf for s in one.states[-50:]]
    assert two.summary["limit_violations"] == 0
    assert two.summary["max_speed_ratio"] == one.summary["max_speed_ratio"] > 0.03


@pytest.mark.parametrize("bus", ["left", "right"])
def test_a_bus_that_is_unplugged_in_motion_stops_the_whole_arm(play, split, bus):
    joints = [d.joint for d in split.config.mechanism.drives if d.bus == bus]
    run = play(
        MOVING,
        {"at_s": 1.2, "rig/fault": {"kind": "unplug", "target": bus}},
        seconds=2.5,
        cell=split,
    )
    (fault,) = run.events("fault")
    assert (fault.values["device"], fault.values["cause"]) == (f"bus {bus}", "bus_silent")
    words = f"none of its {len(joints)} drives answers, {joints[0]} to {joints[-1]}"
    assert fault.detail == f"bus {bus}: {words}"
    assert np.abs(run.speeds(1.1, 1.2)).max() > 0.02
    assert np.abs(run.speeds(2.0, 2.5)).max() < 1e-3
    assert "operation_enabled" not in run.truths[-1].drives
    assert run.summary["mode"] == "fault"
    assert run.summary["limit_violations"] == 0


@pytest.mark.parametrize("bus", ["left", "right"])
def test_the_other_bus_hears_the_stop_a_period_after_the_sync_that_nobody_answered(
    play, split, bus
):
    run = play(
        MOVING,
        {"at_s": 1.2, "rig/fault": {"kind": "unplug", "target": bus}},
        seconds=1.5,
        cell=split,
    )
    (fault,) = run.events("fault")
    # Unplugged just before a SYNC, which nobody answers; the stop goes out before the next.
    assert fault.time_s - run.simulation.player.start_s - 1.2 == pytest.approx(0.01, abs=1e-6)


def test_a_bus_whose_interface_fails_stops_the_drives_of_the_other(split, monkeypatch):
    down, put = set(), InProcessBus.put

    def failing(bus, can_id, data):
        if bus in down:
            raise can.CanOperationError("Network is down [Error Code 100]")
        put(bus, can_id, data)

    monkeypatch.setattr(InProcessBus, "put", failing)
    script = Script.model_validate({"duration_s": 2.5, "step": [MOVING]})
    simulation = Simulation(split, script)
    left, right = simulation.cycle.plant.buses

    def on_tick(now):
        if now.player.start_s is not None and now.clock.time_s > now.player.start_s + 1.2:
            down.add(right.bus)

    simulation.on_tick = on_tick
    run = Run(simulation, simulation.run())
    (fault,) = run.events("fault")
    assert (fault.values["device"], fault.values["cause"]) == ("bus right", "bus_error")
    assert "Network is down" in fault.detail
    assert left.trouble is None
    assert np.abs(run.speeds(1.1, 1.2)).max() > 0.02
    assert np.abs(run.speeds(2.0, 2.5)).max() < 1e-3
    assert "operation_enabled" not in run.truths[-1].drives


def test_an_arm_is_reset_and_enabled_once_its_bus_is_plugged_in_again(play, split):
    run = play(
        MOVING,
        {"at_s": 1.0, "rig/fault": {"kind": "unplug", "target": "right"}},
        {"at_s": 1.6, "operator/mode": {"action": "reset"}},
        {"at_s": 5.0, "rig/fault": {"kind": "unplug", "target": "right", "on": False}},
        {"at_s": 5.2, "operator/mode": {"action": "reset"}},
        {"at_s": 7.0, "operator/mode": {"action": "enable"}},
        seconds=8.0,
        cell=split,
    )
    assert run.at(4.9).mode == "fault"
    assert [r for r in run.summary["refused"] if "still_wrong" in r]
    assert run.at(7.9).mode == "enabled"


def test_a_bus_that_is_not_there_cannot_be_unplugged(play, split):
    run = play(
        {"at_s": 0.1, "rig/fault": {"kind": "unplug", "target": "middle"}}, seconds=0.5, cell=split
    )
    assert "no target 'middle'; there are left, right" in run.summary["failure"]


@pytest.mark.parametrize("bus", [0, 1])
def test_the_observer_judges_each_bus_by_its_own_nodes(split, bus):
    simulation = Simulation(split, load_script("pa10_tour"))
    frames = []
    simulation.observer.frame = lambda *frame: frames.append(frame)
    simulation.run(until=lambda: simulation.clock.time_s > 1.2)
    setpoints = [i for i, f in enumerate(frames) if (f[1], f[3]) == (0x202, bus)]
    k = setpoints[-20]  # the newest ones are those of the stop at the end
    time_s, can_id, data, _ = frames[k]
    word, counts = struct.unpack("<Hi", data)
    forged = (time_s, can_id, struct.pack("<Hi", word, counts + 100_000), bus)
    observer = Observer(split)
    for frame in (*frames[:k], forged, *frames[k + 1 :]):
        observer.frame(*frame)
    joint = split.config.mechanism.drives[1 + 4 * bus].joint
    assert {v.joint for v in observer.violations} == {joint}


# --- thirty joints ----------------------------------------------------------------------------


def errors(cell):
    return {f.check: f for f in judge(cell) if f.status is Severity.ERROR}


def test_thirty_joints_fit_on_two_buses_and_not_on_one(tmp_path):
    snake = load_cell("snake30")
    assert errors(snake) == {}
    text = snake.path.read_text().replace('bus = "head"\n', "").replace('bus = "tail"\n', "")
    start, end = text.index("[[buses]]"), text.index("[zenoh]")
    text = text[:start] + text[end:]
    for first in (1, 6, 11):
        text = text.replace(
            f'joint = "j{first + 15}..j{first + 19}"\nnode = {first}\n',
            f'joint = "j{first + 15}..j{first + 19}"\nnode = {first + 15}\n',
        )
    path = tmp_path / "one_bus.toml"
    path.write_text(text)
    found = errors(load_cell(path))
    assert list(found) == ["bus load"]
    assert found["bus load"].values["load"] == pytest.approx(0.85, abs=0.005)


def test_thirty_joints_on_two_buses_reach_their_pose():
    summary = simulate("snake30").summary
    assert summary["failure"] is None
    assert summary["limit_violations"] == 0
    assert [e["name"] for e in summary["events"]] == ["mode", "lease_granted", "mode"]
    assert summary["tool_error_m"] < 2e-3
    assert summary["tool_error_rad"] < 5e-3
    assert summary["max_speed_ratio"] > 0.1
