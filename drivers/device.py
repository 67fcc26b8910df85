"""The contract that every device driver keeps, and what can be wrong with a device.

A driver is behaviour; its tables are data in `protocols/`. Its life is

    open()  ->  [ read() -> write() ]*  ->  stop()  ->  close()

`open` may block and raises `DeviceError`; it runs in BOOT and READY only. `read` and `write` never
block: `read` returns what the device last said, with its age, and never invents a state that was
not received; `write` returns what was really sent. `stop` asks the device to come to rest by its
own means, at once, and is safe to call in any state, more than once. `close` leaves the device
de-energised where it can be, and never raises.

`Device` is the part that all devices share; `roles.py` adds what the server asks of a joint's
drive, a wrench sensor or an output. `kinds.py` lists the kinds of devices there are.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import StrEnum
from typing import ClassVar, Protocol

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
    def read(self) -> Reading:
        """Return the newest reading; ages count up to `Fieldbus.now`."""

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
