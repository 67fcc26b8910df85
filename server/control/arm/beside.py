"""Joint rates that come beside a task's twists: objectives that are taken whole, and a sweep.

Williams 1997, eq. 7: dq = J⁺ẋ + (1 − J⁺J) z, with ẋ the sum of all sources. Where an objective is
taken whole, that is dq = J⁺(ẋ − J z) + z.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from ..mechanism.joint_motion import FOLDING
from ..mechanism.kinematics import Kinematics
from ..mechanism.null_space.redundancy import ObjectiveGains
from ..spatial import Array
from ..state import Inputs, Intent
from ..task.source import NO_TWIST
from .stages import Stages

_NOTHING: Final[Mapping[str, Array]] = MappingProxyType({})


class Whole(NamedTuple):
    """Rates z (n,) of the objectives that are taken whole, by name, and their twists J z (6,)."""

    rates: Mapping[str, Array] = _NOTHING
    twists: Mapping[str, Array] = _NOTHING
    folding: Array | None = None
    """Twist (6,) of an arm that folds, at a gain of 1; None for one that does not."""

    def left(self, twists: Mapping[str, Array]) -> Array:
        """Return the sum (6,) of the sources' twists without J z.

        Source by source: what the others ask for is their sum to the last bit.
        """
        apart = {name: twists[name] - own for name, own in self.twists.items()}
        return summed({**twists, **apart})

    def added(self, dq: Array, share: float) -> Array:
        """Return joint rates dq (n,) with a `share` (0 to 1) of these."""
        for z in self.rates.values():
            dq = dq + share * z
        return dq


IDLE: Final = Whole()


def summed(twists: Mapping[str, Array]) -> Array:
    """Return the sum (6,) of the sources' twists."""
    twist = np.zeros(6)
    for part in twists.values():
        if part is not NO_TWIST:
            twist += part
    return twist


def whole_objectives(
    inputs: Inputs, q: Array, k: Kinematics, objectives: ObjectiveGains, stages: Stages
) -> Whole:
    """Return what is taken whole at the commanded posture q (n,), whose kinematics are `k`.

    Joints that are led themselves do not fold.
    """
    fold = inputs.beside.fold
    led = inputs.posture is not None or inputs.jog is not None
    if fold is None or led or inputs.intent is not Intent.MOVE:
        return IDLE
    z = fold.rates(q, k.J, stages.joint_motion, inputs.settings.speed_factor)
    rates = stages.redundancy.whole(q, k.J, objectives, {FOLDING: z})
    return Whole(rates, {name: k.J @ rates[name] for name in rates}, k.J @ z)


def swept(dq: Array, inputs: Inputs) -> Array:
    """Return joint rates (n,) with that of an axis that sweeps."""
    sweep = inputs.beside.sweep
    if sweep is None or inputs.intent is not Intent.MOVE:
        return dq
    dq = dq.copy()
    dq[sweep[0]] = sweep[1]
    return dq
