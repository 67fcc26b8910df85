"""Schema of force reflection: how much goes back, to which handle and hand."""

from typing import Annotated

from pydantic import Field

from .section import Section

Share = Annotated[float, Field(ge=0, le=1)]
Gain = Annotated[float, Field(ge=0, le=10)]


class HandleSection(Section):
    """The operator's force-reflecting device, as `check` and the simulated one take it."""

    mass: float = Field(0.4, gt=0, le=10, description="felt at the handle [kg]")
    damping: float = Field(4.0, ge=0, le=100, description="of the mechanism [N·s/m]")
    spring: float = Field(
        100.0, gt=0, le=1e4, description="to its centre, while it is a stick [N/m]"
    )
    spring_damping: float = Field(6.0, ge=0, le=1000, description="with that spring [N·s/m]")
    travel: float = Field(0.04, gt=0, le=0.5, description="full deflection of the stick [m]")
    speed: float = Field(0.06, gt=0, le=5, description="what full deflection asks for [m/s]")
    max_force: float = Field(8.0, gt=0, le=200, description="of the device's motors [N]")


class HandSection(Section):
    """The softest hand that is expected to hold the handle."""

    stiffness: float = Field(200.0, ge=0, le=1e4, description="grasp and arm [N/m]")
    damping: float = Field(7.0, ge=0, le=500, description="the same [N·s/m]")


class ReflectionSection(Section):
    """Force reflection: the MRF's wrench, scaled, on the operator's handle (K_FR)."""

    gain: tuple[Gain, Gain, Gain, Gain, Gain, Gain] = Field(
        (0.15, 0.15, 0.15, 0.0, 0.0, 0.0),
        description="K_FR: part of the wrench that is reflected, per axis of the MRF [1]",
    )
    stiffness: float = Field(
        100.0,
        gt=0,
        le=1e5,
        description="greatest stiffness that a master's pose is to feel: K_FR is lowered to it "
        "[N/m]",
    )
    largest_round_trip_s: float = Field(
        0.5, ge=0, le=5, description="longest way to the operator and back that is expected [s]"
    )
    jitter: Share = Field(0.2, description="how much that varies to either side, a part of it [1]")
    energy_bound: float = Field(
        0.05,
        gt=0,
        le=10,
        description="most energy that reflection may give the hand within seconds [J]",
    )
    handle: HandleSection = Field(
        default_factory=HandleSection, description="the operator's device"
    )
    hand: HandSection = Field(default_factory=HandSection, description="the softest hand on it")


__all__ = ["HandSection", "HandleSection", "ReflectionSection"]
