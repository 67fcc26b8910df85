"""Folding to pass below what is ahead: the tool's part of it (Zhang et al. 2013, section 4).

An arm that folds goes to a posture, joints in proportion, with rates z. The tool's part of that,
J z, is this source; what is left of it, (1 − J⁺J) z, is the redundancy objective of the same name.
"""

from typing import NamedTuple

from .....config.schema.sources.reflex import ReflexSection
from ...spatial import Array
from ..source import NO_TWIST, Context, Shaping, Source


class ReflexState(NamedTuple):
    """Nothing is remembered: the posture's rates stop in time by themselves."""


_IDLE = ReflexState()


class Reflex(Source[ReflexState]):
    """Leads the tool as the arm folds."""

    def __init__(self, section: ReflexSection, shaping: Shaping) -> None:
        """Build it; it has no constants."""

    def idle(self) -> ReflexState:
        """Return the only state."""
        return _IDLE

    def rate(self, context: Context, state: ReflexState, gain: Array) -> tuple[Array, ReflexState]:
        """Return the twist of an MRF that is folded away; `gain` (6,) is its share, in World."""
        folding = context.folding
        if folding is None or not context.guided:
            return NO_TWIST, state
        return gain * folding, state
