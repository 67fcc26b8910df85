"""CAN buses as python-can sees them, and the two of ours that need no hardware.

`loopback` carries frames between processes as UDP multicast that cannot leave this machine;
`in_process` carries them between objects, in virtual time. Everything else is python-can's.
"""

import contextlib
import ctypes
import os
import select
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Collection
from functools import cache, partial
from pathlib import Path
from typing import Any, Final, TypeGuard

import can
import msgpack
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.udp_multicast import UdpMulticastBus

from ..config.schema.bus import BusSection
from .device import DeviceError

CanMessage = can.Message
"""A CAN frame as it comes from a bus."""
CanBus = can.BusABC
"""A CAN bus that is open."""
Frame = tuple[int, bytes, float]
"""Identifier, with linux/can.h's flags of what is no standard data frame; data; stamp [s]."""
EXTENDED, REMOTE, ERROR = 1 << 31, 1 << 30, 1 << 29
BusErrors = (can.CanError, OSError)
"""Errors of a bus that is not there now, as of an interface that is down."""

_LOOPBACK: Final = "127.0.0.1"
_IP_MULTICAST_ALL: Final = 49  # linux/in.h; Python has no name for it
_SO_TIMESTAMPNS: Final = 35  # asm-generic/socket.h
_SO_ATTACH_FILTER: Final = 26
_BPF: Final = struct.Struct("=HBBI")
"""An instruction of the kernel's packet filter (linux/filter.h): code, jumps if so, if not, k."""
_MOST_AT_ONCE: Final = 1000
"""Of the frames that wait so many are taken at once [1], and those behind them the next time."""
_TIMESPEC: Final = struct.Struct("@ll")
_ANCILLARY: Final = socket.CMSG_SPACE(_TIMESPEC.size)
_CAN_FRAME: Final = struct.Struct("=IB3x8s")
"""A frame of a kernel's bus (linux/can.h): identifier with flags, length, data."""
_LARGEST_DATAGRAM: Final = 1024
_RECEIVE_BUFFER: Final = 1 << 20
STANDARD: Final = 0x7FF
_KEY: Final = 45
"""So many bytes of a datagram hold identifier and length, and no data [1]."""
_UNKNOWN: Final = (0, b"", 0)
_MALFORMED: Final = (
    ValueError, TypeError, AttributeError, OverflowError, msgpack.UnpackException,
)  # fmt: skip


class LoopbackBus(UdpMulticastBus):
    """Classic CAN between the processes of one machine: python-can's UDP bus, pinned to loopback.

    Nothing leaves the machine: group, sender and receiver are on 127.0.0.1, with hop limit 0. The
    kernel drops the sender's own echo by its source port: it wakes nobody up, and a foreign frame
    with equal content is still seen. Stamps are the kernel's, in seconds. Datagrams that are no
    classic CAN frame are ignored and counted in `malformed`. `put` and `take` are the quick way:
    they make no object of a frame, and look into a standard one only when its head is new.
    """

    def __init__(self, channel: str, port: int) -> None:
        can.BusABC.__init__(self, channel)
        self._can_protocol = can.CanProtocol.CAN_20
        self.channel_info = f"loopback {channel}:{port}"
        self.malformed = 0
        self._known: dict[bytes, tuple[int, bytes, int]] = {}
        """Of standard data frames that came: identifier, what stands before the data, all bytes."""
        self._unread: deque[Frame] = deque()
        """Frames that were taken, and wait for `recv`."""
        self.receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._pin(channel, port)
        except OSError as error:
            self.shutdown()
            raise can.CanInitializationError(f"{self.channel_info}: {error}") from error

    def _pin(self, channel: str, port: int) -> None:
        interface = socket.inet_aton(_LOOPBACK)
        receiver, sender = self.receiver, self.sender
        receiver.setblocking(False)
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        receiver.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        receiver.bind((channel, port))
        membership = socket.inet_aton(channel) + interface
        receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        receiver.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        sender.bind((_LOOPBACK, 0))
        sender.connect((channel, port))
        self._own: tuple[str, int] = sender.getsockname()
        with contextlib.suppress(OSError):  # a kernel without it: `take` drops echoes
            _drop_from(receiver, self._own[1])

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame to every other member. Raises `can.CanOperationError`."""
        if msg.is_fd:
            raise can.CanOperationError("this bus carries classic CAN only")
        if timeout != self.sender.gettimeout():
            self.sender.settimeout(timeout)
        try:
            self.sender.send(_packed(msg))
        except OSError as error:
            raise can.CanOperationError(f"{self.channel_info}: {error}") from error

    def put(self, can_id: int, data: bytes) -> None:
        """Send a standard data frame. Raises `can.CanOperationError`."""
        try:
            self.sender.send(_head(can_id, len(data)) + data)
        except OSError as error:
            raise can.CanOperationError(f"{self.channel_info}: {error}") from error

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame, None when none came in time [s].

        Raises `can.CanOperationError`. Without filters nothing is looked at twice.
        """
        return super().recv(timeout) if self._filters else self._recv_internal(timeout)[0]

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._unread:
            self._unread.extend(self.take(timeout))
        return message_of(*self._unread.popleft()) if self._unread else None, False

    def take(self, timeout: float | None = 0.0) -> list[Frame]:
        """Return the frames that wait, as `recv` does each.

        The first one is waited for until a timeout [s], None for as long as it takes.
        """
        if self._unread:
            frames = [*self._unread]
            self._unread.clear()
            return frames
        deadline_s = None if timeout is None else time.monotonic() + timeout
        try:
            while packets := _packets(self.receiver, _LARGEST_DATAGRAM, deadline_s):
                frames = []
                for data, stamp, source in packets:
                    if source == self._own:
                        continue
                    can_id, head, size = self._known.get(data[:_KEY], _UNKNOWN)
                    if size == len(data) and data.startswith(head):
                        frames.append((can_id, data[len(head) :], stamp))
                    elif (frame := self._read(data, stamp)) is not None:
                        frames.append(frame)
                if frames:
                    return frames
        except OSError as error:
            raise can.CanOperationError(f"{self.channel_info}: {error}") from error
        return []

    def _read(self, data: bytes, stamp: float) -> Frame | None:
        try:
            message = can.Message(check=True, **{**msgpack.unpackb(data), "timestamp": stamp})
        except _MALFORMED:
            self.malformed += 1
            return None
        if message.is_fd or type(message.arbitration_id) is not int:
            self.malformed += 1
            return None
        frame = can_id, content, _ = frame_of(message)
        if can_id <= STANDARD and data.startswith(head := _head(can_id, len(content))):
            self._known[data[:_KEY]] = can_id, head, len(data)
        return frame

    def fileno(self) -> int:
        """Return the descriptor that becomes readable when a frame came."""
        return self.receiver.fileno()

    def shutdown(self) -> None:
        """Leave the bus."""
        can.BusABC.shutdown(self)
        self.receiver.close()
        self.sender.close()


def _packed(message: can.Message) -> bytes:
    """Return the datagram of a frame: python-can's fields, without those that have its defaults."""
    fields = {
        "arbitration_id": message.arbitration_id,
        "is_extended_id": message.is_extended_id,
        "dlc": message.dlc,
        "data": message.data,
    }
    if message.is_remote_frame or message.is_error_frame:
        fields["is_remote_frame"] = message.is_remote_frame
        fields["is_error_frame"] = message.is_error_frame
    packed: bytes = msgpack.packb(fields)
    return packed


@cache
def _head(can_id: int, dlc: int) -> bytes:
    """Return what stands before the data in the datagram of a standard data frame."""
    packed = _packed(can.Message(arbitration_id=can_id, is_extended_id=False, data=bytes(dlc)))
    return packed[: len(packed) - dlc]


def message_of(can_id: int, data: bytes, stamp: float) -> can.Message:
    """Return a frame as python-can has it."""
    remote = bool(can_id & REMOTE)
    return can.Message(
        stamp,
        can_id & ~(EXTENDED | REMOTE | ERROR),
        is_extended_id=bool(can_id & EXTENDED),
        is_remote_frame=remote,
        is_error_frame=bool(can_id & ERROR),
        dlc=len(data),
        data=None if remote else data,
    )


def frame_of(message: can.Message) -> Frame:
    """Return a frame of python-can's."""
    can_id, data = message.arbitration_id, bytes(message.data)
    if message.is_extended_id or message.is_remote_frame or message.is_error_frame:
        can_id |= EXTENDED * message.is_extended_id | ERROR * message.is_error_frame
        if message.is_remote_frame:
            can_id, data = can_id | REMOTE, bytes(message.dlc)
    return can_id, data, message.timestamp


def putting(bus: can.BusABC) -> Callable[[int, bytes], None]:
    """Return what sends standard data frames on a bus."""
    if isinstance(bus, LoopbackBus | InProcessBus):
        return bus.put
    if _is_classic(bus):
        return partial(put_by_kernel, bus.socket)
    return lambda can_id, data: bus.send(message_of(can_id, data, 0.0))


def taking(bus: can.BusABC) -> Callable[[float], list[Frame]]:
    """Return what takes the frames that wait on a bus; for the first one it waits so long [s]."""
    if isinstance(bus, LoopbackBus | InProcessBus):
        return bus.take
    if _is_classic(bus):
        return partial(take_from_kernel, bus.socket)

    def take(timeout: float) -> list[Frame]:
        frames, message = [], bus.recv(timeout)
        while message is not None:
            frames.append(frame_of(message))
            message = bus.recv(0.0) if len(frames) < _MOST_AT_ONCE else None
        return frames

    return take


# --- Frames of a kernel's bus as they are: python-can's own way makes an object of each, and asks
# --- the kernel twice


def _is_classic(bus: can.BusABC) -> TypeGuard[SocketcanBus]:
    return isinstance(bus, SocketcanBus) and bus.protocol is can.CanProtocol.CAN_20


def put_by_kernel(sender: socket.socket, can_id: int, data: bytes) -> None:
    """Send a frame without waiting. Raises `can.CanOperationError`."""
    try:
        sender.send(_CAN_FRAME.pack(can_id, len(data), data), socket.MSG_DONTWAIT)
    except OSError as error:
        raise can.CanOperationError(f"cannot send: {error.strerror}", error.errno) from error


def take_from_kernel(receiver: socket.socket, timeout: float) -> list[Frame]:
    """Return the frames that wait; for the first one it waits so long [s].

    Raises `can.CanOperationError`.
    """
    frames = []
    try:
        deadline_s = time.monotonic() + timeout
        for packet, stamp, _ in _packets(receiver, _CAN_FRAME.size, deadline_s):
            can_id, length, data = _CAN_FRAME.unpack(packet)
            frames.append((can_id, data[:length], stamp))
    except OSError as error:
        raise can.CanOperationError(f"cannot receive: {error.strerror}", error.errno) from error
    return frames


def _packets(
    receiver: socket.socket, size: int, deadline_s: float | None
) -> list[tuple[bytes, float, Any]]:
    """Return what waits at a socket: bytes, the kernel's stamp [s], 0 without, and the sender.

    The first packet is waited for until a deadline [s], None for as long as it takes. Raises
    `OSError`.
    """
    packets: list[tuple[bytes, float, Any]] = []
    while len(packets) < _MOST_AT_ONCE:
        try:
            data, told, _, source = receiver.recvmsg(size, _ANCILLARY, socket.MSG_DONTWAIT)
        except BlockingIOError:
            left = None if deadline_s is None else deadline_s - time.monotonic()
            if packets or (left is not None and left <= 0):
                break
            select.select([receiver], [], [], left)
            continue
        seconds, nanoseconds = _TIMESPEC.unpack_from(told[0][2]) if told else (0, 0)
        packets.append((data, seconds + nanoseconds * 1e-9, source))
    return packets


def _drop_from(receiver: socket.socket, port: int) -> None:
    """Let the kernel drop what comes from a UDP port. Raises `OSError` where it cannot."""
    program = ctypes.create_string_buffer(
        _BPF.pack(0x28, 0, 0, 0)  # load the half-word at 0, which is the source port
        + _BPF.pack(0x15, 0, 1, port)  # if it is this port, go on, else skip one
        + _BPF.pack(0x06, 0, 0, 0)  # keep no byte
        + _BPF.pack(0x06, 0, 0, 0xFFFFFFFF)  # keep all
    )
    chain = struct.pack("@HP", len(program) // _BPF.size, ctypes.addressof(program))
    receiver.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, chain)


class Hub:
    """State that the members of one in-process bus share: who they are, and the virtual time.

    `time_s` is set by whoever owns the time, and stamps every frame. `pump` is called when a
    member waits for a frame that is not there yet: it lets the others run.
    """

    def __init__(self) -> None:
        self.time_s = 0.0
        self.pump: Callable[[], None] | None = None
        self.members: tuple[InProcessBus, ...] = ()
        self.underway: deque[tuple[InProcessBus, Frame]] = deque()
        """Frames that are being handed on: the first to those after whom the others wait."""

    def join(self, member: "InProcessBus") -> None:
        """Make a bus a member: it hears what the others send from now on."""
        self.members = (*self.members, member)

    def leave(self, member: "InProcessBus") -> None:
        """Take a bus out again; one that is no member already is no error."""
        self.members = tuple(m for m in self.members if m is not member)

    def close(self) -> None:
        """Let every member leave."""
        for member in self.members:
            member.shutdown()


class InProcessBus(can.BusABC):
    """One member of a hub. With `on_frame`, frames go to it instead of waiting for `take`."""

    def __init__(self, hub: Hub, on_frame: Callable[[Frame], None] | None = None) -> None:
        super().__init__("in_process")
        self.channel_info = "in_process"
        self.hub = hub
        self._queue: deque[Frame] = deque()
        self.keep: Callable[[Frame], None] = self._queue.append
        """Lets a frame wait for `take`."""
        self.accept = on_frame or self.keep
        """Takes a frame from the hub."""
        hub.join(self)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002  python-can's
        """Hand a frame to every other member at once, as `put` does."""
        self.put(*frame_of(msg)[:2])

    def put(self, can_id: int, data: bytes) -> None:
        """Hand a frame to every other member at once, in the order of joining.

        What a member sends while it is being handed a frame comes after that frame for everyone.
        """
        hub = self.hub
        underway = hub.underway
        underway.append((self, (can_id, data, hub.time_s)))
        if len(underway) > 1:
            return
        try:
            while underway:
                sender, frame = underway[0]
                for member in hub.members:
                    if member is not sender:
                        member.accept(frame)
                underway.popleft()
        finally:
            underway.clear()

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """Return the next frame, as `take` returns all."""
        self._wait(timeout)
        return message_of(*self._queue.popleft()) if self._queue else None

    def take(self, timeout: float | None = 0.0) -> list[Frame]:
        """Return the frames that wait; with none there, let the others run once, then try again.

        Never waits for the wall clock: none means that nothing came of the others' turn. With
        `timeout` 0 the others get no turn.
        """
        self._wait(timeout)
        queue = self._queue
        return [queue.popleft() for _ in range(min(len(queue), _MOST_AT_ONCE))]

    def _wait(self, timeout: float | None) -> None:
        if not self._queue and timeout != 0 and self.hub.pump is not None:
            self.hub.pump()

    def fileno(self) -> int:
        """Return -1: there is nothing to select on."""
        return -1

    @property
    def waiting(self) -> int:
        """Number of frames that have come and were not received yet."""
        return len(self._queue)

    def shutdown(self) -> None:
        """Leave the hub."""
        super().shutdown()
        self.hub.leave(self)


def open_bus(config: BusSection, hub: Hub | None = None) -> can.BusABC:
    """Open the bus that a cell names; `hub` is needed for `in_process` only.

    Raises `DeviceError`, in one line, for a bus that is not there or cannot be opened.
    """
    where = f"CAN bus {config.interface} {config.channel}"
    try:
        if config.interface == "loopback":
            return LoopbackBus(config.channel, config.port)
        if config.interface == "in_process":
            if hub is None:
                raise DeviceError(f"{where}: exists only inside one process, as in simulation")
            return InProcessBus(hub)
        options: dict[str, Any] = dict(config.options)
        if options.get("receive_own_messages"):
            raise DeviceError(f"{where}: options.receive_own_messages: would be a second master's")
        bus = can.Bus(
            channel=config.channel, interface=config.interface, bitrate=config.bitrate, **options
        )
        if isinstance(bus, SocketcanBus):
            # The kernel drops what does not fit without a word; it may grant less.
            bus.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
        return bus
    except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
        words = " ".join(str(error).split()) or type(error).__name__
        raise DeviceError(f"{where}: {words}") from error


def descriptor_of(bus: can.BusABC) -> int:
    """Return the descriptor of a bus to select on, -1 where its interface has none."""
    try:
        return bus.fileno()
    except NotImplementedError:
        return -1


def hear_only(bus: can.BusABC, identifiers: Collection[int]) -> None:
    """Let the kernel drop data frames of all but some identifiers, where a kernel has the bus.

    So a flood of others cannot push these out of the queue. Error frames come in any case.
    """
    if isinstance(bus, SocketcanBus):
        bus.set_filters(
            [{"can_id": each, "can_mask": STANDARD, "extended": False} for each in identifiers]
        )


# --- Which buses this machine has: the kernel's, and whether it lets open one --------------------
_ARPHRD_CAN: Final = "280"


def can_interfaces(root: Path = Path("/sys/class/net")) -> dict[str, str]:
    """Return the kernel's CAN interfaces with their state, such as `up`."""
    found: dict[str, str] = {}
    for device in sorted(root.glob("*")):
        try:
            if (device / "type").read_text().strip() == _ARPHRD_CAN:
                found[device.name] = (device / "operstate").read_text().strip()
        except OSError:
            continue  # an interface that went away while we looked
    return found


def kernel_can_refusal() -> str:
    """Return why this kernel opens no CAN socket, or nothing."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return error.strerror or str(error)
    return ""


def vcan_available(root: Path = Path("/sys/module"), modules: Path = Path("/lib/modules")) -> bool:
    """Return whether the kernel has virtual CAN, loaded or as a module."""
    here = modules / os.uname().release / "kernel/drivers/net/can"
    return (root / "vcan").exists() or any(here.glob("vcan.ko*"))
