"""The CAN buses of a simulated cell: one in-process hub for each, in virtual time."""

from collections.abc import Callable
from functools import partial

from ...config.load import Cell
from ...drivers.bus import CanMessage, Hub, InProcessBus
from ...drivers.fieldbus import Fieldbus, Fieldbuses

PUMP_STEPS = 500
"""A device that is silent for this many physics steps does not answer [1]."""

Heard = Callable[[int, CanMessage], None]
"""Called with the index of the bus and every frame on it."""


class VirtualBuses:
    """Joins daemon, rig and listeners on every bus.

    `pump` lets virtual time pass while the daemon waits, as it may in BOOT: it is told to run until
    a condition holds, for at most so many physics steps.
    """

    def __init__(
        self,
        cell: Cell,
        clock: Callable[[], float],
        pump: Callable[[Callable[[], bool], int], None],
    ) -> None:
        configs = cell.config.fieldbuses
        self.hubs = tuple(Hub() for _ in configs)
        ours = [InProcessBus(hub) for hub in self.hubs]
        self.of_rig = tuple(InProcessBus(hub) for hub in self.hubs)
        self.of_daemon = Fieldbuses(
            *(Fieldbus(bus, clock, config.label) for bus, config in zip(ours, configs, strict=True))
        )
        for hub, bus in zip(self.hubs, ours, strict=True):
            hub.pump = partial(pump, partial(_has_frames, bus), PUMP_STEPS)

    def listen(self, heard: Heard) -> None:
        """Tell of every frame from now on, whoever sends it."""
        for i, hub in enumerate(self.hubs):
            InProcessBus(hub, partial(heard, i))

    def listen_to_daemon(self, heard: Callable[[int, int, bytes], None]) -> None:
        """Tell index of the bus, identifier and data of every frame that the daemon sends."""
        for i, fieldbus in enumerate(self.of_daemon):
            fieldbus.taps.append(partial(heard, i))

    def set_time(self, time_s: float) -> None:
        """Set the time that frames are stamped with [s]."""
        for hub in self.hubs:
            hub.time_s = time_s

    def close(self) -> None:
        """Let every member leave."""
        for hub in self.hubs:
            hub.close()


def _has_frames(bus: InProcessBus) -> bool:
    return bus.waiting > 0
