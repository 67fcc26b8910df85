"""The contract that every device driver keeps, roles of devices, and what can be wrong with one."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..protocols.canopen import can301
from ..protocols.canopen.can301 import EmcyCode
from ..protocols.canopen.cia402 import DriveState, Status

# --- The contract that every device driver keeps, and what can be wrong with a device -------------
#
# A driver is behaviour; its tables are data in `protocols/`. Its life is
#
#     open()  ->  [ read() -> write() ]*  ->  stop()  ->  close()
#
# `open` may block and raises `DeviceError`; it runs in BOOT and READY only. `read` and `write`
# never block: `read` returns what the device last said, with its age, and never invents a state
# that was not received. `stop` asks the device to come to rest by its own means, at once, and is
# safe to call in any state, more than once. `close` leaves the device de-energised where it can
# be, and never raises.
#
# `Device` is the part that all devices share; the rest of this module adds what the server asks
# of joints' drives, a wrench sensor or an output. `kinds.py` lists the kinds of devices.

Value = str | int | float | bool | None
"""Value in an event or in telemetry."""


class DeviceError(Exception):
    """A device could not be opened or configured: names the device, the step and the answer."""


class Cause(StrEnum):
    """Why a device cannot go on; expected trouble, so an enum and not an exception."""

    DRIVE_FAULT = "drive_fault"
    EMERGENCY = "emergency"
    PDO_LOST = "pdo_lost"
    HEARTBEAT_LOST = "heartbeat_lost"
    NODE_RESTARTED = "node_restarted"
    FOLLOWING_ERROR = "following_error"
    STATE_LOST = "state_lost"
    POWER_LOST = "power_lost"
    SECOND_MASTER = "second_master"
    FOREIGN_PDO = "foreign_pdo"
    BUS_ERROR = "bus_error"
    BUS_SILENT = "bus_silent"
    SATURATED = "saturated"
    UNCHANGING = "unchanging"


@dataclass(frozen=True)
class Trouble:
    """Fault of a device, in words and in values."""

    cause: Cause
    device: str
    detail: str
    values: dict[str, Value] = field(default_factory=dict)


class Reading(Protocol):
    """Newest reading of a device; each device adds fields of its own."""

    @property
    def trouble(self) -> Trouble | None:
        """Reason why the device cannot go on."""
        ...


class Device(ABC):
    """One device on a CAN bus; see the module's docstring."""

    vital: ClassVar[bool] = True
    """Its trouble stops every drive at once."""

    name: str
    """Name that events and errors use, unique in the cell: the joint's, or the sensor's."""
    bus: str
    """Name of the fieldbus that it is on."""
    part: int | None = None
    """Place of its mechanism among the cell's; None for a device that the cell has once."""

    @abstractmethod
    def open(self) -> None:
        """Bring the device up and configure it. May block. Raises `DeviceError`."""

    @abstractmethod
    def stop(self) -> None:
        """Let the device stop by its own means, now."""

    @abstractmethod
    def close(self) -> None:
        """De-energise and let go. Never raises."""

    def interlock(self) -> str | None:
        """Return why the arm may not move now; None: it may. A moving arm makes a verified stop."""
        return None

    def values(self) -> dict[str, Value]:
        """Return the values that telemetry shows under the device's name."""
        return {}


class Peripheral(Device):
    """A device beside the drives, which is read by itself."""

    @abstractmethod
    def read(self) -> Reading:
        """Return the newest reading; ages count up to `Fieldbus.now`."""


# --- Status of servo drives, and which statuswords are wrong --------------------------------------

MOST_MISSED_SYNCS: Final = 3
"""More SYNCs than this without an answer mean that the drive is lost."""
RESET_SYNCS: Final = 25
"""A fault reset that has not worked after this many SYNCs is given up."""
OBEYED_SYNCS: Final = 3
"""A drive's setpoint takes effect at the next SYNC; the one after samples it, and that answer may
be counted as one to the SYNC after it: only from here on a statusword is about it."""
SWITCH_OFF_S: Final = 1.0
"""A drive that is still on, or in its quick stop, so long after it was told to switch off does not
do it by itself: closing a brake and a quick stop's ramp take less [s]."""


class DriveReadings(NamedTuple):
    """What n drives last told; a drive that has not answered yet is in no state."""

    heard: bool
    """Every drive has answered once."""
    age_syncs: tuple[int, ...]
    """SYNCs sent since the one that each last answered."""
    sampled_s: tuple[float | None, ...]
    """When each sampled, at the SYNC that it answered [s], on `Fieldbus.clock`; None: not known.
    Stamps of the bus have another clock."""
    q: NDArray[np.float64]
    """Angles of their joints (n,) [rad]; of no meaning where one has not answered."""
    tau: NDArray[np.float64]
    """Their torques (n,) [N·m]."""
    states: tuple[DriveState | None, ...]
    """None also where the statusword means no state."""
    obeyed: bool
    """Every state was sampled after what its drive was last told to do took effect."""
    troubles: tuple[Trouble | None, ...]


def wrong_emergency(code: int) -> tuple[Cause, str, dict[str, str | int]]:
    """Return cause, words and values of an emergency message."""
    followed = code == EmcyCode.FOLLOWING_ERROR
    name = can301.emcy_name(code)
    cause = Cause.FOLLOWING_ERROR if followed else Cause.EMERGENCY
    return cause, f"emergency {code:#06x}: {name}", {"code": code, "name": name}


def wrong_status(
    word: int, state: DriveState | None, *, meant: bool, overdue: bool
) -> tuple[Cause, str] | None:
    """Return what is wrong with a statusword that means `state`, or None.

    `meant`: the drive is to be in *Operation enabled*, and was. `overdue`: it should long be off.
    """
    if state is None:
        return Cause.STATE_LOST, f"statusword {word:#06x} means no state"
    if word & Status.FOLLOWING_ERROR and (meant or state.in_fault):
        return Cause.FOLLOWING_ERROR, "following error beyond 6065h"
    if state.in_fault:
        return Cause.DRIVE_FAULT, state.name.lower()
    if meant and not word & Status.VOLTAGE_ENABLED:
        return Cause.POWER_LOST, "no voltage on the power stage"
    if meant and state is not DriveState.OPERATION_ENABLED:
        return Cause.STATE_LOST, f"left operation_enabled for {state.name.lower()} unasked"
    if overdue and state is DriveState.OPERATION_ENABLED:
        return Cause.STATE_LOST, "stays in operation_enabled, told to switch off"
    return None


# --- Roles of devices: a joint's drive, a wrench sensor, an output; and their readings ------------


@dataclass(frozen=True, slots=True)
class WrenchReading:
    """The newest sample. Until the first one came there is none: `ready` is false."""

    ready: bool
    wrench: NDArray[np.float64] | None
    """(6,) [N, N·m], force first: what the arm exerts on its environment, at the Sensor frame's
    origin and in its axes. Weight and bias are still in it."""
    stamp: float
    """The bus' stamp of the sample's second half [s], on the bus' own clock."""
    age_s: float
    trouble: Trouble | None


@dataclass(frozen=True, slots=True)
class MeanWrench:
    """The mean of several samples, without the aliases that any one of them alone has."""

    wrench: NDArray[np.float64]
    """(6,) [N, N·m], signed and placed as a `WrenchReading`'s."""
    stamp: float
    """Mean of their stamps [s], on the bus' own clock."""
    jump: NDArray[np.float64]
    """By how much a sample is off its two neighbours' mean (6,), where it is most [N, N·m]: contact
    that chatters between samples is known no better."""


class JointDrive(Device):
    """Drive of one joint, whose setpoint is rad, rad/s or N·m as its operation mode is.

    It is opened, asked and stopped by itself; all of a cell are read and written together, by the
    `JointDrives` that it makes with others of its kind.
    """

    @classmethod
    @abstractmethod
    def together(cls, drives: "Sequence[JointDrive]") -> "JointDrives":
        """Return what reads and writes drives of this kind, in this order."""

    @abstractmethod
    def request_enable(self) -> None:
        """Step towards *Operation enabled* with the coming writes."""

    @abstractmethod
    def request_disable(self) -> None:
        """Step towards power off with the coming writes."""

    @abstractmethod
    def request_fault_reset(self) -> None:
        """Acknowledge trouble and stop, and reset the drive's fault."""

    def tell_ramp(self, deceleration: float) -> None:
        """Tell the ramp of a quick stop that is about to be sent [rad/s²].

        A drive that cannot be told keeps its own.
        """

    @abstractmethod
    def prepare(self, torque: float) -> bool:
        """Prepare the drive, while off, for its joint's position, and a torque that holds it [N·m].

        Returns whether it blocked.
        """


class JointDrives(ABC):
    """The cyclic part of n drives: what they tell, and the setpoints that they are sent."""

    @abstractmethod
    def answered(self) -> tuple[bool, ...]:
        """Return which drives have answered the newest SYNC."""

    @abstractmethod
    def stamp(self, drive: int) -> float:
        """Return the bus' stamp of a drive's newest answer to a SYNC [s], on the bus' own clock."""

    @abstractmethod
    def emergency(self) -> Trouble | None:
        """Return trouble that a drive tells of at once, asked by no SYNC; None where none does."""

    @abstractmethod
    def read(self) -> DriveReadings:
        """Return the newest answers, and what is wrong with each drive."""

    @abstractmethod
    def write(self, command: NDArray[np.float64]) -> None:
        """Send setpoints (n,), all or none. Raises `ValueError` for one out of range."""


class WrenchSensor(Peripheral):
    """Force/torque sensor at the wrist."""

    @abstractmethod
    def read(self) -> WrenchReading:
        """Return the newest sample."""

    @abstractmethod
    def mean(self) -> MeanWrench | None:
        """Return the mean of the samples since the last call; None before the first sample."""


@dataclass(frozen=True, slots=True)
class InertialReading:
    """Newest sample, both halves of one SYNC; until the first one there is none."""

    ready: bool
    acceleration: NDArray[np.float64] | None
    """Specific force (3,) [m/s²] less bias, in the unit's axes; None when stale or saturated."""
    rate: NDArray[np.float64] | None
    """Angular rate (3,) [rad/s] less bias, in the unit's axes; None when stale or saturated."""
    trouble: Trouble | None


class InertialSensor(Peripheral):
    """Accelerometer and gyroscope on a link."""

    @abstractmethod
    def read(self) -> InertialReading:
        """Return the newest sample."""


class SwitchedOutput(Peripheral):
    """Something that is switched on and off."""

    @abstractmethod
    def write(self, command: bool) -> bool:
        """Switch it, now and with every call; return what was commanded."""
