"""Schema of a CAN bus, of what every device on it has, and of an enabling switch."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Final

from pydantic import Field

from .section import Name, Section

# --- Schema of a CAN bus --------------------------------------------------------------------------


class BusSection(Section):
    """A CAN bus: any python-can interface, or one of the two that need no hardware."""

    name: Name = Field("bus", description="what devices, events and faults call it")
    interface: str = Field(
        "loopback",
        description="'loopback' (UDP pinned to 127.0.0.1, between processes), 'in_process', or any "
        "python-can interface, for instance 'socketcan'",
    )
    channel: str = Field(
        "239.74.163.10",
        description="python-can channel: 'can0' for socketcan, a multicast group for loopback",
    )
    port: int = Field(43210, ge=1024, le=65535, description="UDP port of a loopback bus [1]")
    bitrate: int = Field(1_000_000, ge=10_000, le=1_000_000, description="bits per second [1/s]")
    options: dict[str, str | int | float | bool] = Field(
        default_factory=dict, description="passed to python-can as they stand"
    )

    @property
    def label(self) -> str:
        """Name for people: `bus`, or `bus NAME` where it has one."""
        return self.name if self.name == "bus" else f"bus {self.name}"

    @property
    def place(self) -> str:
        """Channel, and port where there is one."""
        return f"{self.channel}:{self.port}" if self.interface == "loopback" else self.channel


# --- Fields of every device on a CAN bus: its bus, its identifiers, its cyclic frames -------------

NodeId = Annotated[int, Field(ge=1, le=127)]
CanId = Annotated[int, Field(ge=0, le=0x7FF)]

Unsigned32 = Annotated[int, Field(ge=0, le=0xFFFFFFFF)]

CANOPEN_BASES: Final = (0x080, 0x180, 0x200, 0x580, 0x600, 0x700)
"""Of every node: EMCY, TPDO1, RPDO1, SDO answer, SDO request, heartbeat (CiA 301, 7.3.5)."""


@dataclass(frozen=True)
class BusFrames:
    """Frames of one kind that a device exchanges with the daemon."""

    data_bytes: int
    rate_hz: float | None = None
    """None: one frame every control period, in the burst after SYNC."""
    count: int = 1


class OnBusSection(Section, ABC):
    """Base of a device's table."""

    bus: Name | None = Field(
        None, description="bus that it is on; none: its mechanism's, or the first"
    )

    @abstractmethod
    def identifiers(self) -> tuple[tuple[str, int], ...]:
        """Return the CAN identifiers that it uses, each with the key that sets it."""

    @abstractmethod
    def frames(self, operation_mode: str) -> tuple[BusFrames, ...]:
        """Return its process data; `operation_mode` is that of the mechanism's drives."""

    def about(self) -> str:
        """Return what `telerobot check` says of it in one line; nothing for most."""
        return ""


class NodeIdentitySection(Section):
    """Identity of a CANopen node, 1018h, which `telerobot check CELL --bus` compares."""

    vendor: Unsigned32 | None = Field(None, description="vendor-ID, 1018h:1")
    product: Unsigned32 | None = Field(None, description="product code, 1018h:2")
    revision: Unsigned32 | None = Field(None, description="revision number, 1018h:3")
    serial: Unsigned32 | None = Field(None, description="serial number, 1018h:4")


class CanOpenNodeSection(OnBusSection):
    """Base of the table of a CANopen node, which has a heartbeat, too."""

    node: NodeId = Field(description="CANopen node id [1]")
    identity: NodeIdentitySection | None = Field(
        None, description="who it is, where that is to be compared; none: anybody"
    )

    def identifiers(self) -> tuple[tuple[str, int], ...]:
        """Return those of the predefined connection set."""
        return tuple(("node", base + self.node) for base in CANOPEN_BASES)


@dataclass(frozen=True)
class Entry:
    """One device of a cell: where its table stands, its name, and the table."""

    key: str
    """Place in the cell file, for errors."""
    name: str
    """Name that events, faults and telemetry use, unique in the cell."""
    section: OnBusSection
    bus: str
    """Bus that it is on."""
    owner: str
    """Words for its name in an error."""
    part: int | None
    """Place of its mechanism among the cell's; None for one that the cell has once."""


# --- Schema of an enabling switch (IEC 60204-1, 10.9) ---------------------------------------------


class EnablingSwitchSection(CanOpenNodeSection):
    """A hold-to-run switch on digital inputs of a CiA 401 module: released, the arm stands."""

    inputs: tuple[Annotated[int, Field(ge=0, le=7)], ...] = Field(
        (0, 1),
        min_length=1,
        max_length=8,
        description="bits of 6000h:01, one for each contact: it is held while all of them are on",
    )

    def frames(self, operation_mode: str) -> tuple[BusFrames, ...]:  # noqa: ARG002  it has none
        """Return its answer to SYNC."""
        return (BusFrames(1),)
