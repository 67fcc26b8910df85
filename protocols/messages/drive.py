"""Messages that drive a mechanism as a whole: an arm into its tunnels, a base on wheels.

The envelope, units and conventions are those of `messages.py`.
"""

from typing import Annotated

from pydantic import Field

from .messages import MechanismCommand, Speed


class Drive(MechanismCommand):
    """Speeds that a mechanism is driven at, a stream.

    Of an arm in tunnels the insertion [m/s]: positive inserts, negative withdraws. Of a base on
    wheels v ahead [m/s] and ω about its z axis [rad/s].
    """

    rates: Annotated[tuple[Speed, ...], Field(min_length=1, max_length=2)]


class Insert(MechanismCommand):
    """How deep an arm is to be in its tunnels, a goal: the tip's way from the entrance [m]."""

    depth: float = Field(ge=0, le=100)
    speed: float | None = Field(None, gt=0, le=10)
    """[m/s]; the cell's when absent, never more than that."""
