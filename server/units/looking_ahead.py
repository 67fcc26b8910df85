"""Effect of a contour ahead on a tick: a base that is driven ahead slows down, the arm folds.

An axis that sweeps goes on sweeping. Avoidance switched off leaves the rest to the operator.
"""

from typing import Self

from ...config.load import Cell
from ..commands.in_force import InForce
from ..control.mechanism.joint_motion import Beside, Fold
from ..control.spatial import Array
from ..perception.ahead.passage import Passage
from .sweep import SweptAxis


class LookingAhead:
    """The reflex of one arm, between what operators ask for and the tick."""

    def __init__(self, sweep: SweptAxis | None, speed: float) -> None:
        """Build it; the tool folds at most at a speed [m/s]."""
        self._sweep, self._speed = sweep, speed

    @classmethod
    def from_cell(cls, cell: Cell) -> Self | None:
        """Return that of a cell; None for one that neither sweeps nor looks ahead."""
        sweep, contour = SweptAxis.from_cell(cell), cell.config.contour
        if sweep is None and contour is None:
            return None
        return cls(sweep, 0.0 if contour is None else contour.speed)

    def applied(
        self,
        asked: InForce,
        passage: Passage | None,
        q: Array,
        tick: int,
        way: float = 0.0,
        *,
        cleared: bool = False,
    ) -> tuple[InForce, Beside]:
        """Return what is in force with that applied; joints are commanded to be at q (n,).

        `way` [m] is how far the base's wheels have rolled, `cleared` whether clearances limited the
        last tick.
        """
        fold = None
        if passage is not None and asked.settings.avoid:
            passage.follow(asked.drive.speed, way, tick, cleared=cleared)
            share = passage.share(asked.drive.speed)
            if share < 1.0:
                # In proportion: it stays on the arc that it is driven on.
                drive = asked.drive
                asked = asked._replace(
                    drive=drive._replace(speed=share * drive.speed, turn=share * drive.turn)
                )
            posture = passage.posture(tick)
            if posture is not None:
                # Nothing else leads the spare joints meanwhile.
                fold, asked = Fold(posture, self._speed), asked._replace(at_posture=True)
        if self._sweep is None:
            return asked, Beside(fold)
        joint, factor = self._sweep.joint, asked.settings.speed_factor
        sweep = (joint, self._sweep.rate(float(q[joint]), factor))
        if asked.posture is not None:
            posture = asked.posture.copy()
            posture[joint] = q[joint]
            asked = asked._replace(posture=posture)
        return asked, Beside(fold, sweep)
