"""A simulated node's process data objects: what the dictionary maps, packed and unpacked."""

import struct
from dataclasses import dataclass

from canopen.objectdictionary import SIGNED_TYPES

from ....protocols.canopen.can301 import DEFAULT_PDOS, PDO_INVALID, CommunicationObject
from .objects import ObjectStore

LAST_SYNC_TYPE = 240
"""Transmission types 1 to 240 go by the SYNC, every so many (CiA 301, 7.5.2.35)."""

_LETTERS = {8: "b", 16: "h", 32: "i"}


@dataclass(frozen=True)
class Pdo:
    """One PDO that exists: identifier, transmission type, mapped objects, their layout."""

    can_id: int
    transmission: int
    keys: tuple[tuple[int, int], ...]
    layout: struct.Struct

    @property
    def synchronous(self) -> bool:
        """Whether it goes by the SYNC."""
        return 1 <= self.transmission <= LAST_SYNC_TYPE

    def pack(self, store: ObjectStore) -> bytes:
        """Return the mapped objects' present values as they travel."""
        return self.layout.pack(*(store[key] for key in self.keys))


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
        found.append(Pdo(cob_id & 0x7FF, transmission, keys, struct.Struct("<" + letters)))
    return tuple(found)


def is_mapping_of_existing(store: ObjectStore, index: int) -> bool:
    """Return whether an object maps a PDO that is switched on: then it must not be written."""
    for communication, mapping in (
        (CommunicationObject.RPDO_COMMUNICATION, CommunicationObject.RPDO_MAPPING),
        (CommunicationObject.TPDO_COMMUNICATION, CommunicationObject.TPDO_MAPPING),
    ):
        if 0 <= index - mapping < DEFAULT_PDOS:
            return not store[communication + index - mapping, 1] & PDO_INVALID
    return False


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


def _letter(store: ObjectStore, key: tuple[int, int], bits: int) -> str:
    letter = _LETTERS[bits]
    return letter if store.variable(*key).data_type in SIGNED_TYPES else letter.upper()
