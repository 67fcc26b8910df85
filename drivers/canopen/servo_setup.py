"""Set-up of a servo drive over SDO before it may move: a table, and how it is written."""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import can
import canopen
from canopen.sdo.exceptions import SdoError

from ...config.schema.cell import TimingSection
from ...config.schema.mechanism import DriveSection
from ...protocols.canopen import can301, cia402
from ...protocols.canopen.can301 import CommunicationObject as Com
from ...protocols.canopen.can301 import FrameError
from ...protocols.canopen.cia402 import (
    AbortConnectionOption,
    Controlword,
    DriveState,
    Object,
    OperationMode,
    QuickStopOption,
)
from ..device import DeviceError

# --- Setpoints in RPDO1 in each cyclic synchronous mode: joint units to raw values, and back ------

_I16_MAX: Final = 2**15 - 1
_I32_MAX: Final = 2**31 - 1
_UNIT: Final = {OperationMode.CSP: "rad", OperationMode.CSV: "rad/s", OperationMode.CST: "N·m"}
_MOST: Final = {
    OperationMode.CSP: _I32_MAX,
    OperationMode.CSV: _I32_MAX,
    OperationMode.CST: _I16_MAX,
}


@dataclass(frozen=True)
class Setpoint:
    """Setpoints of one drive: rad in CSP (607Ah), rad/s in CSV (60FFh), N·m in CST (6071h)."""

    drive: DriveSection
    mode: OperationMode

    @cached_property
    def scale(self) -> float:
        """Raw units per joint unit: counts, counts per second, or thousandths of rated torque."""
        if self.mode is OperationMode.CST:
            return self.drive.direction * 1000.0 / self.drive.rated_torque
        return self.drive.direction * self.drive.counts_per_radian

    @cached_property
    def zero(self) -> float:
        """The command at raw zero; only a position has one of its own."""
        return self.drive.zero_rad if self.mode is OperationMode.CSP else 0.0

    def raw(self, command: float) -> int:
        """Return the nearest raw value to a command.

        Raises `ValueError` if it is not finite, or beyond the bits of its object.
        """
        exact = (command - self.zero) * self.scale
        if not abs(exact) <= _MOST[self.mode]:
            raise ValueError(
                f"{self.drive.joint}: {command} {_UNIT[self.mode]} is beyond the bits of the "
                f"drive's setpoint"
            )
        return round(exact)

    def command(self, raw: int) -> float:
        """Return what a raw value asks of the joint."""
        return self.zero + raw / self.scale

    def still(self, position: int) -> int:
        """Return the raw value that asks for no motion with the drive at `position` [counts].

        In CST it is no torque: it goes out after a stop only, which the drive runs by itself.
        """
        return position if self.mode is OperationMode.CSP else 0

    def pack(self, controlword: int, raw: int) -> bytes:
        """Return RPDO1."""
        return cia402.COMMAND[self.mode].pack(controlword, raw)


# --- Set-up of a servo drive over SDO before it may move: a table, and how it is written ----------
#
# Each step that fails raises `DeviceError` naming joint, node, object and the drive's answer.

_NO_OBJECT: Final = (0x06020000, 0x06090011)
"""SDO abort codes: no such object, no such subindex."""
_MODE_READS: Final = 20
_STANDSTILL_S: Final = 0.1
"""A drive's quick stop takes the ramp from its joint's top speed, and so much more [s]."""
_UNDER_POWER: Final = (
    DriveState.SWITCHED_ON, DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE,
)  # fmt: skip
SAG: Final = 0.005
"""A joint is near its limit within this, at least: a joint may sag when it is enabled [rad]."""
_MODE_NAMES: Final = {
    OperationMode.CSP: "cyclic synchronous position",
    OperationMode.CSV: "cyclic synchronous velocity",
    OperationMode.CST: "cyclic synchronous torque",
}

U8, I8, U16, I16, U32, I32 = "<B", "<b", "<H", "<h", "<I", "<i"


class SetupWrite(NamedTuple):
    """One object to write: `optional` if a drive may do without it."""

    object_index: int
    subindex: int
    layout: str
    value: int
    optional: bool = False


def to_counts(drive: DriveSection, position_rad: float) -> int:
    """Return the encoder counts nearest to a joint angle [rad].

    Raises `ValueError` if it is not finite, or beyond the 32 bits of 607Ah.
    """
    return Setpoint(drive, OperationMode.CSP).raw(position_rad)


def to_radians(drive: DriveSection, counts: int) -> float:
    """Return the joint angle [rad] at an encoder reading."""
    return drive.zero_rad + drive.direction * counts / drive.counts_per_radian


def whole_range(drive: DriveSection) -> tuple[float, float]:
    """Return the joint angles [rad] at both ends of 607Dh, which then bounds nothing."""
    half = (2**31 - 2) / drive.counts_per_radian
    return drive.zero_rad - half, drive.zero_rad + half


def steps(
    drive: DriveSection, timing: TimingSection, lower: float, upper: float, mode: OperationMode
) -> Iterator[SetupWrite]:
    """Yield what to write, in order (CiA 301, CiA 402-2); `lower`, `upper` are URDF limits [rad].

    Raises `ValueError` for a limit that the drive's counts cannot hold.
    """
    scale = drive.counts_per_radian
    watch = can301.consumer_heartbeat(can301.MASTER_NODE, _ms(timing.heartbeat_timeout_s))
    yield SetupWrite(Com.CONSUMER_HEARTBEAT, 1, U32, watch)
    yield SetupWrite(Com.PRODUCER_HEARTBEAT, 0, U16, _ms(timing.heartbeat_period_s))
    yield SetupWrite(Object.ABORT_CONNECTION_OPTION, 0, I16, AbortConnectionOption.QUICK_STOP)
    yield SetupWrite(Object.QUICK_STOP_OPTION, 0, I16, QuickStopOption.RAMP_THEN_DISABLE)
    ramp = min(round(drive.quick_stop_deceleration * scale), 2**32 - 1)
    yield SetupWrite(Object.QUICK_STOP_DECELERATION, 0, U32, ramp)
    yield SetupWrite(Object.FOLLOWING_WINDOW, 0, U32, round(drive.window * scale))
    yield SetupWrite(Object.FOLLOWING_TIMEOUT, 0, U16, _ms(timing.period_s))
    yield from position_limits(drive, lower, upper)
    value, exponent = interpolation_period(timing.period_s)
    yield SetupWrite(Object.INTERPOLATION_PERIOD, 1, U8, value)
    yield SetupWrite(Object.INTERPOLATION_PERIOD, 2, I8, exponent)
    yield SetupWrite(Object.SETPOINT_TIMEOUT, 0, U16, _ms(timing.setpoint_timeout_s))
    # Another master's, which drives add to every setpoint.
    yield SetupWrite(Object.POSITION_OFFSET, 0, I32, 0, optional=True)
    yield SetupWrite(Object.VELOCITY_OFFSET, 0, I32, 0, optional=True)
    yield SetupWrite(Object.TORQUE_OFFSET, 0, I16, 0, optional=True)
    yield from _pdos(drive.node, mode)
    yield SetupWrite(Object.MODE_OF_OPERATION, 0, I8, mode)


def position_limits(drive: DriveSection, lower: float, upper: float) -> Iterator[SetupWrite]:
    """Yield what to write so that 607Dh holds a range of joint angles [rad].

    Raises `ValueError` for a limit that the drive's counts cannot hold.
    """
    low, high = sorted((to_counts(drive, lower), to_counts(drive, upper)))
    yield SetupWrite(Object.POSITION_LIMIT, 1, I32, low)
    yield SetupWrite(Object.POSITION_LIMIT, 2, I32, high)


def write_limits(node: canopen.RemoteNode, drive: DriveSection, lower: float, upper: float) -> None:
    """Write 607Dh. Raises `DeviceError`."""
    for step in position_limits(drive, lower, upper):
        write(node, drive, step)


def write_torque_offset(node: canopen.RemoteNode, drive: DriveSection, value: int) -> None:
    """Write 60B2h, which a drive may lack. Raises `DeviceError`."""
    write(node, drive, SetupWrite(Object.TORQUE_OFFSET, 0, I16, value, optional=True))


def room(drive: DriveSection, lower: float, upper: float, q: float) -> tuple[float, float]:
    """Return the range of 607Dh for a joint that stands at `q`, with limits `lower`, `upper` [rad].

    It is that of the limits, except where the joint stands beyond what is commanded: there it
    reaches a following window beyond the joint. A drive clamps setpoints beyond 607Dh, so it would
    take the joint to the limit at once, and as fast as its loops can, when it is enabled.
    """
    near, window = max(drive.position_margin, SAG), drive.window
    return (
        min(lower, q - window) if q < lower + near else lower,
        max(upper, q + window) if q > upper - near else upper,
    )


def interpolation_period(period_s: float) -> tuple[int, int]:
    """Return 60C2h:1 and :2 so that `value · 10^exponent` is the period [s].

    Raises `ValueError` if no value of 1 to 255 says it exactly enough (1 ppm).
    """
    for exponent in (-3, -4, -5, -6):
        value = round(period_s * 10**-exponent)
        if 1 <= value <= 255 and abs(value * 10**exponent - period_s) < 1e-6 * period_s:
            return value, exponent
    raise ValueError(f"a period of {period_s} s cannot be written to 60C2h")


def configure(
    node: canopen.RemoteNode,
    drive: DriveSection,
    timing: TimingSection,
    lower: float,
    upper: float,
    mode: OperationMode,
    wait: Callable[[float], object],
) -> None:
    """Write all steps to a drive in *Pre-operational*, and check its mode. Raises `DeviceError`.

    One that another master left on is switched off first: a drive sets no mode under power.
    `wait` lets a time [s] pass.
    """
    supported = read(node, drive, Object.SUPPORTED_MODES, 0, U32)
    if not cia402.supports_mode(supported, mode):
        raise DeviceError(
            f"{_who(drive)}: {_object(Object.SUPPORTED_MODES, 0)} is {supported:#x}: "
            f"{_MODE_NAMES[mode]} is not among the drive's modes"
        )
    try:
        plan = tuple(steps(drive, timing, lower, upper, mode))
    except ValueError as error:
        raise DeviceError(f"{_who(drive)}: {error}") from error
    if _left_on(node, drive):
        _switch_off(node, drive, wait)
    for step in plan:
        write(node, drive, step)
    for _ in range(_MODE_READS):
        shown = read(node, drive, Object.MODE_DISPLAY, 0, I8)
        if shown == mode:
            return
    raise DeviceError(
        f"{_who(drive)}: {_object(Object.MODE_DISPLAY, 0)} stays {shown}, not {mode:d}"
    )


def read(
    node: canopen.RemoteNode, drive: DriveSection, index: int, subindex: int, layout: str
) -> int:
    """Read an integer object over SDO. Raises `DeviceError`."""
    try:
        data = node.sdo.upload(index, subindex)
        (value,) = struct.unpack(layout, data[: struct.calcsize(layout)])
    except (SdoError, can.CanError, struct.error) as error:
        raise DeviceError(f"{_who(drive)}: reading {_object(index, subindex)}: {error}") from error
    return int(value)


def write(node: canopen.RemoteNode, drive: DriveSection, step: SetupWrite) -> None:
    """Write an integer object over SDO. Raises `DeviceError`."""
    where = _object(step.object_index, step.subindex)
    try:
        node.sdo.download(step.object_index, step.subindex, struct.pack(step.layout, step.value))
    except (SdoError, can.CanError, struct.error) as error:
        if step.optional and getattr(error, "code", None) in _NO_OBJECT:
            return
        raise DeviceError(f"{_who(drive)}: writing {step.value} to {where}: {error}") from error


def _left_on(node: canopen.RemoteNode, drive: DriveSection) -> bool:
    """Return whether a drive's power stage is on, left so by another master. Raises `DeviceError`.

    A drive that tells no statusword over SDO is taken to be off.
    """
    try:
        (status,) = struct.unpack(U16, node.sdo.upload(Object.STATUSWORD, 0)[:2])
        return cia402.decode_state(status) in _UNDER_POWER
    except FrameError:
        return False
    except (SdoError, can.CanError, struct.error) as error:
        if getattr(error, "code", None) in _NO_OBJECT:
            return False
        where = _object(Object.STATUSWORD, 0)
        raise DeviceError(f"{_who(drive)}: reading {where}: {error}") from error


def _switch_off(
    node: canopen.RemoteNode, drive: DriveSection, wait: Callable[[float], object]
) -> None:
    """Bring a drive to rest on its own ramp, and take its power off. Raises `DeviceError`."""
    write(node, drive, SetupWrite(Object.CONTROLWORD, 0, U16, Controlword.QUICK_STOP))
    wait(drive.max_velocity / drive.quick_stop_deceleration + _STANDSTILL_S)
    write(node, drive, SetupWrite(Object.CONTROLWORD, 0, U16, Controlword.DISABLE_VOLTAGE))


def _pdos(node: int, mode: OperationMode) -> Iterator[SetupWrite]:
    """Map RPDO1 and TPDO1, at every SYNC; disable the other default PDOs (CiA 301, 7.5.2.35 f)."""
    for base, communication, mapping, entries in (
        (0x200, Com.RPDO_COMMUNICATION, Com.RPDO_MAPPING, cia402.COMMAND_MAPPING[mode]),
        (0x180, Com.TPDO_COMMUNICATION, Com.TPDO_MAPPING, cia402.FEEDBACK_MAPPING),
    ):
        for number in range(can301.DEFAULT_PDOS):
            off = can301.PDO_INVALID | base + 0x100 * number + node
            yield SetupWrite(communication + number, 1, U32, off, optional=number > 0)
        yield SetupWrite(communication, 2, U8, can301.EVERY_SYNC)
        yield SetupWrite(mapping, 0, U8, 0)
        for place, entry in enumerate(entries, 1):
            yield SetupWrite(mapping, place, U32, entry)
        yield SetupWrite(mapping, 0, U8, len(entries))
        yield SetupWrite(communication, 1, U32, base + node)


def _ms(seconds: float) -> int:
    return max(1, round(seconds * 1000))


def _who(drive: DriveSection) -> str:
    return f"{drive.joint} (node {drive.node})"


def _object(index: int, subindex: int) -> str:
    known: type[Com] | type[Object] = Object if index in Object.__members__.values() else Com
    name = known(index).name.lower() if index in known.__members__.values() else "pdo"
    return f"{index:04X}h:{subindex} ({name})"
