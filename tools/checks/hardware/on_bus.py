"""Compare who is on a cell's buses with the cell: `telerobot check CELL --bus`."""

from collections.abc import Callable, Iterator
from typing import Final

from ....config.load import Cell
from ....config.schema.bus import CanOpenNodeSection, Entry
from ....config.schema.mechanism import DriveSection
from ....drivers.fieldbus import Fieldbus, Fieldbuses, open_buses
from ....protocols.canopen.can301 import CommunicationObject as Com
from ..findings import Finding, Severity
from .drive import compare
from .scan import (
    FoundNode,
    listen_for_masters,
    nodes_on,
    read_node,
)
from .sdo_client import SdoSilenceError

_IO: Final = (401, "input/output module")
FIELDS: Final = ("vendor", "product", "revision", "serial")


def on_bus(cell: Cell, clock: Callable[[], float]) -> list[Finding]:
    """Open the buses, ask everybody, and compare. Raises `DeviceError`."""
    buses = open_buses(cell, clock)
    try:
        return list(compared(cell, buses))
    finally:
        buses.close()


def compared(cell: Cell, buses: Fieldbuses) -> Iterator[Finding]:
    """Compare every bus. Raises `DeviceError` where another master is on one."""
    for config, fieldbus in zip(cell.config.fieldbuses, buses, strict=True):
        listen_for_masters(fieldbus)
        there = nodes_on(fieldbus)
        entries = [entry for entry in cell.devices if entry.bus == config.name]
        known = {e.section.node: e for e in entries if isinstance(e.section, CanOpenNodeSection)}
        told = ", ".join(map(str, there)) or "none"
        status = Severity.OK if there else Severity.ERROR
        yield Finding(config.label, status, f"nodes that answer: {told}", {"nodes": len(there)})
        strangers = [node for node in there if node not in known]
        for entry in entries:
            yield from _device(cell, fieldbus, entry, there, strangers)
        for node in strangers:
            found = read_node(fieldbus, node, drive=False)
            text = f"answers, and is not in the cell: {_words(found)}"
            yield Finding(f"node {node}", Severity.WARN, text, {"node": node})


def _device(
    cell: Cell, fieldbus: Fieldbus, entry: Entry, there: list[int], strangers: list[int]
) -> Iterator[Finding]:
    section = entry.section
    if not isinstance(section, CanOpenNodeSection):
        yield Finding(entry.name, Severity.OK, "is no CANopen node, and was not asked")
        return
    if section.node not in there:
        text = f"node {section.node} does not answer"
        if strangers:
            text += f"; not in the cell, but there: {', '.join(map(str, strangers))}"
        yield Finding(f"{entry.name} node", Severity.ERROR, text, {"node": section.node})
        return
    try:
        found = read_node(fieldbus, section.node, drive=isinstance(section, DriveSection))
    except SdoSilenceError as error:
        yield Finding(f"{entry.name} node", Severity.ERROR, str(error), {"node": section.node})
        return
    yield _identity(entry, section, found)
    if isinstance(section, DriveSection):
        part = cell if entry.part is None else cell.parts[entry.part]
        yield from compare(part, entry.name, section, found)


def _identity(entry: Entry, section: CanOpenNodeSection, found: FoundNode) -> Finding:
    wrong = []
    profile = (found.get(Com.DEVICE_TYPE) or 0) & 0xFFFF
    number, name = (402, "servo drive") if isinstance(section, DriveSection) else _IO
    if profile != number:
        wrong.append(f"profile {profile} in 1000h, a {name} has {number}")
    for place, key in enumerate(FIELDS, 1):
        wanted = None if section.identity is None else getattr(section.identity, key)
        value = found.get(Com.IDENTITY, place)
        if wanted is not None and value != wanted:
            has = "none" if value is None else f"{value:#x}"
            wrong.append(f"{key} {has}, the cell says {wanted:#x}")
    text = f"node {section.node}: {_words(found)}"
    status = Severity.ERROR if wrong else Severity.OK
    values = {"node": section.node} | {
        key: found.get(Com.IDENTITY, place) for place, key in enumerate(FIELDS, 1)
    }
    return Finding(f"{entry.name} identity", status, "; ".join((text, *wrong)), values)


def _words(found: FoundNode) -> str:
    pairs = [(key, found.get(Com.IDENTITY, place)) for place, key in enumerate(FIELDS, 1)]
    parts = [f"{key} {value:#x}" for key, value in pairs if value is not None]
    return ", ".join(([found.name] if found.name else []) + parts) or "it tells nothing of itself"
