"""The contract that every device driver keeps, and what can be wrong with a device.

A driver is behaviour; its tables are data in `protocols/`. Its life is

    open()  ->  [ read() -> write() ]*  ->  stop()  ->  close()

`open` may block and raises `DeviceError`; it runs in BOOT and READY only. `read` and `write` never
block: `read` returns what the device last said, with its age, and never invents a state that was
not received; `write` returns what was really sent. `stop` asks the device to come to rest by its
own means, at once, and is safe to call in any state, more than once. `close` leaves the device
de-energised where it can be, and never raises.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol, TypeVar

Reading_co = TypeVar("Reading_co", covariant=True)
Command_contra = TypeVar("Command_contra", contravariant=True)
Sent_co = TypeVar("Sent_co", covariant=True)


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
    BUS_ERROR = "bus_error"


@dataclass(frozen=True)
class Trouble:
    """What is wrong with which device, in words and in values."""

    cause: Cause
    device: str
    detail: str
    values: dict[str, str | int | float | bool | None] = field(default_factory=dict)


class Device(Protocol[Reading_co, Command_contra, Sent_co]):
    """See the module's docstring."""

    @property
    def name(self) -> str:
        """Name that events and errors use: the joint's, or the sensor's."""
        ...

    def open(self) -> None:
        """Bring the device up and configure it. May block. Raises `DeviceError`."""
        ...

    def read(self) -> Reading_co:
        """Return what the device last said, with its age."""
        ...

    def write(self, command: Command_contra) -> Sent_co:
        """Send a command; return what was really sent."""
        ...

    def stop(self) -> None:
        """Let the device stop by its own means, now."""
        ...

    def close(self) -> None:
        """De-energise and let go. Never raises."""
        ...
