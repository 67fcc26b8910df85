"""Loop of rate mode through the operator: gain, bound, and low-pass above the bound.

A stick makes the arm push with F = K_HC u / K_F whatever the network does (Williams 1997, 2.6): the
arm's own loop sees to that. Reflected, the force moves the stick: a loop of gain
`g = K_FR c K_HC / K_F` at rest, c being the stick's rate for each newton on it. Below one, a loop
of gain g without resonance is stable at any delay (small gain); above, a low-pass that is slow
against all delays takes the gain away where the phase is lost.
"""

import math
from dataclasses import dataclass
from typing import Self

from ...config.schema.network import HandleSection, HandSection

WELL_DAMPED = 0.7
"""Damping ratio from which a held stick counts as without resonance [1]."""
BOUND_DAMPED, BOUND = 0.6, 0.4
"""Greatest loop gain that needs no filter, well damped and not [1]."""
GREATEST = 4.0
"""Above this loop gain, the filtered loop does not settle either [1]."""
FILTER_PER_GAIN = 1.5
"""Filter time for each unit of gain, as a part of all delays [1]."""
ARM_S = 0.08
"""Lag of the arm's side: its force loop, drives and filter [s]."""


@dataclass(frozen=True)
class HeldStick:
    """Dynamics of a stick with a hand on it, as the loop sees it."""

    rate_per_force: float
    """c: the rate that it asks for, for each newton on it [m/s/N]."""
    damping_ratio: float
    """ζ [1]."""
    lag_s: float
    """Delay of its response to a force [s]."""

    @classmethod
    def of(cls, handle: HandleSection, hand: HandSection) -> Self:
        """Take it from the springs and dampers of handle and hand."""
        stiffness = handle.spring + hand.stiffness
        damping = handle.damping + handle.spring_damping + hand.damping
        return cls(
            handle.speed / handle.travel / stiffness,
            damping / (2.0 * math.sqrt(stiffness * handle.mass)),
            damping / stiffness,
        )

    @property
    def bound(self) -> float:
        """Greatest loop gain that needs no filter [1]."""
        return BOUND_DAMPED if self.damping_ratio >= WELL_DAMPED else BOUND

    def filter_s(self, gain: float, round_trip_s: float) -> float:
        """Return the low-pass time that a loop gain needs at a round trip, 0 for none [s]."""
        if gain <= self.bound:
            return 0.0
        return FILTER_PER_GAIN * gain * (round_trip_s + ARM_S + self.lag_s)
