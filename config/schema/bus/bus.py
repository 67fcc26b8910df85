"""Schema of a CAN bus."""

from pydantic import Field

from ..section import Name, Section


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
