"""`telerobot record`: all that a running cell says and does, for viewers and for replay."""

import argparse
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...config.load import Cell, ConfigError
from ...drivers.bus import BusErrors, CanBus, open_bus
from ...drivers.device import DeviceError
from ...drivers.network.identity import identity_of
from ...drivers.network.sensor_session import dial
from ...drivers.network.session import Session
from ...protocols import topics as t
from ...protocols.codec import CodecError, decode
from ...protocols.messages.perception import ScanPoints
from ...protocols.messages.telemetry import Event, RecordedTick, State
from ...protocols.topics import Role
from ...server.control.forest import Forest
from ...server.control.spatial import Pose
from ..host.address import cell_from
from ..host.local_plant import until_told
from ..operator.web.scene import seven
from .recorder import Recorder


# --- The files of one recording: a new one when the last is large, each with the whole cell in it
class Files:
    """Recorders one after the other: `STEM_0000.mcap`, `STEM_0001.mcap`, …"""

    def __init__(self, folder: Path, stem: str, cell: Cell, largest: int) -> None:
        """Open the first; a file that has `largest` bytes is the last but one.

        Raises `OSError`.
        """
        self._folder, self._stem, self._cell, self._largest = folder, stem, cell, largest
        self._number = 0
        folder.mkdir(parents=True, exist_ok=True)
        self.now = self._next()  # the recorder to write to

    def turn(self) -> None:
        """Hand what is written to the system, and begin a new file when it is time.

        Raises `OSError`, as for a disk that is full.
        """
        self.now.flush()
        if self.now.size >= self._largest:
            self.now.close()
            self.now = self._next()

    def close(self) -> None:
        """Finish the last one. Raises `OSError`."""
        self.now.close()

    def _next(self) -> Recorder:
        recorder = Recorder(self._folder / f"{self._stem}_{self._number:04d}.mcap")
        recorder.about(self._cell, part=str(self._number))
        self._number += 1
        return recorder


# --- A running cell in the schemas that Foxglove, PlotJuggler and Rerun know: Foxglove's protobuf
#
# Frames are those of the URDF's links, `World`, and the MRF; with several arms a link's name
# begins with its mechanism's.
WORLD: Final = "World"
LEVELS: Final = {"info": "INFO", "warning": "WARNING", "error": "ERROR"}
"""Foxglove's levels of a log line, by an event's severity."""


def require_schemas() -> None:
    """Raise `ConfigError` where Foxglove's schemas are not installed."""
    if find_spec("foxglove_schemas_protobuf") is None:
        raise ConfigError("recording needs Foxglove's schemas: pip install 'telerobot[record]'")


class Viewer:
    """Turns what a cell tells into messages for viewers."""

    def __init__(self, cell: Cell) -> None:
        """Build it. Raises `ConfigError` where the schemas are missing."""
        require_schemas()
        self._cell = cell
        forest = Forest(cell)
        self._branches = list(zip(forest.branches, forest.bases, strict=True))
        self._tasks = [part.task for part in cell.parts]

    def of_state(self, state: State, stamp_ns: int) -> Iterator[tuple[str, Any]]:
        """Yield topic and message of a state: joints and frames."""
        yield "joint_states", self._joints(state, stamp_ns)
        yield "tf", self._frames(state, stamp_ns)

    def of_event(self, event: Event, stamp_ns: int) -> tuple[str, Any]:
        """Return topic and message of an event: a line of a log."""
        from foxglove_schemas_protobuf.Log_pb2 import Log

        words = f"{event.name}: {event.detail}" if event.detail else event.name
        log = Log(
            level=Log.Level.Value(LEVELS[event.severity]),
            message=words,
            name=self._cell.config.name,
        )
        log.timestamp.FromNanoseconds(stamp_ns)
        return "log", log

    def of_picture(self, camera: str, data: bytes, stamp_ns: int) -> tuple[str, Any]:
        """Return topic and message of a PNG picture of a camera."""
        from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

        image = CompressedImage(frame_id=camera, data=data, format="png")
        image.timestamp.FromNanoseconds(stamp_ns)
        return f"pictures/{camera}", image

    def of_scan(self, scan: ScanPoints, stamp_ns: int) -> tuple[str, Any]:
        """Return topic and message of a laser scan's points: a cloud in World."""
        from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
        from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

        points = np.frombuffer(scan.points_mm, "<i4").reshape(-1, 3)
        cloud = PointCloud(
            frame_id=WORLD,
            point_stride=12,
            fields=[
                PackedElementField(name=axis, offset=4 * i, type=PackedElementField.FLOAT32)
                for i, axis in enumerate("xyz")
            ],
            data=(1e-3 * points).astype("<f4").tobytes(),
        )
        cloud.pose.orientation.w = 1.0
        cloud.timestamp.FromNanoseconds(stamp_ns)
        return "points", cloud

    def _joints(self, state: State, stamp_ns: int) -> Any:
        from foxglove_schemas_protobuf.JointState_pb2 import JointState
        from foxglove_schemas_protobuf.JointStates_pb2 import JointStates

        rates = state.dq_command
        joints = [
            JointState(name=name, position=q, velocity=dq, effort=tau)
            for name, q, dq, tau in zip(self._cell.joints, state.q, rates, state.tau, strict=True)
        ]
        message = JointStates(joints=joints)
        message.timestamp.FromNanoseconds(stamp_ns)
        return message

    def _frames(self, state: State, stamp_ns: int) -> Any:
        from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
        from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

        found, first = [], 0
        for task, (branch, standing) in zip(self._tasks, self._branches, strict=True):
            q = np.array(state.q[first : first + branch.n])
            first += branch.n
            base = state.of(task).frames.get("base")
            T_world_base = standing if base is None else _pose(base)
            for name, T in branch.links(q).items():
                found.append((f"{branch.prefix}{name}", T_world_base @ T))
        found.append(("MRF", _pose(state.pose_mrf_measured)))
        message = FrameTransforms()
        for name, T in found:
            transform = FrameTransform(parent_frame_id=WORLD, child_frame_id=name)
            transform.timestamp.FromNanoseconds(stamp_ns)
            place, turn = transform.translation, transform.rotation
            x, y, z, *rpy = T.to_xyz_rpy()
            place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = seven((x, y, z), rpy)
            message.transforms.append(transform)
        return message


def _pose(six: tuple[float, ...]) -> Pose:
    return Pose.from_xyz_rpy(six[:3], six[3:])


def picture_in(data: bytes) -> bytes:
    """Return the PNG of a recorded picture. Raises `ConfigError` where the schemas are missing."""
    require_schemas()
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    picture: bytes = CompressedImage.FromString(data).data
    return picture


# --- Sources of a recorder: all topics that it may hear, frames on all buses, pictures in a folder
DEPTH: Final = 1000  # messages of a topic that wait for the recorder: ten seconds of telemetry [1]

MOST_FRAMES: Final = 2000  # CAN frames of a bus that are taken at once [1]

SHOWN_EVERY_NS: Final = 30_000_000
"""Joints and frames are written for viewers at most this often [ns]; states always."""

PNG_END: Final = b"IEND\xaeB`\x82"  # the last bytes of a picture that is written to its end


class CellRecorder:
    """Hears one cell, and writes it to files."""

    def __init__(self, cell: Cell, session: Session, files: Files, pictures: Path | None) -> None:
        """Begin to listen; `notices` tells what cannot be heard."""
        self._files, self._pictures, self._viewer = files, pictures, Viewer(cell)
        # Requests are answered by one: who overhears them would be asked in the daemon's place.
        # What they did is told by events. Video is made for whoever looks at it now; the small
        # pictures are recorded. Obstacles are those that the daemon holds: what anybody put on the
        # sensors' key, it may have refused.
        self._ears = [
            (topic, session.subscribe(topic, DEPTH))
            for topic in t.TOPICS
            if not topic.flow.asks
            and topic not in (t.VIDEO, t.OBSTACLE)
            and session.may_hear(topic)
        ]
        self._seen: dict[Path, int] = {}
        self._due_ns = 0
        self.heard = 0  # messages and frames that were written
        self.notices: list[str] = []
        self._buses: list[tuple[int, CanBus]] = []
        for i, bus in enumerate(cell.config.fieldbuses):
            try:
                self._buses.append((i, open_bus(bus)))
            except DeviceError as error:
                self.notices.append(f"its frames are not recorded: {error}")

    def turn(self) -> None:
        """Write what has come by now. Raises `OSError` where it cannot be written."""
        for topic, inbox in self._ears:
            for payload in islice(inbox.take(), DEPTH):
                self._message(topic, payload, time.time_ns())
        for i, bus in self._buses:
            self._frames(i, bus)
        if self._pictures is not None:
            for camera, data in self._new_pictures(self._pictures):
                stamp_ns = time.time_ns()
                name, image = self._viewer.of_picture(camera, data, stamp_ns)
                self._files.now.proto(name, stamp_ns, image)
                self.heard += 1
        self._files.turn()

    def close(self) -> None:
        """Leave the buses, and finish the file. Raises `OSError`."""
        for _, bus in self._buses:
            bus.shutdown()
        self._files.close()

    def _message(self, topic: t.Topic, payload: bytes, stamp_ns: int) -> None:
        try:
            message = decode(topic, payload)
        except CodecError:
            return  # the daemon refuses it, and tells so by an event
        self.heard += 1
        file = self._files.now
        if isinstance(message, RecordedTick):
            file.ticks(message.stamp_ns, message.data, message.memory)
            return
        shown: Iterable[tuple[str, Any]] = ()
        if isinstance(message, ScanPoints):
            file.scan(stamp_ns / 1e9, message.points_mm)
            shown = (self._viewer.of_scan(message, stamp_ns),)
        else:
            file.message(NAMES.get(topic.key, topic.key), stamp_ns / 1e9, message)
        if isinstance(message, Event):
            shown = (self._viewer.of_event(message, stamp_ns),)
        elif isinstance(message, State) and stamp_ns >= self._due_ns:
            self._due_ns = stamp_ns + SHOWN_EVERY_NS
            shown = self._viewer.of_state(message, stamp_ns)
        for name, each in shown:
            file.proto(name, stamp_ns, each)

    def _frames(self, i: int, bus: CanBus) -> None:
        for _ in range(MOST_FRAMES):
            try:
                message = bus.recv(0)
            except BusErrors:
                return  # it is down: the daemon tells of it, and it may come back
            if message is None:
                return
            self.heard += 1
            self._files.now.frame(
                message.timestamp, message.arbitration_id, bytes(message.data), sent=False, bus=i
            )

    def _new_pictures(self, folder: Path) -> Iterator[tuple[str, bytes]]:
        """Yield camera and bytes of PNG files that are new, as `telerobot vision` writes them."""
        for path in folder.glob("*.png"):
            try:
                stamp, data = path.stat().st_mtime_ns, b""
                if self._seen.get(path) != stamp:
                    data = path.read_bytes()
            except OSError:
                continue  # it was just replaced
            if data.endswith(PNG_END):
                self._seen[path] = stamp
                yield path.stem, data


NAMES: Final = {"tlm/state": "state", "tlm/event": "event", "rig/truth": "truth",
                "tlm/reflection": "reflection", "tlm/obstacle": "obstacle",
                "sensor/contour": "contour"}  # fmt: skip
"""Topics under the names that the recording of a simulation gives them, for `telerobot plot`."""


# --- `telerobot record CELL`: a running cell as MCAP files, by a process of its own ---------------
POLL_S: Final = 0.01


def run(args: argparse.Namespace) -> int:
    """Record until told to end. Raises `ConfigError`, `OSError` for a folder that takes no file."""
    require_schemas()
    cell = cell_from(args)
    identity = identity_of(cell, Role.OBSERVER, "recorder")
    over = until_told(args.seconds)
    stem = f"{cell.config.name}_{datetime.now(UTC).strftime('%Y%m%dT%H%M%SZ')}"
    files = Files(args.out, stem, cell, round(args.split * 1e6))
    session = dial(cell, identity, over)
    if session is None:
        files.close()
        return 0
    try:
        return record(CellRecorder(cell, session, files, args.pictures), files, over)
    finally:
        session.close()


def record(listener: CellRecorder, files: Files, over: Callable[[], bool]) -> int:
    """Write what is heard until it is over; return 1 where it could not be written any more."""
    for notice in listener.notices:
        print(f"telerobot: {notice}", file=sys.stderr, flush=True)
    print(f"telerobot: recording to {files.now.path}", flush=True)
    try:
        while not over():
            listener.turn()
            time.sleep(POLL_S)
        listener.turn()
        listener.close()
    except OSError as error:
        print(f"telerobot: recording ended: {files.now.path}: {error.strerror}", file=sys.stderr)
        return 1
    print(f"{listener.heard} messages and frames, the last to {files.now.path}")
    return 0
