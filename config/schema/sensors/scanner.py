"""Schema of the laser scanner, of the contour ahead of the arm, and of the arm's reflex to it."""

import math
from typing import Literal

from pydantic import Field, model_validator

from ..section import LinkName, Name, PoseSection, Section, Vector3

MOST_CELLS = 1600
"""Cells of a contour [1]."""


class ScannerSection(Section):
    """A SICK LMS1xx that tells distances over TCP (CoLa-A), mostly on an axis that sweeps."""

    address: str = Field(
        "tcp/127.0.0.1:2111",
        pattern=r"^tcp/[A-Za-z0-9.\-]{1,253}:[0-9]{1,5}$",
        description="where it listens; the virtual one listens there, too",
    )
    link: LinkName = Field(description="link of the URDF that it is fixed to")
    T_link_scanner: PoseSection = Field(
        default_factory=PoseSection,
        description="its mirror in that link: x straight ahead, z the axis",
    )
    first: float = Field(
        -0.25 * math.pi, ge=-math.pi, le=math.pi,
        description="angle of the first ray, from its right; π/2 is straight ahead [rad]",
    )  # fmt: skip
    step: float = Field(
        math.radians(0.5), ge=math.radians(0.1), le=math.radians(1.0),
        description="angle from ray to ray [rad]",
    )  # fmt: skip
    rays: int = Field(541, ge=2, le=1082, description="rays of a scan [1]")
    rate_hz: float = Field(50.0, ge=5, le=100, description="scans in a second [Hz]")
    silent_s: float = Field(
        0.2, gt=0, le=2, description="a base that drives stops when the newest scan is older [s]"
    )
    late_s: float = Field(
        0.0, ge=-0.1, le=0.1, description="its rays are older than its clock tells [s]"
    )
    self_margin: float = Field(
        0.04, ge=0.005, le=0.3, description="what is nearer to a capsule of the arm is the arm [m]"
    )


class PlaneSection(Section):
    """The cells of the contour, parallel to y and z of Base, from the arm's foot upwards."""

    ahead: float = Field(2.0, gt=0.2, le=10, description="what is nearer is acted upon [m]")
    collect: float = Field(3.0, gt=0.2, le=15, description="what is nearer is told [m]")
    width: float = Field(2.0, ge=0.2, le=10, description="half of it on either side [m]")
    height: float = Field(1.0, ge=0.2, le=5, description="from the foot upwards [m]")
    cell: float = Field(0.05, ge=0.02, le=0.5, description="side of a cell [m]")

    @model_validator(mode="after")
    def _collects_first(self) -> "PlaneSection":
        if self.collect < self.ahead:
            raise ValueError(f"collect {self.collect:g} must be at least ahead {self.ahead:g}")
        if (self.width / self.cell) * (self.height / self.cell) > MOST_CELLS:
            raise ValueError(f"at most {MOST_CELLS} cells")
        return self


class ContourReflexSection(Section):
    """The nearest obstacles ahead of the arm, and how the arm folds itself to pass them."""

    plane: PlaneSection = Field(
        default_factory=PlaneSection, description="where it is, and its cells"
    )
    foot: Vector3 = Field((0.0, 0.0, 0.0), description="foot of the arm in Base [m]")
    shoulder: Name = Field(description="joint at whose origin the shoulder is")
    elbow: Name = Field(description="joint at whose origin the elbow is")
    base_width: float = Field(
        0.0, ge=0, le=5, description="of what carries the arm, and has to pass, too [m]"
    )
    base_rear: float = Field(
        0.0, ge=0, le=5, description="how far that reaches behind Base's origin [m]"
    )
    creep: float = Field(
        0.05,
        ge=0,
        le=1,
        description="back over ground that nobody saw, the base goes at most [m/s]",
    )
    link_radius: float = Field(0.06, ge=0.005, le=0.5, description="of the arm's housings [m]")
    rule: Literal["posture", "sequence"] = Field(
        "posture",
        description="a search of a whole posture, or F1 (tool), F2 (elbow), F3 (both) in order",
    )
    wait: bool = Field(True, description="the base slows down and waits until the arm is through")
    speed: float = Field(0.3, gt=0, le=2, description="the tool folds at most so quickly [m/s]")
