"""An arm on a gantry: rails that an operator drives, and that share the work of a tool led far.

The law is that of `DrivenArm`. Rails stand in World, so that a motion relative to Base is one in
World, and they are ordinary joints: with limits, postures and objectives like the arm's.
"""

from functools import partial

import numpy as np

from ....config.load import Cell
from ....config.schema.mechanism import GantrySection
from ..inputs import DriveRequest, Inputs
from ..mechanism.model import Mechanism
from ..mechanism.redundancy import Field, Redundancy
from ..parameters import Parameters
from ..spatial import Array
from .body import Builder
from .wheels import STANDING, DrivenArm


class GantryArm(DrivenArm):
    """An arm on one to three prismatic joints."""

    def __init__(
        self,
        section: GantrySection,
        p: Parameters,
        mechanism: Mechanism,
        redundancy: Redundancy,
        field: Field,
    ) -> None:
        """Build it."""
        self._axes = len(section.joints)
        rails = slice(0, self._axes)
        super().__init__(rails, section, p, mechanism, redundancy, field)

    @classmethod
    def builder(cls, cell: Cell) -> Builder | None:
        """Return what builds it for a cell with a gantry."""
        section = cell.config.mechanism.gantry
        return None if section is None else partial(cls, section)

    def asked(self, drive: DriveRequest) -> Array:
        """Return the rails' rates [m/s] of a drive, which knows of the first two."""
        return np.array((drive.speed, drive.turn, 0.0)[: self._axes])

    def holding_back(self, base: Array) -> Array:
        """Return the shares (n,): rails that nobody drives stand."""
        shares = self._with.copy()
        shares[self._base][base == 0.0] = STANDING
        return shares

    def with_drive(self, rates: Array, drive: DriveRequest, factor: float) -> Array:
        """Return joint rates (n,) towards a posture, also of rails that nobody drives."""
        driven = bool(np.count_nonzero(self.asked(drive)))
        return super().with_drive(rates, drive, factor) if driven else rates

    def works_alone(self, inputs: Inputs) -> bool:  # noqa: ARG002  others look
        """Rails stand in World: relative to Base is relative to it."""
        return False
