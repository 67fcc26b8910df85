"""A simulated CANopen slave (CiA 301): network management, SDO, PDOs, SYNC, heartbeats, EMCY."""

import logging
import struct
from binascii import crc_hqx
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Final

import canopen
from canopen.objectdictionary import SIGNED_TYPES, ODVariable
from canopen.sdo.exceptions import SdoAbortedError
from canopen.sdo.server import SdoServer

from ....protocols.canopen import can301
from ....protocols.canopen.can301 import (
    DEFAULT_PDOS,
    PDO_INVALID,
    Abort,
    CommunicationObject,
    EmcyCode,
    NmtCommand,
    NmtState,
)
from ....protocols.canopen.can301 import CommunicationObject as Com
from ....protocols.messages.rig import RigFault
from .node import NodeLink

# --- A simulated node's object dictionary: the EDS, and the values --------------------------------

EDS = Path(__file__).resolve().parents[3] / "config" / "devices" / "simulated_drive.eds"

logging.getLogger("canopen").addHandler(logging.NullHandler())  # its errors are answered, too


class RefusedError(Exception):
    """Raised by a write's handler: the value is not taken over, for the reason given."""

    def __init__(self, reason: Abort) -> None:
        super().__init__(f"refused: {reason:#010x}")
        self.reason = reason


@cache
def _dictionary(eds: Path, node: int) -> canopen.ObjectDictionary:
    return canopen.import_od(str(eds), node)


class _Image(dict[tuple[int, int], int]):
    """Integers by index and sub-index, those of the EDS until others are written."""

    def __init__(self, default: Callable[[tuple[int, int]], int]) -> None:
        super().__init__()
        self._default = default

    def __missing__(self, key: tuple[int, int]) -> int:
        value = self[key] = self._default(key)
        return value


class ObjectStore:
    """Values by index and sub-index; integers are kept as integers.

    `on_write(index, subindex, value)` is called before a value that came over the bus is stored,
    and may refuse it with `RefusedError`.
    """

    def __init__(
        self,
        node: int,
        on_write: Callable[[int, int, int], None],
        eds: Path = EDS,
    ) -> None:
        self.object_dictionary = _dictionary(eds, node)
        self._on_write = on_write
        self.image = _Image(lambda key: int(self.variable(*key).default or 0))
        """All values as they were last written, without what is measured."""
        self.measured: dict[tuple[int, int], Callable[[], int]] = {}
        """What measures an object when it is read."""
        self.choices: dict[tuple[int, int], frozenset[int]] = {}
        """The only values of an object, where it is no range (LowLimit, HighLimit of the EDS)."""

    def reset(self, *, communication_only: bool = False) -> None:
        """Go back to the defaults of the EDS, everywhere or in 1000h to 1FFFh only."""
        for key in [*self.image]:
            if not communication_only or key[0] < 0x2000:
                del self.image[key]

    def __getitem__(self, key: tuple[int, int]) -> int:
        """Return an integer object's value. Raises `KeyError` for an object that is none."""
        return self.reader(key)()

    def reader(self, key: tuple[int, int]) -> Callable[[], int]:
        """Return what reads an integer object."""
        return self.measured.get(key) or partial(self.image.__getitem__, key)

    def __setitem__(self, key: tuple[int, int], value: int) -> None:
        self.image[key] = value

    def variable(self, index: int, subindex: int) -> ODVariable:
        """Return an object's entry in the EDS. Raises `KeyError`."""
        entry = self.object_dictionary[index]
        if isinstance(entry, ODVariable):
            if subindex:
                raise KeyError(subindex)
            return entry
        found: ODVariable = entry.subindices[subindex]
        return found

    def write(self, index: int, subindex: int, value: int) -> None:
        """Take over a value that came over the bus. Raises `RefusedError` for one out of range."""
        variable = self.variable(index, subindex)
        low, high = variable.min, variable.max
        out = (low is not None and value < low) or (high is not None and value > high)
        if out or value not in self.choices.get((index, subindex), (value,)):
            raise RefusedError(Abort.INVALID_VALUE)
        self._on_write(index, subindex, value)
        self[index, subindex] = value

    # --- what the SDO server calls --------------------------------------------------------------

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """Return an object's bytes. Raises `SdoAbortedError`."""
        variable = self._find(index, subindex)
        if check_readable and not variable.readable:
            raise SdoAbortedError(Abort.WRITE_ONLY)
        if variable.data_type in canopen.objectdictionary.INTEGER_TYPES:
            return bytes(variable.encode_raw(self[index, subindex]))
        return bytes(variable.encode_raw(variable.default or ""))

    def set_data(
        self, index: int, subindex: int, data: bytes, check_writable: bool = False
    ) -> None:
        """Write an object's bytes. Raises `SdoAbortedError`."""
        variable = self._find(index, subindex)
        if check_writable and not variable.writable:
            raise SdoAbortedError(Abort.READ_ONLY)
        if 8 * len(data) != len(variable):
            raise SdoAbortedError(Abort.WRONG_LENGTH)
        try:
            self.write(index, subindex, int(variable.decode_raw(bytes(data))))
        except RefusedError as refused:
            raise SdoAbortedError(refused.reason) from None

    def _find(self, index: int, subindex: int) -> ODVariable:
        if index not in self.object_dictionary:
            raise SdoAbortedError(Abort.NO_OBJECT)
        try:
            return self.variable(index, subindex)
        except KeyError:
            raise SdoAbortedError(Abort.NO_SUBINDEX) from None


# --- A simulated node's process data objects: what the dictionary maps, packed and unpacked -------
#
# A PDO is mapped while it is switched off: its entries are written with their number at 0, then
# the number (CiA 301, 7.5.2.36, 7.5.2.38).

LAST_SYNC_TYPE = 240
"""Transmission types 1 to 240 go by the SYNC, every so many (CiA 301, 7.5.2.35)."""

_BY_REQUEST = range(LAST_SYNC_TYPE + 1, 254)
"""Reserved transmission types, and those by remote request, which these nodes do not answer."""
_LONGEST_PDO = 8
_CAN_ID = 0x7FF
_EXTENDED = 1 << 29
_FREE = ((0x080, 0x100), (0x181, 0x580), (0x600, 0x600), (0x680, 0x6DF))
_INHIBIT_TIME, _EVENT_TIMER = 3, 5
_LETTERS = {8: "b", 16: "h", 32: "i"}


@dataclass(frozen=True)
class Pdo:
    """One PDO that exists: identifier, transmission type, mapped objects, their layout."""

    can_id: int
    transmission: int
    keys: tuple[tuple[int, int], ...]
    layout: struct.Struct
    readers: tuple[Callable[[], int], ...]
    """Of the mapped objects."""
    inhibit: int = 0
    """At least so long after the one before [100 µs]; of an event's."""
    timer: int = 0
    """At the latest so long after the one before [ms], 0 for never; of an event's."""

    @property
    def synchronous(self) -> bool:
        """Whether it goes by the SYNC."""
        return 1 <= self.transmission <= LAST_SYNC_TYPE

    def pack(self) -> bytes:
        """Return the mapped objects' present values as they travel."""
        return self.layout.pack(*[read() for read in self.readers])


def existing_pdos(store: ObjectStore, *, receive: bool) -> tuple[Pdo, ...]:
    """Return the PDOs of one direction that the dictionary has switched on."""
    communication, mapping = (
        (CommunicationObject.RPDO_COMMUNICATION, CommunicationObject.RPDO_MAPPING)
        if receive
        else (CommunicationObject.TPDO_COMMUNICATION, CommunicationObject.TPDO_MAPPING)
    )
    found = []
    for number in range(DEFAULT_PDOS):
        cob_id = store[communication + number, 1]
        count = store[mapping + number, 0]
        if cob_id & PDO_INVALID or not count:
            continue
        entries = [store[mapping + number, sub] for sub in range(1, count + 1)]
        keys = tuple((entry >> 16, entry >> 8 & 0xFF) for entry in entries)
        letters = "".join(
            _letter(store, key, entry & 0xFF) for key, entry in zip(keys, entries, strict=True)
        )
        transmission = store[communication + number, 2]
        layout = struct.Struct("<" + letters)
        times = (0, 0) if receive else _times(store, communication + number)
        readers = tuple(map(store.reader, keys))
        found.append(Pdo(cob_id & _CAN_ID, transmission, keys, layout, readers, *times))
    return tuple(found)


def is_pdo_object(index: int) -> bool:
    """Return whether an object configures a PDO."""
    return any(
        0 <= index - base < DEFAULT_PDOS
        for base in (
            CommunicationObject.RPDO_COMMUNICATION,
            CommunicationObject.RPDO_MAPPING,
            CommunicationObject.TPDO_COMMUNICATION,
            CommunicationObject.TPDO_MAPPING,
        )
    )


def check_pdo_object(store: ObjectStore, index: int, subindex: int, value: int) -> None:
    """Judge a value for an object that configures a PDO. Raises `RefusedError`."""
    for first, mapping in (
        (CommunicationObject.RPDO_COMMUNICATION, CommunicationObject.RPDO_MAPPING),
        (CommunicationObject.TPDO_COMMUNICATION, CommunicationObject.TPDO_MAPPING),
    ):
        if 0 <= index - first < DEFAULT_PDOS:
            _check_communication(store, index, subindex, value)
        elif 0 <= index - mapping < DEFAULT_PDOS:
            if not store[first + index - mapping, 1] & PDO_INVALID:
                raise RefusedError(Abort.WRONG_STATE)
            transmit = mapping == CommunicationObject.TPDO_MAPPING
            _check_mapping(store, index, subindex, value, transmit=transmit)


def _check_communication(store: ObjectStore, index: int, subindex: int, value: int) -> None:
    before = store[index, 1]
    on = not before & PDO_INVALID
    if subindex == 1:
        if value & PDO_INVALID:
            return
        renamed = on and (value ^ before) & _CAN_ID
        if value & _EXTENDED or not _may_carry(value & _CAN_ID) or renamed:
            raise RefusedError(Abort.INVALID_VALUE)
    elif subindex == 2 and value in _BY_REQUEST:
        raise RefusedError(Abort.INVALID_VALUE)
    elif subindex == _INHIBIT_TIME and on:
        raise RefusedError(Abort.WRONG_STATE)


def _check_mapping(
    store: ObjectStore, index: int, subindex: int, value: int, *, transmit: bool
) -> None:
    if subindex:
        if store[index, 0]:
            raise RefusedError(Abort.WRONG_STATE)
        if value:
            _check_entry(store, value, transmit=transmit)
        return
    entries = [store[index, place] for place in range(1, value + 1)]
    if sum(entry & 0xFF for entry in entries) > 8 * _LONGEST_PDO:
        raise RefusedError(Abort.PDO_TOO_LONG)
    for entry in entries:
        _check_entry(store, entry, transmit=transmit)


def _check_entry(store: ObjectStore, entry: int, *, transmit: bool) -> None:
    try:
        variable = store.variable(entry >> 16, entry >> 8 & 0xFF)
    except KeyError:
        raise RefusedError(Abort.NO_OBJECT) from None
    allowed = variable.readable if transmit else variable.writable
    if not variable.pdo_mappable or not allowed or len(variable) != entry & 0xFF:
        raise RefusedError(Abort.NOT_MAPPABLE)


def _may_carry(can_id: int) -> bool:
    """Return whether a PDO may have an identifier (CiA 301, table 41: restricted CAN-IDs)."""
    return any(low <= can_id <= high for low, high in _FREE)


def _times(store: ObjectStore, index: int) -> tuple[int, int]:
    """Return inhibit time and event timer of a TPDO, 0 where the device has none."""
    try:
        return store[index, _INHIBIT_TIME], store[index, _EVENT_TIMER]
    except KeyError:
        return 0, 0


def _letter(store: ObjectStore, key: tuple[int, int], bits: int) -> str:
    letter = _LETTERS[bits]
    return letter if store.variable(*key).data_type in SIGNED_TYPES else letter.upper()


# --- A transmit PDO that is sent when what it maps has changed (CiA 301, 7.5.2.37) ----------------
#
# Transmission type 0: at the SYNC after the change. 254, 255: at once, but no sooner than the
# inhibit time after the one before, and at the latest when the event timer has run out.

INHIBIT_S: Final = 1e-4
"""Unit of the inhibit time, sub-index 3 [s]."""
TIMER_S: Final = 1e-3
"""Unit of the event timer, sub-index 5 [s]."""


class EventPdo:
    """Memory of one such PDO: what was sent last, and when."""

    def __init__(self, pdo: Pdo) -> None:
        self.pdo = pdo
        self.at_sync = pdo.transmission == 0
        self._told: bytes | None = None
        self._told_s = 0.0

    def due(self, now_s: float) -> bytes | None:
        """Return the data to be sent now; None while nothing has changed, or too soon."""
        data = self.pdo.pack()
        elapsed = now_s - self._told_s + 1e-7
        if self._told is not None and not self.at_sync:
            inhibit, timer = self.pdo.inhibit * INHIBIT_S, self.pdo.timer * TIMER_S
            late = 0.0 < timer <= elapsed
            if elapsed < inhibit or (data == self._told and not late):
                return None
        elif data == self._told:
            return None
        self._told, self._told_s = data, now_s
        return data


# --- A simulated node's SDO server: canopen's, with block upload (CiA 301, 7.2.4) -----------------

LONGEST_TRANSFER = 1024
"""No object of a node is longer; a download that goes on beyond is given up [byte]."""

_HEAD: Final = struct.Struct("<BHB")
_OF_AN_OBJECT: Final = (0x20, 0x40, 0xA0, 0xC0)
"""Requests that name an object: downloads and uploads, plain and in blocks."""
_BLOCK_REQUEST: Final = 0xA0
_BLOCK_REPLY: Final = 0xC0
_INITIATE, _END, _ACKNOWLEDGE, _START = range(4)
_CRC: Final = 0x04
_SIZE: Final = 0x02
_LAST: Final = 0x80
_SEGMENT: Final = 7
_MOST_SEGMENTS: Final = 127


class NodeSdoServer(SdoServer):
    """canopen's SDO server without a network: answers through `send`, in the caller's thread.

    Serves expedited, segmented and block uploads, expedited and segmented downloads. canopen aborts
    with the index of the transfer before; a refused request names its own here.
    """

    def __init__(self, node: int, store: ObjectStore, send: Callable[[int, bytes], None]) -> None:
        super().__init__(0x600 + node, 0x580 + node, store)  # type: ignore[no-untyped-call]  # its stubs
        self._store = store
        self._send = send
        self._index, self._subindex = 0, 0
        self._block: _BlockUpload | None = None

    def on_request(self, can_id: int, data: bytes, timestamp: float) -> None:
        """Answer one request; what is no SDO request of 8 bytes is ignored."""
        if len(data) != 8:
            return
        command = data[0] & 0xE0
        in_block = command == _BLOCK_REQUEST and data[0] & 0x03 != _INITIATE
        if command in _OF_AN_OBJECT and not in_block:
            self._index, self._subindex = struct.unpack_from("<HB", data, 1)
        if not in_block:
            self._block = None
        if command in (0x00, 0x60) and self._buffer is None:  # a segment of no transfer
            self.abort(Abort.INVALID_COMMAND)  # type: ignore[no-untyped-call]  # its stubs
            return
        super().on_request(can_id, bytearray(data), timestamp)  # type: ignore[no-untyped-call]  # its stubs
        if self._buffer is not None and len(self._buffer) > LONGEST_TRANSFER:
            self._buffer = None

    def block_upload(self, data: bytes) -> None:
        """Answer a request of a block upload. Raises `SdoAbortedError`."""
        step = data[0] & 0x03
        if step == _INITIATE:
            self._begin_block(data)
        elif self._block is None:
            raise SdoAbortedError(Abort.INVALID_COMMAND)
        elif step == _START:
            self._send_all(self._block.segments())
        elif step == _ACKNOWLEDGE:
            self._send_all(self._block.acknowledged(data[1], data[2]))
        else:
            self._block = None

    def _begin_block(self, data: bytes) -> None:
        most, threshold = data[4], data[5]
        if not 1 <= most <= _MOST_SEGMENTS:
            raise SdoAbortedError(Abort.BLOCK_SIZE)
        _, index, subindex = _HEAD.unpack_from(data)
        content = self._store.get_data(index, subindex, check_readable=True)
        if 0 < len(content) <= threshold:
            self.init_upload(data)  # type: ignore[no-untyped-call]  # its stubs
            return
        self._block = _BlockUpload(content, most)
        head = _HEAD.pack(_BLOCK_REPLY | _CRC | _SIZE, index, subindex)
        self.send_response(head + struct.pack("<I", len(content)))

    def _send_all(self, responses: list[bytes]) -> None:
        for response in responses:
            self.send_response(response)

    def send_response(self, response: bytes) -> None:
        """Send an answer."""
        self._send(self.tx_cobid, bytes(response))


class _BlockUpload:
    """Segments of one object, in blocks of `most`, until all are acknowledged."""

    def __init__(self, content: bytes, most: int) -> None:
        self._content, self._most = content, most
        self._first = 0
        """Byte that the present block begins with."""

    def segments(self) -> list[bytes]:
        """Return the present block."""
        found = []
        for number in range(1, self._most + 1):
            at = self._first + _SEGMENT * (number - 1)
            last = at + _SEGMENT >= len(self._content)
            part = self._content[at : at + _SEGMENT].ljust(_SEGMENT, b"\0")
            found.append(bytes((number | (_LAST if last else 0),)) + part)
            if last:
                break
        return found

    def acknowledged(self, number: int, most: int) -> list[bytes]:
        """Return the segments after those that came, or the end. Raises `SdoAbortedError`."""
        if number > len(self.segments()):
            raise SdoAbortedError(Abort.SEQUENCE_NUMBER)
        if not 1 <= most <= _MOST_SEGMENTS:
            raise SdoAbortedError(Abort.BLOCK_SIZE)
        self._first += _SEGMENT * number
        self._most = most
        if number and self._first >= len(self._content):
            unused = -len(self._content) % _SEGMENT
            crc = crc_hqx(self._content, 0)
            return [struct.pack("<BH5x", _BLOCK_REPLY | unused << 2 | _END, crc)]
        return self.segments()


# --- A simulated CANopen slave (CiA 301): network management, SDO, PDOs, SYNC, heartbeats, EMCY ---

NEVER = float("inf")
_EPSILON_S = 1e-7
_PDO_LENGTH = 0x8210
_SELF_STARTED = {
    NmtCommand.START: NmtState.OPERATIONAL,
    NmtCommand.STOP: NmtState.STOPPED,
    NmtCommand.PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
}


class CanNode:
    """Base of every CANopen slave; a device derives from it and fills in the `on_…` methods.

    `clock` is the physics' time [s]. Frames are handled when they come; a synchronous RPDO takes
    effect at the next SYNC, after the TPDOs of that SYNC have been sampled and sent.
    """

    samples_after_step = False
    plain: frozenset[tuple[int, int]] = frozenset()
    """Objects of an RPDO that are only stored: any value will do, and `on_rpdo` reads them."""

    def __init__(
        self, node: int, link: NodeLink, clock: Callable[[], float], eds: Path = EDS
    ) -> None:
        self.node = node
        self.link = link
        self.clock = clock
        link.on_frame = self.receive
        self.objects = ObjectStore(node, self._before_write, eds)
        self._sdo = NodeSdoServer(node, self.objects, link.send)
        self.nmt = NmtState.BOOT_UP
        self.master_lost = False
        self.due_s = 0.0
        """When `tick` has something to do next [s]."""
        self._rpdos: dict[int, Pdo] | None = None
        self._tpdos: tuple[Pdo, ...] = ()
        self._events: tuple[EventPdo, ...] = ()
        self._pending: dict[int, tuple[Pdo, bytes]] = {}
        """RPDOs that wait for a SYNC, the newest of each, in the order they came in."""
        self._syncs = 0
        self._next_beat_s = NEVER
        self._master_beat_s: float | None = None

    # --- what a device fills in -----------------------------------------------------------------

    def on_reset(self, *, communication_only: bool) -> None:
        """Take the state after power-on, or after a reset of the communication."""

    def on_written(self, index: int, subindex: int, value: int) -> None:
        """An object was written, over SDO or by an RPDO. May raise `RefusedError`."""

    def on_rpdo(self, _pdo: Pdo) -> None:
        """All objects of one RPDO have been written."""

    def on_sync(self) -> None:
        """A SYNC came, and the RPDOs that waited for it have been written."""

    def on_setpoint_frame(self) -> None:
        """An RPDO came in; what it says takes effect at its own time."""

    def on_master_lost(self) -> None:
        """The master's heartbeat stopped (1016h)."""

    def on_master_back(self) -> None:
        """The master's heartbeat is there again."""

    def inject(self, fault: RigFault) -> None:
        """Apply a fault of the device itself. Raises `ValueError` for one that it has not."""
        raise ValueError(f"fault {fault.kind}: a {type(self).__name__} has no such fault")

    # --- the bus --------------------------------------------------------------------------------

    def identifiers(self) -> tuple[int, ...]:
        """Return those of its SDO server and its RPDOs."""
        rpdos = (can301.rpdo1_id(self.node) + 0x100 * i for i in range(can301.DEFAULT_PDOS))
        return (can301.sdo_request_id(self.node), *rpdos)

    def boot(self, *, communication_only: bool = False) -> None:
        """Go through initialisation: defaults, boot-up message, *Pre-operational*."""
        self.objects.reset(communication_only=communication_only)
        self._rpdos, self._pending, self._syncs = None, {}, 0
        self._next_beat_s, self._master_beat_s, self.master_lost = NEVER, None, False
        self.on_reset(communication_only=communication_only)
        self.link.send(can301.heartbeat_id(self.node), bytes((NmtState.BOOT_UP,)))
        self.nmt = NmtState.PRE_OPERATIONAL
        self.due_s = 0.0

    def receive(self, can_id: int, data: bytes) -> None:
        """Handle one frame from the bus; one that is not for this node is ignored."""
        if can_id == can301.SYNC_ID:
            self._on_sync()
            return
        if self.nmt is NmtState.OPERATIONAL:
            pdo = (self._rpdos or self._map_pdos()).get(can_id)
            if pdo is not None:
                self._on_rpdo(pdo, data)
                return
        self.due_s = 0.0
        if can_id == self._sdo.rx_cobid:
            if self.nmt is not NmtState.STOPPED:
                self._sdo.on_request(can_id, data, self.clock())
        elif can_id == can301.NMT_ID:
            self._on_nmt(data)
        elif can_id > can301.heartbeat_id(0):
            self._on_heartbeat(can_id - can301.heartbeat_id(0))

    def emergency(self, code: int) -> None:
        """Send an emergency message, unless the node is stopped, and keep code and register."""
        self.objects[0x603F, 0] = code
        register = 0 if code == EmcyCode.NO_ERROR else 1 | _register_bit(code)
        self.objects[Com.ERROR_REGISTER, 0] = register
        if self.nmt is not NmtState.STOPPED:
            self.link.send(can301.emcy_id(self.node), can301.encode_emcy(code, register))

    def tick(self) -> None:
        """Do what is due at this physics time; sets `due_s` to when it wants the next call."""
        now = self.clock() + _EPSILON_S
        period = self.objects.image[Com.PRODUCER_HEARTBEAT, 0] * 1e-3
        if period <= 0:
            self._next_beat_s = NEVER
        elif self._next_beat_s > now + period:
            self._next_beat_s = now + period
        elif now >= self._next_beat_s:
            self.link.send(can301.heartbeat_id(self.node), bytes((self.nmt,)))
            self._next_beat_s += period
        self.due_s = min(self._next_beat_s, self._watch_master(now))
        if self.nmt is NmtState.OPERATIONAL:
            self._map_pdos()
            for event in self._events:
                if not event.at_sync:
                    self._tell(event)
                    self.due_s = 0.0  # what it maps may change at any step

    def _watch_master(self, now: float) -> float:
        timeout = (self.objects.image[Com.CONSUMER_HEARTBEAT, 1] & 0xFFFF) * 1e-3
        if timeout <= 0 or self._master_beat_s is None or self.master_lost:
            return NEVER
        deadline = self._master_beat_s + timeout
        if now < deadline:
            return deadline
        self.master_lost = True
        self.emergency(EmcyCode.HEARTBEAT)
        self.on_master_lost()
        if self.nmt is NmtState.OPERATIONAL:
            self.nmt = NmtState.PRE_OPERATIONAL
        return NEVER

    def _on_heartbeat(self, node: int) -> None:
        if node != self.objects.image[Com.CONSUMER_HEARTBEAT, 1] >> 16:
            return
        self._master_beat_s = self.clock()
        if self.master_lost:
            self.master_lost = False
            self.on_master_back()

    def _on_nmt(self, data: bytes) -> None:
        if len(data) != 2 or data[1] not in (0, self.node):
            return
        command = data[0]
        if command in _SELF_STARTED:
            self.nmt = _SELF_STARTED[NmtCommand(command)]
            self._rpdos, self._pending = None, {}
        elif command == NmtCommand.RESET_NODE:
            self.boot()
        elif command == NmtCommand.RESET_COMMUNICATION:
            self.boot(communication_only=True)

    def _on_sync(self) -> None:
        if self.nmt is not NmtState.OPERATIONAL:
            return
        if self._rpdos is None:
            self._map_pdos()
        self._syncs += 1
        for pdo in self._tpdos:
            if self._syncs % pdo.transmission == 0:
                self.link.send(pdo.can_id, pdo.pack())
        for event in self._events:
            if event.at_sync:
                self._tell(event)
        if self._pending:
            pending, self._pending = self._pending, {}
            for pdo, data in pending.values():
                self._apply(pdo, data)
        self.on_sync()

    def _on_rpdo(self, pdo: Pdo, data: bytes) -> None:
        if len(data) < pdo.layout.size:
            self.emergency(_PDO_LENGTH)
            return
        self.on_setpoint_frame()
        if pdo.synchronous:
            self._pending.pop(pdo.can_id, None)
            self._pending[pdo.can_id] = pdo, data
        else:
            self._apply(pdo, data)

    def _apply(self, pdo: Pdo, data: bytes) -> None:
        for key, value in zip(pdo.keys, pdo.layout.unpack_from(data), strict=True):
            if key in self.plain:
                self.objects.image[key] = value
                continue
            self.due_s = 0.0
            with suppress(RefusedError):  # nobody asked for an answer: the old value stays
                self.objects.write(*key, value)
        self.on_rpdo(pdo)

    def _tell(self, event: EventPdo) -> None:
        data = event.due(self.clock())
        if data is not None:
            self.link.send(event.pdo.can_id, data)

    def _map_pdos(self) -> dict[int, Pdo]:
        if self._rpdos is None:
            tpdos = existing_pdos(self.objects, receive=False)
            self._tpdos = tuple(pdo for pdo in tpdos if pdo.synchronous)
            self._events = tuple(EventPdo(pdo) for pdo in tpdos if not pdo.synchronous)
            self._rpdos = {pdo.can_id: pdo for pdo in existing_pdos(self.objects, receive=True)}
        return self._rpdos

    def _before_write(self, index: int, subindex: int, value: int) -> None:
        if is_pdo_object(index):
            check_pdo_object(self.objects, index, subindex, value)
            self._rpdos = None
        if index == Com.PRODUCER_HEARTBEAT:
            self._next_beat_s = NEVER
        self.on_written(index, subindex, value)


def _register_bit(code: int) -> int:
    """Return the bit of 1001h that an error code belongs to (CiA 301, table 46)."""
    return {0x2: 0x02, 0x3: 0x04, 0x4: 0x08, 0x8: 0x10, 0xF: 0x80}.get(code >> 12, 0)
