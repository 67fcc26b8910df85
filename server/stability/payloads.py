"""Bounds of payloads under which force control and following a hand are stable.

The bounds take a while to find, so they are found once: `prepare` does so before the first tick.
"""

import math
from functools import cached_property

from ...config.load import Cell
from .following import stiffest_hand
from .payload_loop import HEAVIEST, following_source, force_source, heaviest
from .told_inertia import ToldInertia

REFERENCE_GAIN = 0.01
"""K_F at which the force loop's heaviest payload is looked for [m/s/N]."""


class PayloadBounds:
    """Heaviest payloads for the sources of one cell; without a sensor there are no bounds."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self.inertia = ToldInertia(cell)

    def prepare(self) -> None:
        """Find the bounds of what may be switched on."""
        if self._cell.config.mechanism.force_torque is not None:
            _ = self.following, self.force

    @cached_property
    def following(self) -> float:
        """Heaviest payload with which following a hand stands by itself [kg]; inf: any."""
        return heaviest(self._cell, lambda m: following_source(self._cell, m))

    @cached_property
    def force(self) -> float:
        """Greatest K_F times payload with which force control stands by itself [s]; inf: any."""
        source = force_source(self._cell, REFERENCE_GAIN)
        return REFERENCE_GAIN * heaviest(self._cell, lambda _: source, averaged=False)

    def refusal(self, mass: float, following: float, force: float) -> str | None:
        """Return why a payload [kg] would swing the tool, or None.

        `following` is the share of the hand's force that is followed, `force` the greatest K_F
        [m/s/N]; 0 where a source is off.
        """
        if following > 0.0:
            if mass >= self.following:
                return (
                    f"a payload of {mass:g} kg swings a tool that follows a hand as "
                    f"{self._cell.config.sources.following.mass:g} kg by itself; stable below "
                    f"{self.following:.3g} kg"
                )
            hand = self._cell.config.sources.following.stiffest_hand
            most = stiffest_hand(self._cell, following, mass)
            if hand >= most:
                return (
                    f"under a payload of {mass:g} kg, a hand of {hand:g} N/m makes the tool swing; "
                    f"stable below {most:.3g} N/m"
                )
        if force * mass >= self.force:
            return (
                f"a payload of {mass:g} kg swings the tool at a force gain of {force:g}; stable "
                f"below {self.force / force:.3g} kg"
            )
        return None


def payload_words(mass: float) -> str:
    """Return a heaviest payload [kg] in words."""
    return f"to {HEAVIEST:g} kg and more" if math.isinf(mass) else f"below {mass:.3g} kg"
