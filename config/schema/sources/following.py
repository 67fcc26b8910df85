"""Schema of the source that follows a hand."""

from collections.abc import Iterator, Set
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .source import SourceSection

Share = Annotated[float, Field(ge=0, le=1)]


class FollowingSection(SourceSection):
    """The tool moves as a damped mass would under the hand's force, and its attitude stays."""

    NEEDS: ClassVar[Literal["force_torque"]] = "force_torque"

    enabled: bool = Field(False, description="switch at start")
    gain: tuple[Share, Share, Share, Share, Share, Share] = Field(
        (1.0, 1.0, 1.0, 0.0, 0.0, 0.0),
        description="share of the measured force and moment that is followed, MRF axes [1]",
    )
    mass: float = Field(1.0, gt=0, le=1000, description="M_e [kg]")
    damping: float = Field(20.0, gt=0, le=1e4, description="B_e: steady speed is force / B_e")
    inertia: float = Field(1.0, gt=0, le=100, description="the same about an axis [kg·m²]")
    angular_damping: float = Field(20.0, gt=0, le=1e4, description="the same [N·m·s/rad]")
    stiffness: float = Field(
        5.0, ge=0, le=50, description="the command's error from the reference, to rate [1/s]"
    )
    deadband: float = Field(
        0.3,
        ge=0,
        le=50,
        description="force that is not followed; twice as much is, in full [N]",
    )
    moment_deadband: float = Field(0.05, ge=0, le=10, description="the same [N·m]")
    max_force: float = Field(
        30.0, gt=0, le=1000, description="more than this is followed as if it were this [N]"
    )
    max_moment: float = Field(5.0, gt=0, le=100, description="the same [N·m]")
    payload_smoothing_s: float = Field(
        0.004,
        ge=0,
        le=0.1,
        description="time constant of the force for a payload of M_e, in proportion to it [s]",
    )
    stiffest_hand: float = Field(
        300.0, gt=0, le=1e6, description="stiffness of the hand or arm that guides the tool [N/m]"
    )

    def lacking(self, there: Set[str]) -> Iterator[str]:
        """Yield that there is no force to follow."""
        if self.enabled and "force_torque" not in there:
            yield "enabled: value True: there is no [mechanism.force_torque]"
