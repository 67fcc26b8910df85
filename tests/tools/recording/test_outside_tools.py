"""A recording as others' tools read it: mcap's own reader, Foxglove's SDK, Rerun."""

import importlib.util
import subprocess
import sys

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from telerobot.config.load import load_cell
from telerobot.tools.recording.live import Viewer
from telerobot.tools.recording.recorder import Recorder
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

START_NS = 1_800_000_000_000_000_000
"""Time of day at which the run began [ns]."""
STEPS = [{"at_s": 0.1, "cmd/joystick": {"twist": [0, 0.1, 0.05, 0, 0, 0.2]}, "for_s": 0.4}]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A simulated run, and a file of it as `telerobot record` writes one."""
    file = tmp_path_factory.mktemp("run") / "run.mcap"
    cell = load_cell("pa10")
    simulation = Simulation(cell, Script.model_validate({"duration_s": 0.6, "step": STEPS}))
    simulation.run()
    recorder, viewer = Recorder(file), Viewer(cell)
    recorder.about(cell)
    for state in simulation.states:
        stamp_ns = START_NS + round(1e9 * state.time_s)
        recorder.message("state", stamp_ns / 1e9, state)
        for topic, message in viewer.of_state(state, stamp_ns):
            recorder.proto(topic, stamp_ns, message)
    for event in simulation.events:
        stamp_ns = START_NS + round(1e9 * event.time_s)
        topic, message = viewer.of_event(event, stamp_ns)
        recorder.proto(topic, stamp_ns, message)
    recorder.close()
    return simulation, file


def messages(file, topic):
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        decoded = reader.iter_decoded_messages(topic)
        return [(message.log_time, read) for _, _, message, read in decoded]


def fields(descriptors):
    """Return name, number, type and label of all fields, by their message's full name."""
    return {
        f"{file.package}.{message.name}": sorted(
            (field.name, field.number, field.type, field.label, field.type_name)
            for field in message.field
        )
        for file in FileDescriptorSet.FromString(descriptors).file
        for message in file.message_type
    }


def test_the_index_of_a_finished_file_leads_mcaps_reader_to_any_time(recorded):
    simulation, file = recorded
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        channels = {channel.topic for channel in reader.get_summary().channels.values()}
        assert channels == {"state", "joint_states", "tf", "log"}
        middle = simulation.states[len(simulation.states) // 2]
        stamp_ns = START_NS + round(1e9 * middle.time_s)
        (found,) = reader.iter_decoded_messages(
            "joint_states", starting_at=stamp_ns, ending_before=stamp_ns + 1
        )
    assert [joint.position for joint in found.decoded_message.joints] == list(middle.q)
    assert found.decoded_message.timestamp.ToNanoseconds() == stamp_ns


@pytest.mark.parametrize("topic", ["joint_states", "tf", "log"])
def test_schemas_are_those_of_foxgloves_sdk(recorded, topic):
    sdk = pytest.importorskip("foxglove.messages", reason="pip install foxglove-sdk")
    with recorded[1].open("rb") as stream:
        summary = make_reader(stream).get_summary()
    (channel,) = (c for c in summary.channels.values() if c.topic == topic)
    ours = summary.schemas[channel.schema_id]
    theirs = getattr(sdk, ours.name.removeprefix("foxglove.")).get_schema()
    assert (ours.name, ours.encoding) == (theirs.name, theirs.encoding)
    written, known = fields(ours.data), fields(theirs.data)
    assert written[ours.name] == known[theirs.name]
    assert written.items() >= {k: v for k, v in known.items() if k.startswith("foxglove.")}.items()


def test_bytes_that_foxgloves_sdk_writes_are_ours(recorded):
    sdk = pytest.importorskip("foxglove.messages", reason="pip install foxglove-sdk")
    stamp_ns, ours = messages(recorded[1], "joint_states")[-1]
    stamp = sdk.Timestamp(stamp_ns // 10**9, stamp_ns % 10**9)
    joints = [
        sdk.JointState(name=j.name, position=j.position, velocity=j.velocity, effort=j.effort)
        for j in ours.joints
    ]
    encoded = sdk.JointStates(timestamp=stamp, joints=joints).encode()
    assert type(ours).FromString(encoded) == ours


def test_rerun_finds_frames_and_log_in_it(recorded, tmp_path):
    if importlib.util.find_spec("rerun_cli") is None:
        pytest.skip("pip install rerun-sdk")

    def rerun(*arguments):
        done = subprocess.run(
            [sys.executable, "-m", "rerun_cli", *map(str, arguments)],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout + done.stderr

    _, file = recorded
    checked = [line.split() for line in rerun("mcap", "check", file).splitlines()]
    assert {row[3] for row in checked if row[:1] == ["ok"]} == {
        "state",
        "joint_states",
        "tf",
        "log",
    }
    rerun("mcap", "convert", file, "-o", tmp_path / "run.rrd")
    told = rerun("rrd", "stats", tmp_path / "run.rrd")
    assert "Transform3D:translation" in told
    assert "TextLog:text" in told
