"""The state of the daemon that a request may depend on."""

from dataclasses import dataclass

from ..mode import Mode
from ..units.units import Units
from .admission import Instant


@dataclass(frozen=True)
class RequestContext:
    """State of mode, arms and drives in the tick that answers a request."""

    now: Instant
    mode: Mode
    units: Units
    """The arms, with what is commanded and perceived of each."""
    drives_off: bool = True
    """All drives have said that they are off, after what they were last told."""
