"""Agreement between a cell's CAN buses and the devices on them."""

from collections.abc import Iterator, Sequence
from typing import Final

from ..errors import nearest
from ..schema.bus.on_bus import CanOpenNodeSection, Entry
from ..schema.cell import CellConfig
from ..schema.mechanism.mechanism import DriveSection, ForceTorqueSection

MASTER_NODE: Final = 127
"""The daemon's own node id, which its heartbeat uses."""
_MASTER_IDS: Final = {0x000: "NMT", 0x080: "SYNC", 0x700 + MASTER_NODE: "the daemon's heartbeat"}


def bus_disagreements(
    parts: Sequence[tuple[str, CellConfig]], devices: Sequence[Entry]
) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key.

    `parts` are the cell's mechanisms: each one's place in the file, and what the file says of it.
    """
    _, config = parts[0]
    if config.buses and "bus" in config.model_fields_set:
        yield "buses: there is a [bus], too: give either [bus] or [[buses]]"
    yield from _buses(config)
    names = [bus.name for bus in config.fieldbuses]
    owners: dict[tuple[str, int], str] = {}
    for name in names:
        owners |= {(name, can_id): owner for can_id, owner in _MASTER_IDS.items()}
    nodes = {(name, MASTER_NODE): "the daemon" for name in names}
    for place, part in parts:
        yield from _known(place, part.mechanism.bus, names)
    called: set[str] = set()
    for entry in devices:
        yield from _known(entry.key, entry.section.bus, names)
        if entry.name in called:
            yield f"{entry.key}.name: value '{entry.name}': another device has that name"
        called.add(entry.name)
        yield from _identifiers(entry, nodes, owners)
    yield from _without_drives(devices)


def _known(key: str, bus: str | None, names: list[str]) -> Iterator[str]:
    if bus is not None and bus not in names:
        yield f"{key}.bus: value '{bus}': no such bus in [[buses]]{nearest(bus, names)}"


def _buses(config: CellConfig) -> Iterator[str]:
    names: list[str] = []
    wires: dict[tuple[str, str, int], str] = {}
    for i, bus in enumerate(config.buses):
        if bus.name in names:
            yield f"buses[{i}].name: value '{bus.name}': is there already"
        names.append(bus.name)
        wire = (bus.interface, bus.channel, bus.port if bus.interface == "loopback" else 0)
        if wire in wires:
            yield f"buses[{i}].channel: value '{bus.place}': already that of bus '{wires[wire]}'"
        wires[wire] = bus.name


def _identifiers(
    entry: Entry, nodes: dict[tuple[str, int], str], owners: dict[tuple[str, int], str]
) -> Iterator[str]:
    """Judge one device's identifiers against those of the devices before it."""
    section = entry.section
    if isinstance(section, CanOpenNodeSection):
        place = (entry.bus, section.node)
        if place in nodes:
            yield f"{entry.key}.node: value {section.node}: already the node of {nodes[place]}"
        nodes[place] = entry.owner
    own: dict[tuple[str, int], str] = {}
    for key, can_id in section.identifiers():
        taken = owners.get((entry.bus, can_id)) or own.get((entry.bus, can_id))
        if taken is not None:
            yield f"{entry.key}.{key}: value {can_id:#x}: is already the CAN id of {taken}"
        own[entry.bus, can_id] = f"{entry.key}.{key}"
    owners |= dict.fromkeys(own, entry.owner)


def _without_drives(devices: Sequence[Entry]) -> Iterator[str]:
    """A sample is aged by the answers of a drive that shares the clock of its stamps."""
    driven = {entry.bus for entry in devices if isinstance(entry.section, DriveSection)}
    for entry in devices:
        if isinstance(entry.section, ForceTorqueSection) and entry.bus not in driven:
            yield (
                f"{entry.key}.bus: value '{entry.bus}': no drive is on that bus, whose answers "
                "tell how old a sample is"
            )
