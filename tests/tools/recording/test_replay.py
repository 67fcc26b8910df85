"""`telerobot replay`: a recorded run, computed again to the last bit."""

import struct
from pathlib import Path

import msgpack
import numpy as np
import pytest
from mcap.reader import make_reader
from telerobot.config.bundle import to_text
from telerobot.config.load import load_cell
from telerobot.server.recorder import MEMORY, TICK, Stamped, joined, pack, unpack
from telerobot.tools.cli import main
from telerobot.tools.recording.replay import Replay
from telerobot.tools.recording.run_file import read_about, read_cell, read_run
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

STEPS = [
    {"at_s": 0.1, "cmd/joystick": {"twist": [0.03, 0, 0.01, 0, 0, 0.05]}, "for_s": 0.4},
    {
        "at_s": 0.2,
        "cmd/position": {"xyz": [0, 0.05, 0], "rpy": [0, 0, 0], "relative_to": "mrf"},
    },
    {"at_s": 0.7, "operator/mode": {"action": "hold"}},
]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A short run with a stick, a path under way and a verified stop, as a file."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    script = Script.model_validate({"duration_s": 1.0, "step": STEPS})
    Simulation(load_cell("pa10"), script, path).run()
    return path


def rewritten(run: Path, to: Path, change) -> Path:
    """Return a copy of a recording in which `change` was made to the ticks' data, by number."""
    ticks, messages = 0, []
    for message in read_run(run, (TICK, MEMORY)):
        data = message.data
        if message.topic == TICK:
            data, ticks = change(ticks, data), ticks + 1
        if data is not None:
            messages.append(Stamped(message.topic, message.stamp_ns, data))
    to.write_bytes(joined(to_text(read_cell(run)), read_about(run), messages))
    return to


def with_inputs(data: bytes, **changes) -> bytes:
    row = list(msgpack.unpackb(data))
    inputs = unpack(row[5][0])
    inputs.__dict__.update(changes)
    row[5] = [pack(inputs)]
    return msgpack.packb(row)


def test_a_recorded_run_replays_to_the_last_bit(run, capsys):
    assert main(["replay", str(run)]) == 0
    said = capsys.readouterr().out
    assert "all as recorded, to the last bit" in said
    ticks = sum(1 for _ in read_run(run, (TICK,)))
    assert said.startswith(f"{ticks} ticks")


def test_an_input_that_differs_in_its_last_bit_is_found_and_named(run, tmp_path, capsys):
    def change(i, data):
        if i != 60:
            return data
        q = unpack(msgpack.unpackb(data)[5][0]).q_measured.copy()
        q[3] = np.nextafter(q[3], 10.0)
        return with_inputs(data, q_measured=q)

    spoiled = rewritten(run, tmp_path / "spoiled.mcap", change)
    assert main(["replay", str(spoiled)]) == 1
    said = capsys.readouterr().out
    assert "NOT as recorded" in said
    assert "first difference: tick 61, " in said
    assert " q: [" in said


def test_lost_ticks_are_skipped_until_the_next_memory(run, tmp_path):
    lost = rewritten(run, tmp_path / "lost.mcap", lambda i, data: None if 40 <= i < 45 else data)
    replay = Replay(lost, read_cell(lost))
    replayed = [tick.record.number for tick in replay.run()]
    assert replay.judgement.difference is None
    assert replay.judgement.skipped > 0
    assert 39 in replayed
    assert 60 not in replayed


def test_a_file_that_was_cut_off_replays_up_to_there(run, tmp_path, capsys):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(run.read_bytes()[: int(0.8 * run.stat().st_size)])
    assert main(["replay", str(cut)]) == 0
    assert "all as recorded" in capsys.readouterr().out


def test_a_tick_is_explained_stage_by_stage(run, capsys):
    assert main(["replay", str(run), "--until=-0.6", "--explain"]) == 0
    said = capsys.readouterr().out
    for words in ("stick [0.03", "PathGoal", "joystick", "least singular", "verified stop", "sent"):
        assert words in said


@pytest.mark.parametrize("content", [b"", b"no recording", b"\x89MCAP0\r\n"])
def test_what_is_no_recording_is_refused_in_one_line(content, tmp_path, capsys):
    path = tmp_path / "bad.mcap"
    path.write_bytes(content)
    assert main(["replay", str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def sections(run: Path) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """Return where the bodies of a recording's chunks are, and its summary: first and end [B]."""
    with run.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunks = [
        (c.chunk_start_offset, c.chunk_length, c.compressed_size) for c in summary.chunk_indexes
    ]
    bodies = [(start + length - size, start + length) for start, length, size in chunks]
    size = run.stat().st_size
    (summary_start,) = struct.unpack("<Q", run.read_bytes()[size - 28 : size - 20])
    return bodies, (summary_start, size - 40)


def damaged(run: Path, to: Path, parts: list[tuple[int, int]], seed: int) -> Path:
    """Return a copy of a recording with one to three words of four bytes replaced in its parts."""
    draw, data = np.random.default_rng(seed), bytearray(run.read_bytes())
    for _ in range(int(draw.integers(1, 4))):
        first, end = parts[int(draw.integers(len(parts)))]
        at = int(draw.integers(first, end - 4))
        data[at : at + 4] = bytes(byte ^ 0x5A for byte in data[at : at + 4])
    to.write_bytes(data)
    return to


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("command", [["replay"], ["export", "--to=numpy", "--out=OUT"]])
def test_a_recording_whose_ticks_are_damaged_is_refused_in_one_line(
    run, tmp_path, capsys, command, seed
):
    path = damaged(run, tmp_path / "damaged.mcap", sections(run)[0], seed)
    told = [part.replace("OUT", str(tmp_path / "out")) for part in (*command, str(path))]
    assert main(told) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("seed", range(4))
def test_a_recording_whose_index_is_damaged_replays_as_before(run, tmp_path, capsys, seed):
    path = damaged(run, tmp_path / "damaged.mcap", [sections(run)[1]], seed)
    assert main(["replay", str(path)]) == 0
    assert "all as recorded, to the last bit" in capsys.readouterr().out


def test_a_recording_names_no_class_but_the_control_computation_s(run, tmp_path, capsys):
    def change(i, data):
        row = list(msgpack.unpackb(data))
        row[5] = [msgpack.packb([4, "spatial:np.os"])]
        return msgpack.packb(row)

    assert main(["replay", str(rewritten(run, tmp_path / "evil.mcap", change))]) == 2
    assert "no class of this version's control computation" in capsys.readouterr().err
