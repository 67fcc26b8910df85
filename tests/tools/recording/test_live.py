"""A recorder of a running cell, told by a session of the test's own."""

import can
import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from pydantic import ValidationError
from telerobot.config.load import load_cell
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages.perception import ContourNews, ObstacleNews, ScanPoints
from telerobot.server.perception.scanning.scanning import Looked
from telerobot.tools.recording import live as listener
from telerobot.tools.recording.live import CellRecorder, Files
from telerobot.tools.recording.run_file import read_run

POINTS = np.array([[1.0, -2.5, 0.25], [np.nan] * 3, [100.0, 0.0, -0.001]])


class Inbox:
    def __init__(self, payloads):
        self._payloads = payloads

    def take(self):
        while self._payloads:
            yield self._payloads.pop(0)


class Session:
    """Gives each topic's payloads once."""

    def __init__(self, **told):
        self._told = told

    def may_hear(self, topic):
        return topic.flow is not t.Flow.COMMAND

    def subscribe(self, topic, depth):
        return Inbox(self._told.get(topic.key.replace("/", "_"), []))


class DownBus:
    """An interface that is down."""

    def recv(self, timeout):
        raise can.CanOperationError("Network is down")

    def shutdown(self):
        pass


@pytest.fixture
def record(tmp_path, monkeypatch):
    """Return what records what a session tells of the rover at the bridge."""
    monkeypatch.setattr(listener, "open_bus", lambda _bus: DownBus())
    cell = load_cell("rover_bridge")

    def run(**told):
        files = Files(tmp_path, "run", cell, 10**9)
        recorder = CellRecorder(cell, Session(**told), files, None)
        recorder.turn()
        recorder.turn()
        recorder.close()
        return recorder, files.now

    return run


def contour():
    cells = np.array([1500, 0xFFFF], "<u2").tobytes()
    return ContourNews(tick=7, rows=1, columns=2, cell=0.1, nearest_mm=cells, phase="clear")


def test_a_scans_points_and_its_contour_are_recorded_as_a_simulation_does(record, tmp_path):
    points_mm = Looked(0, None, POINTS, None).points_mm
    scan = ScanPoints(tick=7, points_mm=points_mm)
    recorder, _ = record(view_scan=[encode(scan)], sensor_contour=[encode(contour())])
    (file,) = tmp_path.glob("*.mcap")
    rows = {message.topic: message for message in read_run(file)}
    assert rows.keys() == {"scan", "points", "contour"}
    assert recorder.heard == 2
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        ((schema, _, _, cloud),) = reader.iter_decoded_messages("points")
    assert schema.name == "foxglove.PointCloud"
    assert FileDescriptorSet.FromString(schema.data).file
    seen = np.frombuffer(cloud.data, "<f4").reshape(-1, 3)
    np.testing.assert_allclose(seen, POINTS[[0, 2]], atol=1e-6)
    assert cloud.frame_id == "World"


def test_an_obstacle_is_recorded_as_the_daemon_holds_it_and_not_as_anybody_told_it(
    record, tmp_path
):
    held = ObstacleNews(name="crate", tick=7, shape="point", xyz=(1.0, 0.0, 0.0))
    stolen = held.model_copy(update={"xyz": (5.0, 0.0, 0.0)})
    record(tlm_obstacle=[encode(held)], sensor_obstacle=[encode(stolen)])
    (file,) = tmp_path.glob("*.mcap")
    ((topic, row),) = [(message.topic, message.json()) for message in read_run(file)]
    assert (topic, row["name"], row["xyz"]) == ("obstacle", "crate", [1.0, 0.0, 0.0])


def test_a_bus_that_is_down_ends_no_recording(record, tmp_path):
    recorder, _ = record(sensor_contour=[encode(contour())])
    assert recorder.heard == 1
    assert recorder.notices == []


def test_points_that_are_none_are_refused():
    with pytest.raises(ValidationError, match="12 for each point"):
        ScanPoints(tick=1, points_mm=b"123")
