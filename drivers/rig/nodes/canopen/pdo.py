"""A simulated node's process data objects: what the dictionary maps, packed and unpacked.

A PDO is mapped while it is switched off: its entries are written with their number at 0, then the
number (CiA 301, 7.5.2.36, 7.5.2.38).
"""

import struct
from dataclasses import dataclass

from canopen.objectdictionary import SIGNED_TYPES

from .....protocols.canopen.can301 import DEFAULT_PDOS, PDO_INVALID, CommunicationObject
from .....protocols.canopen.sdo import Abort
from .objects import ObjectStore, RefusedError

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
    inhibit: int = 0
    """At least so long after the one before [100 µs]; of an event's."""
    timer: int = 0
    """At the latest so long after the one before [ms], 0 for never; of an event's."""

    @property
    def synchronous(self) -> bool:
        """Whether it goes by the SYNC."""
        return 1 <= self.transmission <= LAST_SYNC_TYPE

    def pack(self, store: ObjectStore) -> bytes:
        """Return the mapped objects' present values as they travel."""
        return self.layout.pack(*[store[key] for key in self.keys])


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
        found.append(Pdo(cob_id & _CAN_ID, transmission, keys, layout, *times))
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
