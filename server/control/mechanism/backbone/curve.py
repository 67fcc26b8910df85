"""A backbone curve: free from the base to the entrance, and where the tunnels are from there on."""

from typing import NamedTuple

import numpy as np

from ...spatial import Array
from .exterior import Exterior
from .interior import Arcs


class Sampled(NamedTuple):
    """The curve at some arc lengths."""

    points: Array
    """(m, 3) in World [m]"""
    rates: Array
    """∂/∂s1 of the points at given arc lengths (m, 3): tunnels move nothing but along them [1]."""


class Curve(NamedTuple):
    """A curve of fixed length that slides through tunnels as its free length s1 shrinks."""

    exterior: Exterior
    arcs: Arcs
    """The curve beyond the entrance: tunnels, and gaps between them."""

    def at(self, s1: float, stations: Array) -> Sampled:
        """Return the curve of free length s1 [m] at increasing arc lengths (m,) from its base [m].

        Raises `ValueError` where the exterior cannot be that short.
        """
        free = int(stations.searchsorted(s1, side="right"))
        points, rates = np.empty((2, len(stations), 3))
        points[:free], rates[:free] = self.exterior.at(s1, stations[:free])
        points[free:], tangents = self.arcs.at(stations[free:] - s1)
        # Chirikjian & Burdick, eq. 14: the interior's travelling wave slides along itself.
        np.negative(tangents, out=rates[free:])
        return Sampled(points, rates)
