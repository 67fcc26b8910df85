"""Schema of the law that turns commanded motion into torques (CST)."""

from typing import Annotated

from pydantic import Field

from ..section import Section

Share = Annotated[float, Field(ge=0, le=1)]


class TorqueSection(Section):
    """Computed torque in the tool's space, for drives in CST; one value for all joints or each.

    The errors of tool and joints die out as `ë + K_d ė + K_p e = 0` does.
    """

    stiffness: float = Field(100.0, gt=0, le=1e4, description="K_p of the tool's pose [1/s²]")
    damping: float = Field(20.0, gt=0, le=500, description="K_d of the tool's pose [1/s]")
    null_stiffness: float = Field(100.0, ge=0, le=1e4, description="K_p of self-motion [1/s²]")
    null_damping: float = Field(20.0, gt=0, le=500, description="K_v of self-motion [1/s]")
    friction_speed: float = Field(
        0.01,
        gt=0,
        le=1,
        description="commanded speed at which most of the joints' friction is fed forward [rad/s]",
    )
    friction_lead: float = Field(
        2.0, ge=0, le=50, description="joint error to speed, where friction may hold a joint [1/s]"
    )
    observer: float = Field(
        10.0, ge=0, le=100, description="bandwidth of the momentum observer; 0: off [1/s]"
    )
    observer_share: Share = Field(
        0.2, description="part of max_torque that the observer may compensate [1]"
    )
    compensation: Share = Field(
        1.0, description="share of the measured contact wrench that is compensated [1]"
    )
    lag_s: float = Field(
        0.0, ge=0, le=0.2, description="how late the tool is behind its command, as measured [s]"
    )
    velocity_filter_hz: float = Field(
        30.0, gt=0, le=500, description="corner of the correction of speeds by encoders [Hz]"
    )
    singular_region: float = Field(
        0.02, gt=0, le=10, description="tool mobility below which joints take over [1/kg]"
    )
    singular_damping: float = Field(
        0.01, gt=0, le=10, description="damping of the tool's inertia at no mobility [1/kg]"
    )
    speed_gain: float = Field(
        5.0, ge=0, le=50, description="CSV: joint error to speed, beside the commanded speed [1/s]"
    )
