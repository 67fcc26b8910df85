"""`telerobot.SimulatedOperator`: an operator and the whole cell in one process, in virtual time.

with SimulatedOperator("pa10") as operator:
    operator.acquire()
    operator.enable()
    operator.joystick([0.02, 0, 0, 0, 0, 0], seconds=2.0)
"""

from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from ...config.load import Cell, load_cell
from ...protocols import topics as t
from ...protocols.codec import encode
from ...protocols.messages.messages import Message
from ...protocols.messages.perception import RigMotion
from ...protocols.messages.rig import RigFault
from ..client.operator import Operator
from ..scripts.script import Script
from .simulation import MemoryLink, Simulation, seeded_keys

NOBODY: Final = Script(duration_s=3600.0, auto_enable=False)
"""A script in which nobody does anything."""


class MemoryBuffer:
    """Messages of one topic since the last look."""

    def __init__(self, link: MemoryLink, topic: t.Topic, depth: int) -> None:
        self._topic = topic
        self._kept: deque[bytes] = deque(maxlen=depth)
        link.listen(self._hear)

    def take(self) -> Iterator[bytes]:
        """Yield the payloads that wait, oldest first."""
        while self._kept:
            yield self._kept.popleft()

    def close(self) -> None:
        """Listen no more."""
        self._kept = deque(maxlen=0)

    def _hear(self, topic: t.Topic, message: Message) -> None:
        if topic is self._topic:
            self._kept.append(encode(message))


class MemoryLine:
    """An operator's end of a simulation's link. What is sent is heard in the next tick."""

    def __init__(self, link: MemoryLink) -> None:
        self._link, self.put, self.ask = link, link.put, link.ask
        self.shown: str | None = None
        """No certificate is shown."""

    def subscribe(self, topic: t.Topic, depth: int) -> MemoryBuffer:
        """Listen to a topic, keeping the newest `depth` messages between two looks."""
        return MemoryBuffer(self._link, topic, depth)

    def poll(self) -> None:
        """Do nothing: replies are handed over within the tick that makes them."""

    def close(self) -> None:
        """Do nothing: the link ends with its simulation."""


class SimulatedOperator(Operator):
    """An `Operator` of a simulated cell. Equal programs give equal runs, to the last bit.

    Time passes inside `spin` and the calls that wait, a period of the cell at once, as quickly as
    it can be computed; between them it stands. `simulation` has the truth.
    """

    def __init__(
        self,
        cell: str | Cell | Simulation,
        name: str = "operator",
        record: Path | None = None,
    ) -> None:
        """Start the cell, and record it to a file if there is one; or join a simulation.

        Raises `ConfigError` for a cell that is wrong or has no virtual hardware, `OSError`.
        """
        self._owns = not isinstance(cell, Simulation)
        if isinstance(cell, Simulation):
            self.simulation = cell
        else:
            loaded = cell if isinstance(cell, Cell) else load_cell(cell)
            self.simulation = Simulation(loaded, NOBODY, record)
            self.simulation.cycle.boot()
        self.endpoint = "in this process"
        line, clock = MemoryLine(self.simulation.link), self.simulation.clock
        self._begin(self.simulation.cell, name, line, clock)
        self.client.new_key = seeded_keys(f"operator {name}")

    def inject(self, fault: RigFault | RigMotion) -> None:
        """Inject a fault into the virtual hardware, or move what stands there."""
        self.simulation.rig.inject(fault)

    def close(self) -> None:
        """Release the lease, if held, and end the simulation that was started here."""
        super().close()
        if self._owns:
            self.simulation.close()

    def _rest(self) -> None:
        self.simulation.step()
