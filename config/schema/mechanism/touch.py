"""Schema of collision detection by the drives' torques."""

from typing import Annotated

from pydantic import Field

from ..section import EachJoint, Section

Torque = Annotated[float, Field(gt=0, le=1e5)]


class TouchSection(Section):
    """Contact that no sensor sees: what the drives give beside what the model says they need."""

    torque: Annotated[tuple[Torque, ...], EachJoint] = Field(
        min_length=1,
        max_length=64,
        description="external torque that means contact, one for all joints or one each [N·m]",
    )
    doubt: float = Field(
        0.35,
        ge=0,
        le=2,
        description="part of the torque that accelerates the arm which may be wrong: inertias, and "
        "the drives' torque reported late [1]",
    )
    filter_hz: float = Field(
        6.0, gt=0, le=50, description="corner of the low-pass on the estimate [Hz]"
    )
    confirm_s: float = Field(
        0.02, ge=0, le=0.5, description="contact must last this long to stop the arm [s]"
    )
    leash: float = Field(
        0.1, gt=0, le=0.5, description="a joint gives way in HOLD after a touch by at most [rad]"
    )
