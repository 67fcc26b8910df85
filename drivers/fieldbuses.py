"""All CAN buses of a cell as one: SYNC on all at one instant, answers from all."""

import select
from collections.abc import Callable, Iterator

from ..config.load import Cell
from .bus import open_bus
from .device import DeviceError, Trouble
from .fieldbus import Fieldbus

POLL_S = 5e-4
"""A bus with nothing to select on is looked at so often while another one is waited for [s]."""


class Fieldbuses:
    """The fieldbuses of one cell, in the order of its file."""

    def __init__(self, *fieldbuses: Fieldbus) -> None:
        self._all = fieldbuses

    def __iter__(self) -> Iterator[Fieldbus]:
        return iter(self._all)

    def __getitem__(self, index: int) -> Fieldbus:
        return self._all[index]

    @property
    def trouble(self) -> Trouble | None:
        """The trouble of the first bus that has any."""
        for bus in self._all:
            if bus.trouble is not None:
                return bus.trouble
        return None

    def now(self) -> float:
        """Return the time of the buses' common clock [s]."""
        return self._all[0].clock()

    def sync(self) -> None:
        """Send SYNC on every bus, back to back."""
        for bus in self._all:
            bus.sync()

    def heartbeat(self) -> None:
        """Send the master's heartbeat on every bus."""
        for bus in self._all:
            bus.heartbeat()

    def receive(self, now_s: float) -> None:
        """Dispatch every frame that is there, without blocking."""
        for bus in self._all:
            bus.receive(now_s)

    def wait(self, timeout_s: float) -> None:
        """Block until there may be a frame to receive on any bus, or until the timeout [s]."""
        if len(self._all) == 1:
            self._all[0].wait(timeout_s)
            return
        descriptors = [bus.descriptor for bus in self._all]
        if -1 not in descriptors:
            select.select(descriptors, [], [], max(0.0, timeout_s))
            return
        for bus in self._all:
            if bus.wait(min(timeout_s, POLL_S)):
                return

    def listen(self, seconds: float) -> None:
        """Dispatch what is heard in so long [s], or until there is trouble."""
        first, *others = self._all
        first.wait_until(lambda: first.trouble is not None, seconds)
        for bus in others:  # meanwhile their frames have waited
            bus.receive(bus.clock())

    def clear_trouble(self) -> None:
        """Forget what was wrong; it is noticed again if it still is."""
        for bus in self._all:
            bus.clear_trouble()

    def close(self) -> None:
        """Leave every bus. Never raises."""
        for bus in self._all:
            bus.close()


def open_buses(cell: Cell, clock: Callable[[], float]) -> Fieldbuses:
    """Open the buses of a cell, all or none. Raises `DeviceError` for one that cannot be."""
    buses: list[Fieldbus] = []
    try:
        for config in cell.config.fieldbuses:
            bus = open_bus(config)
            buses.append(Fieldbus(bus, clock, config.label))
    except DeviceError:
        Fieldbuses(*buses).close()
        raise
    return Fieldbuses(*buses)
