"""Contact forces in the physics: of arms and payload on what stands around, and on each other.

A net force hides what is pressed from two sides, and what is looked at once a period misses a
spike. Therefore a contact counts as the sum of magnitudes over the pairs of solids that touch, and
`note` takes it in at every physics step. Solids are convex: within a pair, forces cannot cancel.
"""

import math
from collections.abc import Collection, Iterator, Sequence
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from .geoms import owners
from .movers import FLOOR, ROLLS

Vector = NDArray[np.float64]

OWN: Final = -1
"""Side of a contact between two parts of arms or payload."""
NOBODY: Final = -2
"""Side of a contact that does not count: of wheels on their floor."""


class Contacts:
    """Contacts of one world's arms, and of a payload after them; `roots` are their root bodies.

    `fixed` are the geoms of what stands around; the floor is one of these for all but wheels.
    Peaks are those of the newest `steps` physics steps: of one period.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        fixed: Collection[int],
        roots: Sequence[int],
        steps: int,
    ) -> None:
        self._model, self._data = model, data
        floor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, FLOOR)
        self._fixed = frozenset(fixed) | ({floor} if floor >= 0 else frozenset())
        owner = [NOBODY if arm < 0 else arm for arm in owners(model, roots)]
        side_of: list[int] = [owner[body] for body in model.geom_bodyid.tolist()]
        rolls = [bool(t & ROLLS) and g != floor for g, t in enumerate(model.geom_contype)]

        def side(first: int, second: int) -> int:
            if rolls[first] or rolls[second]:
                return NOBODY
            if (first in self._fixed) != (second in self._fixed):
                return side_of[second if first in self._fixed else first]
            return OWN if first not in self._fixed else NOBODY

        geoms = range(model.ngeom)
        self._side = [[side(first, second) for second in geoms] for first in geoms]
        """Whose contact with what stands a pair of geoms is, `OWN` or `NOBODY`."""
        self._wrench = np.zeros(6)
        self._sides = len(roots) + 1
        self._period, self._step = steps, 0
        self._newest: list[tuple[int, list[float]]] = []
        """Of the newest steps in which something touched: which one, and the sums of every side
        [N], the last of `OWN`."""

    def force(self, side: int) -> Vector:
        """Return the net force (3,) [N] of an arm, or the payload, on what stands, in World."""
        total = np.zeros(3)
        for whose, (_, second), on_second in self._pressing():
            if whose == side:
                total += on_second if second in self._fixed else -on_second
        return total

    def total(self, side: int) -> float:
        """Return the sum over pairs of solids of an arm's forces on what stands, now [N]."""
        return self._sums()[side]

    def own(self) -> float:
        """Return the sum over pairs of solids of arms and payload that touch each other [N]."""
        return self._sums()[OWN]

    def greatest(self) -> float:
        """Return the greatest sum of any side now, `own` among them [N]."""
        return max(self._sums())

    def peak(self, side: int) -> float:
        """Return the greatest `total` of the newest period [N]."""
        return max((sums[side] for _, sums in self._of_period()), default=0.0)

    def own_peak(self) -> float:
        """Return the greatest `own` of the newest period [N]."""
        return self.peak(OWN)

    def note(self) -> None:
        """Take in the contacts of one physics step."""
        self._step += 1
        if self._data.ncon and any(sums := self._sums()):
            self._newest = [*self._of_period(), (self._step, sums)]

    def _of_period(self) -> list[tuple[int, list[float]]]:
        first = self._step - self._period
        return [noted for noted in self._newest if noted[0] > first]

    def _sums(self) -> list[float]:
        """Return the sums of every side [N], the last for `OWN`."""
        sums = [0.0] * self._sides
        forces: dict[tuple[int, int], Vector] = {}
        for _, pair, force in self._pressing():
            forces[pair] = forces[pair] + force if pair in forces else force
        for (first, second), force in forces.items():
            sums[self._side[first][second]] += math.sqrt(force @ force)
        return sums

    def _pressing(self) -> Iterator[tuple[int, tuple[int, int], Vector]]:
        """Yield side and geoms of every contact that counts, and the force (3,) [N] on the second.

        In World.
        """
        if not self._data.ncon:
            return
        contacts, wrench = self._data.contact, self._wrench
        for i, (first, second) in enumerate(contacts.geom.tolist()):
            side = self._side[first][second]
            if side != NOBODY:
                mujoco.mj_contactForce(self._model, self._data, i, wrench)
                yield side, (first, second), wrench[:3] @ contacts.frame[i].reshape(3, 3)
