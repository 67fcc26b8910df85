"""Schema of a hyper-redundant arm: its curve, and the tunnels it goes through."""

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ..section import PoseSection, Section

_Turn = Annotated[float, Field(ge=-math.pi, le=math.pi)]


class SegmentSection(Section):
    """A straight or circular piece of a tunnel; x of its frame is the tangent."""

    length: float = Field(gt=1e-3, le=20, description="along the centre line [m]")
    bend: _Turn = Field(0.0, description="turn to the left, about its own z [rad]")
    climb: _Turn = Field(0.0, description="turn upward, about its own -y [rad]")
    to: PoseSection | None = Field(
        None,
        description="entrance of the next tunnel in World: the piece is the gap before it, of this "
        "length, without walls; its curve is solved once",
    )
    open: bool = Field(
        False, description="true: no walls; the curve beyond the exit, at the end of the list"
    )


class BackboneSection(Section):
    """The arm is a curve through tunnels; its joints follow (Chirikjian & Burdick 1990)."""

    axes: Literal["planar", "universal", "alternating"] = Field(
        "planar", description="the joints' axes: all parallel, in crossing pairs, or in turn"
    )
    exterior: Literal["bessel", "modal"] = Field(
        "bessel",
        description="the free curve from the first joint to the entrance: one cosine of curvature, "
        "or a sum of modes",
    )
    modes: tuple[Annotated[float, Field(ge=-10, le=10)], ...] = Field(
        (1.0, -0.5),
        min_length=1,
        max_length=8,
        description="of a modal exterior: shares of 1, 2, … sine waves of attitude along it",
    )
    bow: float | None = Field(
        None,
        ge=-math.pi,
        le=math.pi,
        description="where it bows out to, about the entrance's x from its y; none: away from the "
        "first bend, and 0.79 off it unless planar [rad]",
    )
    entrance: PoseSection = Field(
        description="of the tunnel in World: x points into it, straight ahead of the first joint"
    )
    start: float = Field(gt=0, le=50, description="free length s1 of the posture 'start' [m]")
    least: float = Field(
        gt=0,
        le=50,
        description="least free length: at 1.05 of the way to the entrance, or more [m]",
    )
    half_width: float = Field(gt=0, le=1, description="of the tunnel, centre line to wall [m]")
    link_radius: float = Field(gt=0, le=1, description="of the links' housings [m]")
    clearance: float = Field(
        0.004, ge=0, le=1, description="kept to the walls along every stop [m]"
    )
    speed: float = Field(0.08, gt=0, le=1, description="greatest insertion speed [m/s]")
    acceleration: float = Field(0.3, gt=0, le=10, description="of the insertion [m/s²]")
    most_push: float = Field(
        10.0, gt=0, le=1e4, description="force of the head at which a drive inserts no further [N]"
    )
    quick_stop: Literal["in_proportion", "each"] = Field(
        "in_proportion",
        description="in_proportion: drives are told ramps by which all joints come to rest "
        "together, along the curve (6085h by RPDO2); each: every joint by its own "
        "quick_stop_deceleration",
    )
    tunnel: tuple[SegmentSection, ...] = Field(
        min_length=1, max_length=64, description="its pieces, from the entrance on"
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.start <= self.least:
            raise ValueError(f"start = {self.start:g} must be above least = {self.least:g}")
        if self.half_width <= self.link_radius + self.clearance:
            raise ValueError(
                f"half_width = {self.half_width:g} must be above link_radius + clearance = "
                f"{self.link_radius + self.clearance:g}"
            )
        for i, piece in enumerate(self.tunnel):
            if piece.to is not None and (piece.bend or piece.climb or piece.open):
                raise ValueError(f"tunnel[{i}].to: a gap has neither bend nor climb, and ends")
        if self.tunnel[0].to is not None or self.tunnel[-1].to is not None:
            raise ValueError("tunnel: a gap lies between two pieces with walls")
        if not any(self.modes):
            raise ValueError("modes: one must not be 0")
        walled = [not piece.open for piece in self.tunnel]
        if not walled[0] or walled != sorted(walled, reverse=True):
            raise ValueError("tunnel: open pieces come last, after one with walls")
        for i, piece in enumerate(self.tunnel):
            if self.axes == "planar" and piece.climb:
                raise ValueError(f"tunnel[{i}].climb: a planar arm cannot follow it")
            angle = math.hypot(piece.bend, piece.climb)
            if angle * self.half_width >= piece.length and not piece.open:
                raise ValueError(
                    f"tunnel[{i}]: a radius of {piece.length / angle:.4g} m is within the "
                    f"half width {self.half_width:g} m"
                )
        return self
