"""Devices on a cell's buses: an entry for each, in the order of booting."""

from collections.abc import Iterator

from .schema.bus.on_bus import Entry
from .schema.cell import CellConfig


def devices_of(config: CellConfig, place: str, prefix: str, part: int) -> Iterator[Entry]:
    """Yield the devices of one mechanism: drives as the chain's joints, then sensor and gripper.

    The mechanism stands at `place` in the file and is the cell's `part`-th; names of its devices
    begin with `prefix`.
    """
    mechanism = config.mechanism
    default = mechanism.bus or config.fieldbuses[0].name
    for i, drive in enumerate(mechanism.drives):
        name = f"{prefix}{drive.joint}"
        key = f"{place}.{drive.key(i)}"
        yield Entry(key, name, drive, drive.bus or default, f"the drive of '{name}'", part)
    of = f" of '{mechanism.name}'" if prefix else ""
    for kind in ("force_torque", "gripper"):
        section = getattr(mechanism, kind)
        if section is not None:
            owner = f"the {kind.replace('_', '/')}{of}"
            bus = section.bus or default
            yield Entry(f"{place}.{kind}", f"{prefix}{kind}", section, bus, owner, part)


def shared_devices(config: CellConfig) -> Iterator[Entry]:
    """Yield the devices that a cell has once, however many mechanisms it has."""
    switch = config.enabling_switch
    if switch is not None:
        name = "enabling_switch"
        bus = switch.bus or config.fieldbuses[0].name
        yield Entry(name, name, switch, bus, "the enabling switch", None)
