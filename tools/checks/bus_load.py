"""Check of each CAN bus's load, with every frame stuffed."""

from collections.abc import Iterator

from ...config.load import Cell
from ...config.schema.bus import BusSection, CanOpenNodeSection, Entry
from ...config.schema.mechanism import DriveSection
from .findings import Finding, graded

LIMIT = 0.80
"""Above this load a classic CAN bus has no room left for SDO, EMCY and repetitions [1]."""
NOTICE = 0.60
HEARTBEAT_BYTES = 1


def worst_case_bits(data_bytes: int) -> int:
    """Return the bits of a standard frame with the most stuff bits, and the space after it.

    47 + 8n + ⌊(34 + 8n − 1) / 4⌋ (Davis, Burns, Bril, Lukkien 2007, eq. 1).
    """
    return 47 + 8 * data_bytes + (34 + 8 * data_bytes - 1) // 4


def bus_load(cell: Cell) -> Iterator[Finding]:
    """Judge the cyclic traffic of each bus against its bit rate."""
    for bus in cell.config.fieldbuses:
        on_it = [entry for entry in cell.devices if entry.bus == bus.name]
        yield from _load(cell, bus, on_it)


def _load(cell: Cell, bus: BusSection, devices: list[Entry]) -> Iterator[Finding]:
    timing, bitrate = cell.config.timing, bus.bitrate
    burst, free = worst_case_bits(0), {}
    for entry in devices:
        arm = cell.parts[entry.part or 0].config.mechanism
        drive = entry.section if isinstance(entry.section, DriveSection) else None
        frames = entry.section.frames(arm.mode_of(drive) if drive else arm.operation_mode)
        bits = [(f.rate_hz, f.count * worst_case_bits(f.data_bytes)) for f in frames]
        burst += sum(b for rate, b in bits if rate is None)
        paced = sum(rate * b for rate, b in bits if rate is not None)
        if paced:
            free[entry.name] = paced / bitrate
    nodes = 1 + sum(isinstance(entry.section, CanOpenNodeSection) for entry in devices)
    heartbeats = nodes * worst_case_bits(HEARTBEAT_BYTES) / timing.heartbeat_period_s / bitrate
    cyclic = burst / timing.period_s / bitrate
    load = cyclic + sum(free.values()) + heartbeats
    shares = [f"{name} {share:.1%}" for name, share in free.items()]
    yield Finding(
        f"{bus.label} load",
        graded(load, NOTICE, LIMIT),
        f"{load:.1%} of {bitrate} bit/s, at most {LIMIT:.0%}: "
        + ", ".join([f"PDOs and SYNC {cyclic:.1%}", *shares, f"heartbeats {heartbeats:.1%}"]),
        {"load": load, "limit": LIMIT, "cyclic": cyclic, **free, "heartbeats": heartbeats},
    )
    n = sum(isinstance(entry.section, DriveSection) for entry in devices)
    burst_s = burst / bitrate
    yield Finding(
        f"{bus.label} cycle",
        graded(burst_s, 0.5 * timing.period_s, timing.period_s),
        f"SYNC, {n} replies and {n} commands take {burst_s * 1e3:.2f} ms of a period of "
        f"{timing.period_s * 1e3:g} ms",
        {"burst_s": burst_s, "period_s": timing.period_s},
    )
