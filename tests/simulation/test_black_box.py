"""The black box: the ticks before every fault and verified stop, as files that replay."""

import pytest
from telerobot.config.bundle import to_text
from telerobot.server.control.tick import Control
from telerobot.server.recorder import MOST, BlackBox
from telerobot.tools.recording.replay import Replay
from telerobot.tools.recording.run_file import read_about, read_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

HOLD_AND_FAULT = [
    {"at_s": 0.1, "cmd/joystick": {"twist": [0.03, 0, 0.01, 0, 0, 0]}, "for_s": 2.0},
    {"at_s": 0.5, "operator/mode": {"action": "hold"}},
    {"at_s": 1.0, "operator/mode": {"action": "resume"}},
    {"at_s": 1.5, "rig/fault": {"kind": "fault", "target": "e1"}},
]


def flown(cell, folder, steps, seconds):
    script = Script.model_validate({"duration_s": seconds, "step": steps})
    box = BlackBox(folder, cell.config.name, to_text(cell), {})
    simulation = Simulation(cell, script, box=box)
    while not simulation.player.over:
        if simulation.cycle.tick == 0:
            simulation.cycle.boot()
        simulation.step()
        box.close()  # virtual time waits for the disk: what was written is told in the next tick
    simulation.cycle.close()
    return simulation


@pytest.fixture(scope="module")
def flight(pa10, tmp_path_factory):
    folder = tmp_path_factory.mktemp("boxes")
    return flown(pa10, folder, HOLD_AND_FAULT, 2.5), folder


def test_a_stop_and_a_fault_leave_a_file_each_and_say_where(flight):
    simulation, folder = flight
    told = [e.values["path"] for e in simulation.events if e.name == "black_box"]
    assert sorted(map(str, folder.iterdir())) == sorted(told)
    kinds = [read_about(path)["kind"] for path in sorted(folder.iterdir())]
    assert kinds == ["stop", "fault"]


def test_a_black_box_replays_to_the_last_bit_and_goes_beyond_the_fault(flight):
    simulation, folder = flight
    fault = next(e for e in simulation.events if e.name == "fault")
    for path in sorted(folder.iterdir()):
        replay = Replay(path, read_cell(path))
        modes = [(tick.record.time_s, tick.record.mode) for tick in replay.run()]
        assert replay.judgement.difference is None
        assert replay.judgement.ticks > 60
    assert modes[-1][1] == "fault"
    assert modes[-1][0] > fault.time_s + 0.3


def test_ticks_are_packed_for_a_box_or_for_who_taps_them_and_for_nobody_else(pa10):
    simulation = Simulation(pa10, Script.model_validate({"duration_s": 1.0, "step": []}))
    log, taken = simulation.cycle.flight.log, []
    simulation.cycle.boot()
    for _ in range(3):
        simulation.step()
    assert not log.rows
    log.taps.append(taken.append)
    for _ in range(3):
        simulation.step()
    simulation.close()
    assert not log.rows  # they are a box's
    assert [row.memory is not None for row in taken] == [True, False, False]


def test_the_tick_that_raised_is_the_last_one_in_the_box(pa10, tmp_path, monkeypatch):
    whole, ticks = Control.tick, []

    def tick(self, memory, inputs):
        ticks.append(inputs)
        if len(ticks) == 60:
            raise ArithmeticError("for this test")
        return whole(self, memory, inputs)

    monkeypatch.setattr(Control, "tick", tick)
    simulation = flown(pa10, tmp_path, [], 1.0)
    assert "tick_raised" in [e.name for e in simulation.events]
    monkeypatch.undo()
    (path,) = (p for p in tmp_path.iterdir() if p.stem.endswith("fault"))
    replay = Replay(path, read_cell(path))
    differing = [tick for tick in replay.run() if tick.difference is not None]
    assert [tick.difference for tick in differing] == [
        "it raised when it was recorded, and does not here"
    ]


def test_a_folder_that_takes_no_file_is_one_event_and_the_arm_goes_on(pa10, tmp_path):
    folder = tmp_path / "file"
    folder.write_text("in the way")
    simulation = flown(pa10, folder, HOLD_AND_FAULT[:3], 2.0)
    assert [e.name for e in simulation.events].count("black_box_failed") == 1
    assert simulation.cycle.mode == "enabled"


def test_old_files_make_room_for_new_ones_of_their_kind(flight, tmp_path):
    simulation, _ = flight
    rows = tuple(simulation.cycle.flight.log.rows)[:1]
    times = iter(range(10**18, 2 * 10**18, 10**9))
    box = BlackBox(tmp_path, "pa10", "{}", {}, lambda: next(times))
    for kind in ["fault"] + ["stop"] * (MOST + 3):
        assert box.write(kind, rows)
        box.close()
    names = sorted(p.name for p in tmp_path.iterdir())
    assert len(names) == 1 + MOST
    assert sum("fault" in name for name in names) == 1
