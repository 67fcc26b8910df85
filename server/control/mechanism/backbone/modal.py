"""The free part of a backbone as a sum of modes: other shapes than one cosine of curvature.

The attitude is μ f(s / s1), f(σ) = Σ c_m sin 2πmσ. f is odd about the middle: the curve ends
straight ahead of the base with the tangent that it began with, as in Chirikjian & Burdick, eq. 19,
whose curve is the first mode alone; and h = s1 ∫ cos(μ f) dσ is their eq. 20. With modes 1 and −1/2
the curvature begins and ends with 0, and the joint at the base does not jump. Integrals are Gauss
and Legendre's, from station to station.
"""

import math
from typing import NamedTuple

import numpy as np

from ...compiled import NUMBER, ROW, VECTOR, compiled
from ...spatial import Array
from .exterior import Chord

PANEL = 1.0 / 24.0
"""An integral's panel is at most so long, in lengths of the free part [1]."""
NODES = (0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970263)
WEIGHTS = (0.17392742256872693, 0.32607257743127307, 0.32607257743127307, 0.17392742256872693)
"""Of Gauss and Legendre's rule with four points, on (0, 1)."""


class Modal(NamedTuple):
    """An exterior whose attitude is a sum of modes."""

    chord: Chord
    modes: Array
    """Shares c_m of the modes (k,) [1]."""

    def at(self, s1: float, stations: Array) -> tuple[Array, Array]:
        """Return points (m, 3) [m] at arc lengths (m,) up to s1 [m], and their ∂/∂s1 (m, 3).

        Raises `ValueError` where s1 is not above h, and where no curve of these modes is so long.
        """
        mu = modal_parameter(self.modes, self.chord.share_of(s1))
        if not mu > 0.0:
            raise ValueError(f"free length {s1} m: the modes bow out by less than that")
        return self.chord.placed(modal_at(self.modes, mu, self.chord.h, stations))


@compiled(VECTOR, NUMBER)
def _shape(modes: Array, share: float) -> float:
    """Return f(σ) at a share of the free length (0 to 1) [1]."""
    found = 0.0
    for m in range(len(modes)):
        found += modes[m] * math.sin(2.0 * math.pi * (m + 1) * share)
    return found


@compiled(VECTOR, NUMBER, NUMBER, NUMBER, ROW)
def _add(modes: Array, mu: float, begin: float, end: float, sums: Array) -> None:
    """Add ∫ sin(μf), ∫ cos(μf) and their ∂/∂μ from one share to another to `sums` (4,)."""
    panels = max(1, math.ceil((end - begin) / PANEL - 1e-9))
    width = (end - begin) / panels
    for k in range(panels):
        for i in range(4):
            f = _shape(modes, begin + (k + NODES[i]) * width)
            sine, cosine = math.sin(mu * f), math.cos(mu * f)
            sums[0] += WEIGHTS[i] * width * sine
            sums[1] += WEIGHTS[i] * width * cosine
            sums[2] += WEIGHTS[i] * width * f * cosine
            sums[3] -= WEIGHTS[i] * width * f * sine


@compiled(VECTOR, NUMBER)
def modal_parameter(modes: Array, ratio: float) -> float:
    """Return the least μ > 0 of ∫ cos(μf) = ratio in (0, 1); −1 where attitudes would turn by π."""
    most = 0.0
    for i in range(201):
        most = max(most, abs(_shape(modes, 0.005 * i)))
    low, high = 0.0, math.pi / most
    sums = np.zeros(4)
    _add(modes, high, 0.0, 1.0, sums)
    if sums[1] > ratio:
        return -1.0
    mu = 0.5 * high
    for _ in range(80):
        sums[:] = 0.0
        _add(modes, mu, 0.0, 1.0, sums)
        off = sums[1] - ratio
        if off > 0.0:
            low = mu
        else:
            high = mu
        newer = mu - off / sums[3] if sums[3] < 0.0 else -1.0
        if not low < newer < high:
            newer = 0.5 * (low + high)
        if abs(newer - mu) < 1e-15:
            return newer
        mu = newer
    return mu


@compiled(VECTOR, NUMBER, NUMBER, VECTOR)
def modal_at(modes: Array, mu: float, h: float, stations: Array) -> Array:
    """Return points, aside and ahead, and their ∂/∂s1 (2, m, 2), at increasing arc lengths (m,)."""
    whole, sums = np.zeros(4), np.zeros(4)
    _add(modes, mu, 0.0, 1.0, whole)
    s1 = h / whole[1]
    ds1 = -s1 * whole[3] / whole[1]
    found = np.empty((2, len(stations), 2))
    before = 0.0
    for m in range(len(stations)):
        share = stations[m] / s1
        _add(modes, mu, before, share, sums)
        before = share
        angle = mu * _shape(modes, share)
        found[0, m, 0], found[0, m, 1] = s1 * sums[0], s1 * sums[1]
        # A longer curve is larger, and its points at a given arc length fall back along it.
        found[1, m, 0] = sums[0] - share * math.sin(angle) + s1 * sums[2] / ds1
        found[1, m, 1] = sums[1] - share * math.cos(angle) + s1 * sums[3] / ds1
    return found
