"""Schema of the bridge that a rover drives under, and of the simulated laser scanner."""

from pydantic import Field

from ..section import NonNegative, Section, Vector3


class RigBridgeSection(Section):
    """Two pillars and a beam on them, across the way ahead.

    Their bodies are `bridge_left`, `bridge_right` and `bridge_beam`.
    """

    height: float = Field(0.95, gt=0, le=10, description="of the beam's underside [m]")
    width: float = Field(1.4, gt=0, le=10, description="between the pillars [m]")
    thickness: float = Field(0.1, gt=0, le=5, description="of pillars and beam, ahead [m]")
    side: float = Field(0.1, gt=0, le=2, description="of the pillars across, of the beam up [m]")
    skew: float = Field(0.0, ge=-1, le=1, description="turned about the vertical by [rad]")
    offset: float = Field(0.0, ge=-5, le=5, description="of its middle, to the left [m]")
    distance: float = Field(
        2.5, ge=-20, le=50, description="of its middle's near face, ahead of World's origin [m]"
    )


class RigPersonSection(Section):
    """Somebody who stands on the floor, and may walk in: body `person`, which can be placed."""

    xyz: Vector3 = Field(description="between the feet [m]")
    height: float = Field(1.7, gt=0.5, le=3, description="of an upright capsule [m]")
    radius: float = Field(0.2, gt=0.05, le=0.24, description="of that capsule [m]")


class RigScannerSection(Section):
    """Imperfections of the simulated laser scanner."""

    noise: NonNegative = Field(0.012, description="standard deviation of distances [m]")
    range: float = Field(20.0, gt=0.5, le=100, description="farther things give no echo [m]")
    least: float = Field(0.05, ge=0, le=5, description="nearer things give none either [m]")
