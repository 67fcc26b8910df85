"""Schema of force control."""

from typing import ClassVar, Literal

from pydantic import Field

from ..section import Vector6
from .source import SourceSection


class ForceSection(SourceSection):
    """Force–moment accommodation: rate = K_F (desired wrench − wrench), per axis."""

    NEEDS: ClassVar[Literal["force_torque"]] = "force_torque"

    gain: Vector6 = Field(
        (7e-4, 7e-4, 7e-4, 0.03, 0.03, 0.03), description="K_F [m/s/N, rad/s/(N·m)]"
    )
    hold_threshold: float = Field(
        30.0,
        gt=0,
        le=1e4,
        description="contact force that is bled off in HOLD, and stops a jog or posture [N]",
    )
    hold_leash: float = Field(
        0.02, ge=0, le=0.2, description="largest tool travel while bleeding off [m]"
    )
