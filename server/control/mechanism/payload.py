"""Payload on the force/torque sensor."""

from dataclasses import dataclass

from ..spatial import Array


@dataclass(frozen=True)
class Payload:
    """Load outboard of the sensor."""

    mass: float
    """Mass [kg]."""
    com: Array
    """Centre of mass in the Sensor frame (3,) [m]."""
