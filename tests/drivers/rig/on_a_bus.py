"""A rig on an in-process bus with a master of one's own, in physics time."""

from telerobot.config.load import Cell
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.fieldbus import Fieldbus
from telerobot.drivers.rig.rig import Rig

MOST_STEPS = 20
"""Physics steps that pass at most until somebody who waits looks again [1]."""


class OnABus:
    """Physics time passes while the master waits for a frame."""

    def __init__(self, cell: Cell) -> None:
        self.hub = Hub()
        self.sent: list[tuple[int, bytes]] = []
        """Frames of the master, in order."""
        self._rig_bus = InProcessBus(self.hub)
        self.rig = Rig(cell, self._rig_bus)
        self.bus = InProcessBus(self.hub)
        self.fieldbus = Fieldbus(self.bus, clock=self.rig.now)
        self.hub.pump = self.pump
        self.fieldbus.taps.append(lambda can_id, data: self.sent.append((can_id, data)))
        self.drives = {d.joint: d for d in cell.config.mechanism.drives}

    def pump(self) -> None:
        """Let physics time pass until the master hears something."""
        for _ in range(MOST_STEPS):
            self.rig.poll()
            if self.bus.waiting:
                return
            self.rig.step()

    def node(self, joint: str) -> int:
        return self.drives[joint].node

    def close(self) -> None:
        self.hub.close()
