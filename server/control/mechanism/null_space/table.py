"""The redundancy objectives that there are: one row each, by the name of its gain in the cell."""

from types import MappingProxyType
from typing import Final

from .objective import Objective
from .objectives.gravity_torque import GravityTorque
from .objectives.least_energy import LeastEnergy
from .objectives.manipulability import Manipulability
from .objectives.mid_range import MidRange
from .objectives.outside import FieldDescent, Spheres
from .objectives.posture import Posture
from .objectives.reflex import Folding

KINDS: Final = MappingProxyType[str, type[Objective]](
    {
        "mid_range": MidRange,
        "manipulability": Manipulability,
        "posture": Posture,
        "least_energy": LeastEnergy,
        "field": FieldDescent,
        "spheres": Spheres,
        "gravity_torque": GravityTorque,
        "reflex": Folding,
    }
)
