"""Schema of the operator's stick."""

from pydantic import Field

from ..section import Vector6
from .source import SourceSection


class JoystickSection(SourceSection):
    """Rates from a stick, times a gain per axis (K_HC)."""

    gain: Vector6 = Field((1.0,) * 6, description="K_HC [1]")
    braking: float = Field(
        1.0,
        ge=1,
        le=5,
        description="a released stick comes to rest so many times as quickly as it sets out [1]",
    )
