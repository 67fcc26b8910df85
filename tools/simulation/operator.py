"""`telerobot.SimulatedOperator`: an operator and the whole cell in one process, in virtual time.

with SimulatedOperator("pa10") as operator:
    operator.acquire()
    operator.enable()
    operator.joystick([0.02, 0, 0, 0, 0, 0], seconds=2.0)
"""

from pathlib import Path
from typing import Final

from ...config.load import Cell, load_cell
from ...protocols.messages.perception import RigMotion
from ...protocols.messages.rig import RigFault
from ...server.operators.link import MemoryLine
from ..client.operator import Operator
from ..scripts.script import Script
from .simulation import Simulation, seeded_keys

NOBODY: Final = Script(duration_s=3600.0, auto_enable=False)
"""A script in which nobody does anything."""


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
