"""The CAN master of one bus and of several: SYNC, heartbeat, dispatch, and SDO without a thread."""

import logging
import math
import select
import struct
import time
from collections import deque
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Final

import can
import canopen

from ..config.load import Cell
from ..protocols.canopen import can301
from ..protocols.canopen.can301 import FrameError
from .bus import (
    ERROR,
    Frame,
    Hub,
    InProcessBus,
    descriptor_of,
    hear_only,
    open_bus,
    putting,
    taking,
)
from .device import Cause, DeviceError, Trouble

# --- The CAN master on one bus: SYNC, heartbeat, dispatch of frames, and SDO without a thread -----
#
# Cyclic PDOs and heartbeats go to who decodes them, by identifier; emergencies and the SDO replies
# that were asked for go to canopen, whose network is used without its Notifier thread: an SDO
# request pumps the bus until its reply has been handed over, so that canopen finds it in its
# queue. Frames of other identifiers are dropped. Nothing here blocks but SDOs, `wait` and
# `wait_until`.

Handler = Callable[[bytes, float], None]
"""Called with a frame's data and its stamp [s] on the bus' own clock."""
Tap = Callable[[int, bytes], None]
"""Called with identifier and data of every frame that was sent."""

SDO_TIMEOUT_S: Final = 0.3
MOST_LATE: Final = 3
"""Answers that may still come to so many SYNCs before the newest one [1]."""
SYNC_DOUBT_S: Final = 2.5e-4
"""A SYNC that took so much longer to send than others went out nobody knows when [s]."""
_SDO_ABORT: Final = 0x80
_SDO_BYTES: Final = 8
_BUS_OFF: Final = 0x40  # socketcan's error class CAN_ERR_BUSOFF
logging.getLogger("canopen").addHandler(logging.NullHandler())  # its errors are raised to us too
_STATES: Final = frozenset(can301.NmtState)
_OPERATIONAL: Final = bytes((can301.NmtState.OPERATIONAL,))


@cache
def _dictionary(eds: Path | None, node_id: int) -> canopen.ObjectDictionary:
    return canopen.import_od(None if eds is None else str(eds), node_id)


class _Network(canopen.Network):
    """canopen's network on a bus that the fieldbus reads."""

    def __init__(self, fieldbus: "Fieldbus") -> None:
        super().__init__()
        self._fieldbus = fieldbus

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:  # noqa: ARG002  canopen's
        """Send a frame; after an SDO request, wait for the reply. Raises `can.CanError`."""
        self._fieldbus.request(can_id, bytes(data))


class Fieldbus:
    """One CAN bus and this server as its only master (node 127).

    `clock` tells the time [s] that timeouts are measured by: monotonic, or a simulation's.
    `trouble` stays until `clear_trouble`.
    """

    def __init__(
        self,
        bus: can.BusABC,
        clock: Callable[[], float] = time.monotonic,
        name: str = "bus",
    ) -> None:
        self.bus, self.name = bus, name
        self.clock = clock
        self.network: canopen.Network = _Network(self)
        self.taps: list[Tap] = []
        self.trouble: Trouble | None = None
        self.sync_count = 0
        self.sync_s: float | None = None
        """When the newest SYNC went out [s], on `clock`; None when that is not known well."""
        self._sending_s = math.inf
        self.malformed = 0
        self.now = clock()
        """When the frames being dispatched were taken off the bus [s], on `clock`."""
        self._handlers: dict[int, Handler] = {}
        self._answers: dict[int, tuple[int, bytes]] = {}
        """Identifiers of which each SYNC asks for one frame: SYNCs answered, newest answer."""
        self._for_canopen: set[int] = set()
        self._awaited: int | None = None
        """Identifier of the SDO reply that a request waits for."""
        self._masters: set[int] = {
            can301.NMT_ID,
            can301.SYNC_ID,
            can301.heartbeat_id(can301.MASTER_NODE),
        }
        self._put_frame, self._take_frames = putting(bus), taking(bus)
        self._waiting: deque[Frame] = deque()
        self._replies: set[int] = set()
        """Identifiers of the SDO replies of all nodes that are known."""
        self._only_known = False

    def hear_only_known(self) -> None:
        """Drop all that is for nobody here before it waits, now and as nodes are added.

        Where the kernel has the bus, a flood of foreign frames is then none of the daemon's.
        """
        self._only_known = True
        self._set_filter()

    def add_node(
        self, node_id: int, eds: Path | None, on_heartbeat: Callable[[int], None]
    ) -> canopen.RemoteNode:
        """Make a node with these objects known, in place of one with the same id.

        Only we may command it. `on_heartbeat` is told the NMT state in each of its heartbeats.
        """
        node = canopen.RemoteNode(node_id, _dictionary(eds, node_id))
        node.sdo.RESPONSE_TIMEOUT = 0.0  # the reply is there before canopen looks for it
        self.network.add_node(node)
        node.emcy.add_callback(lambda _emcy: _forget(node))
        self._for_canopen.add(can301.emcy_id(node_id))
        self._handlers[can301.heartbeat_id(node_id)] = partial(_heartbeat, on_heartbeat)
        self._masters |= {can301.rpdo1_id(node_id), can301.sdo_request_id(node_id)}
        self._replies.add(can301.sdo_reply_id(node_id))
        self._set_filter()
        return node

    def listen(self, can_id: int, handler: Handler) -> None:
        """Hand frames of an identifier to `handler`, instead of to canopen."""
        self._handlers[can_id] = handler
        self._set_filter()

    def expect_answers(self, can_id: int) -> None:
        """Take one frame of an identifier for each SYNC from now on; another is a second sender's.

        Its values are not taken, and `trouble` tells of it: nobody knows which of the two is true.
        A frame that a bus delivers twice is no such one, nor are late answers to earlier SYNCs.
        """
        self._answers[can_id] = self.sync_count, b""

    def expect_no_answers(self, can_id: int) -> None:
        """Take any number of frames of an identifier again."""
        self._answers.pop(can_id, None)

    def send(self, can_id: int, data: bytes) -> bool:
        """Send a frame without blocking; return whether it went out, else `trouble` says why."""
        try:
            self._put(can_id, data)
        except (can.CanError, OSError) as error:
            self._fail(Cause.BUS_ERROR, f"cannot send {can_id:#05x}: {error}", can_id=can_id)
            return False
        return True

    def sync(self) -> None:
        """Send SYNC, count it and note when (CiA 301, 7.2.5)."""
        before = self.clock()
        if self.send(can301.SYNC_ID, b""):
            self.sync_count += 1
            took_s = self.clock() - before
            self._sending_s = min(self._sending_s, took_s)
            self.sync_s = before if took_s - self._sending_s <= SYNC_DOUBT_S else None

    def heartbeat(self) -> None:
        """Send the master's heartbeat: operational. Called by the tick, so it stops with it."""
        self.send(can301.heartbeat_id(can301.MASTER_NODE), _OPERATIONAL)

    def receive(self, now: float) -> int:
        """Dispatch every frame that is there, without blocking; return how many there were."""
        self.now = now
        frames = [*self._waiting, *self._take(0.0)]
        self._waiting.clear()
        for frame in frames:
            self._dispatch(*frame)
        return len(frames)

    def wait(self, timeout_s: float) -> bool:
        """Block until there may be a frame to receive, or until the timeout [s].

        A buffered bus echoes what we sent, so this may return early: look again.
        """
        if self._waiting:
            return True
        descriptor = self.descriptor
        if descriptor >= 0:
            return bool(select.select([descriptor], [], [], max(0.0, timeout_s))[0])
        self._waiting.extend(self._take(timeout_s))
        return bool(self._waiting)

    @property
    def descriptor(self) -> int:
        """Descriptor to select on, -1 where the interface has none."""
        return descriptor_of(self.bus)

    def wait_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Dispatch frames until `condition` holds; return False if it does not in time [s]."""
        deadline = self.clock() + timeout_s
        while not condition():
            left = deadline - self.clock()
            if not self._waiting and left > 0:
                self._waiting.extend(self._take(left))
            if not self._waiting:
                return condition()
            self.now = self.clock()
            self._dispatch(*self._waiting.popleft())
        return True

    def pause(self, seconds: float) -> None:
        """Dispatch frames for so long [s]."""
        self.wait_until(lambda: False, seconds)

    def request(self, can_id: int, data: bytes) -> None:
        """Send a frame for canopen and, after an SDO request, pump until the reply is in.

        Raises `can.CanError` when it cannot be sent.
        """
        self._put(can_id, data)
        node = can_id - can301.sdo_request_id(0)
        if not 1 <= node <= 127 or data[0] == _SDO_ABORT:
            return
        replies: list[bytes] = []
        reply_id = can301.sdo_reply_id(node)

        def note(_id: int, reply: bytearray, _stamp: float) -> None:
            replies.append(bytes(reply))

        self.network.subscribe(reply_id, note)
        self._awaited = reply_id
        try:
            self.wait_until(lambda: bool(replies), SDO_TIMEOUT_S)
        finally:
            self._awaited = None
            self.network.unsubscribe(reply_id, note)

    def clear_trouble(self) -> None:
        """Forget what was wrong; it is noticed again if it still is."""
        self.trouble = None

    def close(self) -> None:
        """Leave the bus. Never raises."""
        try:
            self.bus.shutdown()
        except (can.CanError, OSError) as error:
            self._fail(Cause.BUS_ERROR, f"cannot close: {error}")

    def _set_filter(self) -> None:
        if self._only_known:
            known = self._masters | self._for_canopen | self._replies | self._handlers.keys()
            hear_only(self.bus, known)

    def _put(self, can_id: int, data: bytes) -> None:
        self._put_frame(can_id, data)
        for tap in self.taps:
            tap(can_id, data)

    def _take(self, timeout_s: float) -> list[Frame]:
        try:
            return self._take_frames(timeout_s)
        except (can.CanError, OSError) as error:
            self._fail(Cause.BUS_ERROR, f"cannot receive: {error}")
            return []

    def _dispatch(self, can_id: int, data: bytes, stamp: float) -> None:
        handler = self._handlers.get(can_id)
        # An interface that does not stamp leaves 0: what goes by instants has to have some.
        stamp = stamp or self.now
        try:
            if handler is not None:
                if can_id not in self._answers or self._asked_for(can_id, data):
                    handler(data, stamp)
            elif can_id & ERROR:
                if can_id & _BUS_OFF:
                    self._fail(Cause.BUS_ERROR, "the controller is off the bus")
            elif can_id in self._masters:
                self._fail(Cause.SECOND_MASTER, f"someone else sent {can_id:#05x}", can_id=can_id)
            elif can_id == self._awaited and len(data) != _SDO_BYTES:
                self.malformed += 1  # canopen would look for more in it
            elif can_id in self._for_canopen or can_id == self._awaited:
                # Of others, canopen queues SDO and LSS replies for ever: nobody asked for them.
                self.network.notify(can_id, bytearray(data), stamp)
        except (FrameError, struct.error, IndexError):
            self.malformed += 1

    def _asked_for(self, can_id: int, data: bytes) -> bool:
        """Return whether a frame answers a SYNC that was not answered before, and note it."""
        answered, newest = self._answers[can_id]
        # A SYNC long ago is not answered any more: its answer was lost.
        answered = max(answered, self.sync_count - 1 - MOST_LATE) + 1
        if answered <= self.sync_count:
            self._answers[can_id] = answered, data
            return True
        if data != newest:
            detail = f"{can_id:#05x} came again after one SYNC, with other data: two send it"
            self._fail(Cause.FOREIGN_PDO, detail, can_id=can_id)
        return False

    def _fail(self, cause: Cause, detail: str, **values: int) -> None:
        if self.trouble is None:
            self.trouble = Trouble(cause, self.name, detail, dict(values))


def _heartbeat(heard: Callable[[int], None], data: bytes, _stamp: float) -> None:
    """Tell the NMT state in a heartbeat (CiA 301, 7.2.8.3.2); raises `FrameError` without one."""
    if not data or data[0] not in _STATES:
        raise FrameError(f"heartbeat: no NMT state: {data!r}")
    heard(data[0])


def _forget(node: canopen.RemoteNode) -> None:
    """Clear the lists in which canopen keeps every emergency of a node."""
    node.emcy.log.clear()
    node.emcy.active.clear()


# --- All CAN buses of a cell as one: SYNC on all at one instant, answers from all -----------------

POLL_S = 5e-4
"""A bus with nothing to select on is looked at so often while another one is waited for [s]."""


class Fieldbuses:
    """The fieldbuses of one cell, in the order of its file."""

    def __init__(self, *fieldbuses: Fieldbus) -> None:
        self._all = fieldbuses

    def __iter__(self) -> Iterator[Fieldbus]:
        return iter(self._all)

    def __getitem__(self, index: int) -> Fieldbus:
        return self._all[index]

    @property
    def trouble(self) -> Trouble | None:
        """The trouble of the first bus that has any."""
        for bus in self._all:
            if bus.trouble is not None:
                return bus.trouble
        return None

    def now(self) -> float:
        """Return the time of the buses' common clock [s]."""
        return self._all[0].clock()

    def sync(self) -> None:
        """Send SYNC on every bus, back to back."""
        for bus in self._all:
            bus.sync()

    def heartbeat(self) -> None:
        """Send the master's heartbeat on every bus."""
        for bus in self._all:
            bus.heartbeat()

    def receive(self, now_s: float) -> None:
        """Dispatch every frame that is there, without blocking."""
        for bus in self._all:
            bus.receive(now_s)

    def wait(self, timeout_s: float) -> None:
        """Block until there may be a frame to receive on any bus, or until the timeout [s]."""
        if len(self._all) == 1:
            self._all[0].wait(timeout_s)
            return
        descriptors = [bus.descriptor for bus in self._all]
        if -1 not in descriptors:
            select.select(descriptors, [], [], max(0.0, timeout_s))
            return
        for bus in self._all:
            if bus.wait(min(timeout_s, POLL_S)):
                return

    def listen(self, seconds: float) -> None:
        """Dispatch what is heard in so long [s], or until there is trouble.

        What has waited counts, and the time for which it could: since a bus was opened, or since
        frames were last taken off it.
        """
        first, *others = self._all
        now_s, end_s = first.clock(), first.now + seconds
        first.receive(now_s)
        first.wait_until(lambda: first.trouble is not None, end_s - now_s)
        for bus in others:  # meanwhile their frames have waited
            bus.receive(bus.clock())

    def clear_trouble(self) -> None:
        """Forget what was wrong; it is noticed again if it still is."""
        for bus in self._all:
            bus.clear_trouble()

    def close(self) -> None:
        """Leave every bus. Never raises."""
        for bus in self._all:
            bus.close()


def open_buses(cell: Cell, clock: Callable[[], float]) -> Fieldbuses:
    """Open the buses of a cell, all or none. Raises `DeviceError` for one that cannot be."""
    buses: list[Fieldbus] = []
    try:
        for config in cell.config.fieldbuses:
            bus = open_bus(config)
            buses.append(Fieldbus(bus, clock, config.label))
    except DeviceError:
        Fieldbuses(*buses).close()
        raise
    return Fieldbuses(*buses)


# --- The CAN buses of a simulated cell: one in-process hub for each, in virtual time --------------

PUMP_STEPS: Final = 500  # a device that is silent for this many physics steps does not answer [1]

Heard = Callable[[int, Frame], None]  # called with the index of the bus and every frame on it


class VirtualBuses:
    """Joins daemon, rig and listeners on every bus.

    `pump` lets virtual time pass while the daemon waits, as it may in BOOT: it is told to run until
    a condition holds, for at most so many physics steps.
    """

    def __init__(
        self,
        cell: Cell,
        clock: Callable[[], float],
        pump: Callable[[Callable[[], bool], int], None],
    ) -> None:
        configs = cell.config.fieldbuses
        self.hubs = tuple(Hub() for _ in configs)
        ours = [InProcessBus(hub) for hub in self.hubs]
        self.of_rig = tuple(InProcessBus(hub) for hub in self.hubs)
        self.of_daemon = Fieldbuses(
            *(Fieldbus(bus, clock, config.label) for bus, config in zip(ours, configs, strict=True))
        )
        for hub, bus in zip(self.hubs, ours, strict=True):
            hub.pump = partial(pump, partial(_has_frames, bus), PUMP_STEPS)

    def listen(self, heard: Heard) -> None:
        """Tell of every frame from now on, whoever sends it."""
        for i, hub in enumerate(self.hubs):
            InProcessBus(hub, partial(heard, i))

    def listen_to_daemon(self, heard: Callable[[int, int, bytes], None]) -> None:
        """Tell index of the bus, identifier and data of every frame that the daemon sends."""
        for i, fieldbus in enumerate(self.of_daemon):
            fieldbus.taps.append(partial(heard, i))

    def set_time(self, time_s: float) -> None:
        """Set the time that frames are stamped with [s]."""
        for hub in self.hubs:
            hub.time_s = time_s

    def close(self) -> None:
        for hub in self.hubs:
            hub.close()


def _has_frames(bus: InProcessBus) -> bool:
    return bus.waiting > 0
