"""Is there room on the CAN bus for what the cell sends, even if every frame is stuffed?"""

from collections.abc import Iterator

from ...config.load import Cell
from .findings import Finding, graded

LIMIT = 0.80
"""Above this load a classic CAN bus has no room left for SDO, EMCY and repetitions [1]."""
NOTICE = 0.60
RPDO_BYTES = {"csp": 6, "csv": 6, "cst": 4}
TPDO_BYTES = 8
HEARTBEAT_BYTES = 1
SAMPLE_FRAMES = 2
"""A force/torque sample is two frames of 8 bytes."""


def worst_case_bits(data_bytes: int) -> int:
    """Return the bits of a standard frame with the most stuff bits, and the space after it.

    47 + 8n + ⌊(34 + 8n − 1) / 4⌋ (Davis, Burns, Bril, Lukkien 2007, eq. 1).
    """
    return 47 + 8 * data_bytes + (34 + 8 * data_bytes - 1) // 4


def bus_load(cell: Cell) -> Iterator[Finding]:
    """Judge the cyclic traffic against the bit rate, and say what the heartbeats' share is."""
    timing, bitrate = cell.config.timing, cell.config.bus.bitrate
    n = len(cell.config.mechanism.drives)
    mode = cell.config.mechanism.operation_mode
    per_period = worst_case_bits(0) + n * (
        worst_case_bits(RPDO_BYTES[mode]) + worst_case_bits(TPDO_BYTES)
    )
    cyclic = per_period / timing.period_s
    others = 1 if cell.config.mechanism.gripper is None else 2
    heartbeats = (n + others) * worst_case_bits(HEARTBEAT_BYTES) / timing.heartbeat_period_s
    sensor = cell.config.mechanism.force_torque
    samples = 0.0 if sensor is None else SAMPLE_FRAMES * worst_case_bits(8) * sensor.rate_hz
    load = (cyclic + heartbeats + samples) / bitrate
    yield Finding(
        "bus load",
        graded(load, NOTICE, LIMIT),
        f"{load:.1%} of {bitrate} bit/s, at most {LIMIT:.0%}: "
        f"PDOs and SYNC {cyclic / bitrate:.1%}, "
        f"force/torque {samples / bitrate:.1%}, heartbeats {heartbeats / bitrate:.1%}",
        {
            "load": load,
            "limit": LIMIT,
            "cyclic": cyclic / bitrate,
            "force_torque": samples / bitrate,
            "heartbeats": heartbeats / bitrate,
        },
    )
    burst_s = per_period / bitrate
    yield Finding(
        "bus cycle",
        graded(burst_s, 0.5 * timing.period_s, timing.period_s),
        f"SYNC, {n} replies and {n} commands take {burst_s * 1e3:.2f} ms of a period of "
        f"{timing.period_s * 1e3:g} ms",
        {"burst_s": burst_s, "period_s": timing.period_s},
    )
