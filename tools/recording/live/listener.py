"""Sources of a recorder: all topics that it may hear, frames on all buses, pictures in a folder."""

import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Final, NamedTuple

from ....config.load import Cell
from ....drivers.bus import BusErrors, CanBus, open_bus
from ....drivers.device import DeviceError
from ....drivers.network.session import Session, TopicBuffer
from ....protocols import topics as t
from ....protocols.codec import CodecError, decode
from ....protocols.messages.messages import Message
from ....protocols.messages.perception import ScanPoints
from ....protocols.messages.telemetry import Event, RecordedTick, State
from .files import Files
from .viewer import Viewer

DEPTH: Final = 1000
"""Messages of a topic that wait for the recorder: ten seconds of telemetry [1]."""

MOST_FRAMES: Final = 2000
"""CAN frames of a bus that are taken at once [1]."""

SHOWN_EVERY_NS: Final = 30_000_000
"""Joints and frames are written for viewers at most this often [ns]; states always."""

PNG_END: Final = b"IEND\xaeB`\x82"
"""The last bytes of a picture that is written to its end."""


class Ear(NamedTuple):
    """A topic that is listened to."""

    topic: t.Topic
    inbox: TopicBuffer


class CellRecorder:
    """Hears one cell, and writes it to files."""

    def __init__(self, cell: Cell, session: Session, files: Files, pictures: Path | None) -> None:
        """Begin to listen; `notices` tells what cannot be heard."""
        self._files, self._pictures, self._viewer = files, pictures, Viewer(cell)
        # Requests are answered by one: who overhears them would be asked in the daemon's place.
        # What they did is told by events. Video is made for whoever looks at it now; the small
        # pictures are recorded.
        self._ears = [
            Ear(topic, session.subscribe(topic, DEPTH))
            for topic in t.TOPICS
            if not topic.flow.asks and topic is not t.VIDEO and session.may_hear(topic)
        ]
        self._seen: dict[Path, int] = {}
        self._due_ns = 0
        self.heard = 0
        """Messages and frames that were written."""
        self.notices: list[str] = []
        self._buses: list[tuple[int, CanBus]] = []
        for i, bus in enumerate(cell.config.fieldbuses):
            try:
                self._buses.append((i, open_bus(bus)))
            except DeviceError as error:
                self.notices.append(f"its frames are not recorded: {error}")

    def turn(self) -> None:
        """Write what has come by now. Raises `OSError` where it cannot be written."""
        for ear in self._ears:
            for payload in islice(ear.inbox.take(), DEPTH):
                self._message(ear.topic, payload, time.time_ns())
        for i, bus in self._buses:
            self._frames(i, bus)
        if self._pictures is not None:
            for camera, data in self._new_pictures(self._pictures):
                self._files.now.proto(*_stamped(self._viewer, camera, data))
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
        if isinstance(message, ScanPoints):
            file.scan(stamp_ns / 1e9, message.points_mm)
            file.proto(*_at(stamp_ns, self._viewer.of_scan(message, stamp_ns)))
            return
        file.message(NAMES.get(topic.key, topic.key), stamp_ns / 1e9, message)
        for name, shown in self._shown(message, stamp_ns):
            file.proto(name, stamp_ns, shown)

    def _shown(self, message: Message, stamp_ns: int) -> Iterator[tuple[str, object]]:
        if isinstance(message, State):
            if stamp_ns >= self._due_ns:
                self._due_ns = stamp_ns + SHOWN_EVERY_NS
                yield from self._viewer.of_state(message, stamp_ns)
        elif isinstance(message, Event):
            yield self._viewer.of_event(message, stamp_ns)

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
                "tlm/reflection": "reflection", "sensor/contour": "contour"}  # fmt: skip
"""Topics under the names that the recording of a simulation gives them, for `telerobot plot`."""


def _at(stamp_ns: int, shown: tuple[str, object]) -> tuple[str, int, object]:
    return shown[0], stamp_ns, shown[1]


def _stamped(viewer: Viewer, camera: str, data: bytes) -> tuple[str, int, object]:
    stamp_ns = time.time_ns()
    return _at(stamp_ns, viewer.of_picture(camera, data, stamp_ns))
