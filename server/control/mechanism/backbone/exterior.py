"""The free part of a backbone, from the arm's base to a tunnel's entrance, in closed form.

Chirikjian & Burdick, eqs. 19 to 22: the curvature is a(t) cos(2π s / s1), so that the attitude is
μ sin(2π s / s1) with μ = a s1 / 2π, and the curve ends straight ahead of the base with the tangent
that it began with, at h = J0(μ) s1. Points between follow from the expansion of Jacobi and Anger:

    cos(μ sin φ) = J0 + 2 Σ J_2k cos 2kφ        sin(μ sin φ) = 2 Σ J_2k+1 sin (2k+1)φ

which is integrated term by term. As s1 comes down to h, dμ/ds1 has no bound; everything is a smooth
function of μ, though, and rates are given along μ, too.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np

from ...compiled import MATRIX, NUMBER, ROW, STACK, TABLE, VECTOR, compiled
from ...spatial import Array

FIRST_ZERO = 2.404825557695773
"""J0 is positive and falls for μ below this [1]."""
ORDERS = 24
"""Bessel functions of higher order are below 1e-20 there [1]."""


class Chord(NamedTuple):
    """The straight way from the base to the entrance, and where an exterior bows out from it."""

    base: Array
    """Where it begins, in World (3,) [m]."""
    axes: Array
    """Where the exterior bows out to, and its tangent at the base and at the entrance (2, 3)."""
    h: float
    """Distance of the entrance from the base [m]: a straight exterior is so long."""

    def share_of(self, s1: float) -> float:
        """Return h in shares of a free length [m], below 1.

        Raises `ValueError` where s1 is not above h, as rates along s1 have no bound there.
        """
        if not s1 > self.h:
            raise ValueError(f"free length {s1} m: must be above {self.h} m")
        return self.h / s1

    def placed(self, found: Array) -> tuple[Array, Array]:
        """Return points and rates (m, 3) in World of those aside and ahead (2, m, 2) [m]."""
        return self.base + found[0] @ self.axes, found[1] @ self.axes


class Exterior(Protocol):
    """A curve of free length s1 from the base, with its tangent, to the entrance, with its own."""

    @property
    def chord(self) -> Chord:
        """From where to where it goes."""
        ...

    def at(self, s1: float, stations: Array) -> tuple[Array, Array]:
        """Return points (m, 3) [m] at arc lengths (m,) up to s1 [m], and their ∂/∂s1 (m, 3).

        Raises `ValueError` for a free length that it cannot have.
        """
        ...


class Bow(NamedTuple):
    """The exterior of the paper's example: one period of a cosine of curvature."""

    chord: Chord

    def at(self, s1: float, stations: Array) -> tuple[Array, Array]:
        """Return points (m, 3) [m] at arc lengths (m,) up to s1 [m], and their ∂/∂s1 (m, 3).

        Raises `ValueError` where s1 is not above h.
        """
        points, rates = np.empty((2, len(stations), 3))
        share, chord = self.chord.share_of(s1), self.chord
        _place(share, chord.h, stations, chord.base, chord.axes, points, rates)
        return points, rates

    def along(self, mu: float, stations: Array) -> tuple[Array, Array, float]:
        """Return points (m, 3) [m], their ∂/∂μ (m, 3) [m], and ds1/dμ [m]: smooth from μ = 0 up."""
        found = np.empty((2, len(stations), 2))
        ds1 = bow_at(mu, self.chord.h, stations, found)
        return *self.chord.placed(found), ds1


@compiled(NUMBER, ROW)
def bessel(x: float, J: Array) -> None:
    """Write J_n(x) of the orders n = 0, 1, … (k,), by their power series; |x| below about 5."""
    half, first = 0.5 * x, 1.0
    for n in range(len(J)):
        J[n] = 0.0
        term, k = first, 0
        while abs(term) > 1e-25 and k < 60:
            J[n] += term
            k += 1
            term *= -half * half / (k * (n + k))
        first *= half / (n + 1)


@compiled(NUMBER)
def bow_parameter(ratio: float) -> float:
    """Return μ in (0, 2.405) of J0(μ) = ratio in (0, 1): Newton's method inside a bracket."""
    low, high, J = 0.0, FIRST_ZERO, np.empty(2)
    mu = 2.0 * math.sqrt(1.0 - ratio)
    for _ in range(60):
        bessel(mu, J)
        off = J[0] - ratio
        if off > 0.0:
            low = mu
        else:
            high = mu
        newer = mu + off / J[1] if J[1] > 0.0 else -1.0
        if not low < newer < high:
            newer = 0.5 * (low + high)
        if abs(newer - mu) < 1e-15:
            return newer
        mu = newer
    return mu


@compiled(NUMBER, NUMBER, VECTOR, STACK)
def bow_at(mu: float, h: float, stations: Array, found: Array) -> float:
    """Write points, aside and ahead, and their ∂/∂μ (2, m, 2) [m] at arc lengths (m,).

    Return ds1/dμ [m].

    F = ∫ (sin θ, cos θ) dφ has sums over J_n, its ∂/∂μ over J_n' = (J_n−1 − J_n+1) / 2.
    """
    J = np.empty(ORDERS + 1)
    bessel(mu, J)
    s1 = h / J[0]
    ds1: float = s1 * J[1] / J[0]
    per = s1 / (2.0 * math.pi)
    for m in range(len(stations)):
        share = stations[m] / s1
        phi = 2.0 * math.pi * share
        sine, cosine = math.sin(phi), math.cos(phi)
        aside, ahead = 0.0, J[0] * phi
        aside_mu, ahead_mu = 0.0, -J[1] * phi
        s, c = sine, cosine  # of n φ
        for n in range(1, ORDERS):
            slope = J[n - 1] - J[n + 1]
            if n % 2:
                aside += 2.0 * J[n] * (1.0 - c) / n
                aside_mu += slope * (1.0 - c) / n
            else:
                ahead += 2.0 * J[n] * s / n
                ahead_mu += slope * s / n
            s, c = s * cosine + c * sine, c * cosine - s * sine
        theta = mu * sine
        found[0, m, 0], found[0, m, 1] = per * aside, per * ahead
        # A longer curve is larger, and its points at a given arc length fall back along it.
        found[1, m, 0] = per * aside_mu + ds1 * (per * aside / s1 - share * math.sin(theta))
        found[1, m, 1] = per * ahead_mu + ds1 * (per * ahead / s1 - share * math.cos(theta))
    return ds1


@compiled(NUMBER, NUMBER, VECTOR, VECTOR, MATRIX, TABLE, TABLE)
def _place(
    share: float,
    h: float,
    stations: Array,
    base: Array,
    axes: Array,
    points: Array,
    rates: Array,
) -> None:
    """Write points and their ∂/∂s1 (m, 3) in World of a bow whose chord is a `share` of it."""
    found = np.empty((2, len(stations), 2))
    ds1 = bow_at(bow_parameter(share), h, stations, found)
    for m in range(len(stations)):
        for k in range(3):
            points[m, k] = base[k] + (found[0, m, 0] * axes[0, k] + found[0, m, 1] * axes[1, k])
            rates[m, k] = (found[1, m, 0] * axes[0, k] + found[1, m, 1] * axes[1, k]) / ds1
