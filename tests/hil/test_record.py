"""A recorder beside a daemon: what it wrote is read by others' tools, and replays."""

import resource
import signal
import subprocess
import sys
from contextlib import suppress

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory
from telerobot.tools.host.address import options
from telerobot.tools.host.local_plant import CLI
from telerobot.tools.recording.replay import Replay
from telerobot.tools.recording.run_file import read_cell, read_run

SMALL = 300_000
"""A disk that is full after so many bytes [B]."""


def full_disk():
    resource.setrlimit(resource.RLIMIT_FSIZE, (SMALL, SMALL))


def recorder(plant, folder, preexec=None):
    child = subprocess.Popen(
        [sys.executable, "-m", CLI, "record", *options(plant.cell), f"--out={folder}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=preexec,  # noqa: PLW1509  one system call, takes no lock
    )
    assert "recording to" in child.stdout.readline()
    return child


def decoded(path, topic):
    """Return the protobuf messages of a topic, decoded by the schema in the file alone."""
    schemas, channels, found = {}, {}, []
    with path.open("rb") as file, suppress(EndOfFile):  # it was cut off
        for record in StreamReader(file).records:
            kind = type(record).__name__
            if kind == "Schema":
                schemas[record.id] = record
            elif kind == "Channel":
                channels[record.id] = record
            elif kind == "Message" and channels[record.channel_id].topic == topic:
                schema = schemas[channels[record.channel_id].schema_id]
                decode = DecoderFactory().decoder_for("protobuf", schema)
                found.append((schema.name, decode(record.data)))
    return found


@pytest.mark.hil
def test_a_recorder_that_is_killed_leaves_a_run_that_others_read_and_that_replays(
    make_plant, tmp_path
):
    plant = make_plant("pa10")
    operator = plant.operator()
    child, limited = recorder(plant, tmp_path / "run"), None
    try:
        limited = recorder(plant, tmp_path / "full", full_disk)
        plant.turn()  # a recorder takes a while to begin
        operator.acquire()
        operator.enable()
        plant.turn()
        start = plant.truth.pose_mrf[2]
        operator.joystick([0.0, 0.0, 0.03, 0.0, 0.0, 0.0], expressed_in="world")
        rises = lambda: plant.truth.pose_mrf[2] > start + 0.05  # noqa: E731
        plant.until(rises, 8.0, "the arm does not rise")
        plant.until(lambda: limited.poll() is not None, 20.0, "the disk is not full")
        assert operator.state.mode == "enabled"
        assert limited.returncode == 1
        assert limited.stderr.read().count("recording ended") == 1
    finally:
        for each in (child, limited):
            if each is not None:
                each.send_signal(signal.SIGKILL)  # nothing, to one that has ended
                each.communicate()
    (path,) = (tmp_path / "run").iterdir()
    replay = Replay(path, read_cell(path))
    moved = [tick.outputs[0].q for tick in replay.run()]
    assert replay.judgement.difference is None
    assert replay.judgement.ticks > 100
    assert np.abs(moved[-1] - moved[0]).max() > 0.02
    assert {0x080, 0x181, 0x201} <= {m.json()["id"] for m in read_run(path, ("can",))}
    topics = {message.topic for message in read_run(path)}
    assert {"state", "event", "truth", "tlm/description"} <= topics
    sticks = [tick.inputs[0].stick for tick in Replay(path, read_cell(path)).run()]
    assert any(stick is not None for stick in sticks)  # who commands is heard by the daemon alone
    joints = decoded(path, "joint_states")
    assert joints[0][0] == "foxglove.JointStates"
    assert [joint.name for joint in joints[0][1].joints] == list(plant.cell.joints)
    frames = decoded(path, "tf")
    assert frames[0][0] == "foxglove.FrameTransforms"
    tool = next(t for t in frames[-1][1].transforms if t.child_frame_id == "MRF")
    assert tool.translation.z > start + 0.03
    assert "foxglove.Log" in {name for name, _ in decoded(path, "log")}
