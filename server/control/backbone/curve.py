"""A backbone curve: free from the base to the entrance, then along the tunnels."""

import math
from typing import NamedTuple, Protocol, Self

import numpy as np
from pydantic import ValidationError

from ....config.drives import joint_bounds
from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.schema.mechanism import BackboneSection, SegmentSection
from ..compiled import MATRIX, NUMBER, STACK, TABLE, VECTOR, compiled, inner_kernel
from ..inputs import ToldTunnel
from ..spatial import Array, Pose
from .fit import Chain
from .tunnels import Arcs, Parts, Turn, passages_meet, solve_gap

# --- The free part of a backbone, from the arm's base to a tunnel's entrance, in closed form ------
#
# Chirikjian & Burdick, eqs. 19 to 22: the curvature is a(t) cos(2π s / s1), so that the
# attitude is μ sin(2π s / s1) with μ = a s1 / 2π, and the curve ends straight ahead of the base
# with the tangent that it began with, at h = J0(μ) s1. Points between follow from the expansion
# of Jacobi and Anger:
#
#     cos(μ sin φ) = J0 + 2 Σ J_2k cos 2kφ        sin(μ sin φ) = 2 Σ J_2k+1 sin (2k+1)φ
#
# which is integrated term by term. As s1 comes down to h, dμ/ds1 has no bound; everything is a
# smooth function of μ, though, and rates are given along μ, too.

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

    def advanced(self, by: float) -> "Chord":
        """Return that of a base that is so much nearer to the entrance [m]."""
        return self._replace(base=self.base + by * self.axes[1], h=self.h - by)

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

    def directions(self, angles: Array) -> Array:
        """Return unit vectors (m, 3) in World at angles (m,) from ahead to aside [rad]."""
        return np.column_stack((np.sin(angles), np.cos(angles))) @ self.axes


class Exterior(Protocol):
    """A curve of free length s1 from the base, with its tangent, to the entrance, with its own."""

    @property
    def chord(self) -> Chord:
        """From where to where it goes."""
        ...

    def between(self, chord: Chord) -> Self:
        """Return the same from another base."""
        ...

    def tangents(self, s1: float, stations: Array) -> Array:
        """Return unit tangents (m, 3) at arc lengths (m,) up to s1 [m]."""
        ...

    def at(self, s1: float, stations: Array) -> tuple[Array, Array]:
        """Return points (m, 3) [m] at arc lengths (m,) up to s1 [m], and their ∂/∂s1 (m, 3).

        Raises `ValueError` for a free length that it cannot have.
        """
        ...


class Bow(NamedTuple):
    """The exterior of the paper's example: one period of a cosine of curvature."""

    chord: Chord

    def between(self, chord: Chord) -> "Bow":
        """Return the same from another base."""
        return Bow(chord)

    def tangents(self, s1: float, stations: Array) -> Array:
        """Return unit tangents (m, 3) at arc lengths (m,) up to s1 [m]."""
        mu = bow_parameter(self.chord.share_of(s1))
        return self.chord.directions(mu * np.sin(2.0 * np.pi / s1 * stations))

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


@inner_kernel
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


# --- A backbone curve: free from the base to the entrance, and where the tunnels are from there on


class Sampled(NamedTuple):
    """The curve at some arc lengths."""

    points: Array
    """(m, 3) in World [m]"""
    rates: Array
    """∂/∂s1 of the points at given arc lengths (m, 3): tunnels move nothing but along them [1]."""


class Curve(NamedTuple):
    """A curve of fixed length that slides through tunnels as its free length s1 shrinks.

    Its base may move (eq. 1): a feed advances it along the chord, in proportion to s1.
    """

    exterior: Exterior
    """Of a base that is fed, at the free length `longest`."""
    arcs: Arcs
    """The curve beyond the entrance: tunnels, and gaps between them."""
    fed: float = 0.0
    """The base advances by so much of what the free length shrinks by [1]."""
    longest: float = 0.0
    """Free length with the base farthest back [m]."""

    def from_foot(self, foot: Array) -> "Curve":
        """Return the same curve with its base at a place (3,) in World [m] where it stands."""
        chord = self.exterior.chord
        by = float((foot - chord.base) @ chord.axes[1])
        return Curve(self.exterior.between(chord.advanced(by)), self.arcs)

    def at(self, s1: float, stations: Array) -> Sampled:
        """Return the curve of free length s1 [m] at increasing arc lengths (m,) from its base [m].

        Raises `ValueError` where the exterior cannot be that short.
        """
        free = int(stations.searchsorted(s1, side="right"))
        points, rates = np.empty((2, len(stations), 3))
        points[:free], rates[:free] = self._free(s1, stations[:free])
        points[free:], tangents = self.arcs.at(stations[free:] - s1)
        # Chirikjian & Burdick, eq. 14: the interior's travelling wave slides along itself.
        np.negative(tangents, out=rates[free:])
        return Sampled(points, rates)

    def _free(self, s1: float, stations: Array) -> tuple[Array, Array]:
        if self.fed == 0.0:
            return self.exterior.at(s1, stations)
        chord = self.exterior.chord.advanced(self.fed * (self.longest - s1))
        exterior = self.exterior.between(chord)
        points, rates = exterior.at(s1, stations)
        # From its base p(s, s1, h) grows in proportion: s ∂p/∂s + s1 ∂p/∂s1 + h ∂p/∂h = p.
        along = stations[:, None] * exterior.tangents(s1, stations)
        per_h = (points - chord.base - along - s1 * rates) / chord.h - chord.axes[1]
        return points, rates + self.fed * per_h


# --- The free part of a backbone as a sum of modes: other shapes than one cosine of curvature -----
#
# The attitude is μ f(s / s1), f(σ) = Σ c_m sin 2πmσ. f is odd about the middle: the curve ends
# straight ahead of the base with the tangent that it began with, as in Chirikjian & Burdick,
# eq. 19, whose curve is the first mode alone; and h = s1 ∫ cos(μ f) dσ is their eq. 20. With
# modes 1 and −1/2 the curvature begins and ends with 0, and the joint at the base does not
# jump. Integrals are Gauss and Legendre's, from station to station.

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

    def between(self, chord: Chord) -> "Modal":
        """Return the same from another base."""
        return Modal(chord, self.modes)

    def tangents(self, s1: float, stations: Array) -> Array:
        """Return unit tangents (m, 3) at arc lengths (m,) up to s1 [m]."""
        mu = modal_parameter(self.modes, self.chord.share_of(s1))
        waves = np.outer(2.0 * np.pi / s1 * stations, np.arange(1, len(self.modes) + 1))
        return self.chord.directions(mu * (np.sin(waves) @ self.modes))

    def at(self, s1: float, stations: Array) -> tuple[Array, Array]:
        """Return points (m, 3) [m] at arc lengths (m,) up to s1 [m], and their ∂/∂s1 (m, 3).

        Raises `ValueError` where s1 is not above h, and where no curve of these modes is so long.
        """
        mu = modal_parameter(self.modes, self.chord.share_of(s1))
        if not mu > 0.0:
            raise ValueError(f"free length {s1} m: the modes bow out by less than that")
        return self.chord.placed(modal_at(self.modes, mu, self.chord.h, stations))


@inner_kernel
def _shape(modes: Array, share: float) -> float:
    """Return f(σ) at a share of the free length (0 to 1) [1]."""
    found = 0.0
    for m in range(len(modes)):
        found += modes[m] * math.sin(2.0 * math.pi * (m + 1) * share)
    return found


@inner_kernel
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


# --- The curve of a cell: its exterior, and its tunnels one after the other, with the gaps between

NEAREST = 0.01
"""The entrance is at least so far from the first joint that turns [m]."""
FINE = 0.02
"""A tunnel that is near to itself is looked at in steps of so many half widths [1]."""
STRAIGHT = 1e-3
"""The entrance lies so well straight ahead of the first joint, in lengths of the way there [1]."""


def curve_of(cell: Cell, section: BackboneSection, chain: Chain) -> Parts[Curve]:
    """Lay the curve of a cell's arm, its gaps in parts.

    Raises `ConfigError` for what the arm cannot follow.
    """
    where = f"{cell.path}: mechanism.backbone"
    T = Pose.from_xyz_rpy(section.entrance.xyz, section.entrance.rpy)
    back, front = _feet(chain, section)
    ahead, fed = T.p - back, front - back
    h, advance = float(np.linalg.norm(ahead)), float(fed @ T.R[:, 0])
    if np.linalg.norm(fed - advance * T.R[:, 0]) > STRAIGHT * h or advance < 0.0:
        raise ConfigError(
            f"{where}.feed: must take the arm ahead from back to front, along the entrance's x"
        )
    if h - advance < NEAREST:
        raise ConfigError(
            f"{where}.entrance: {h - advance:.4f} m from the first joint that turns: must be at "
            f"least {NEAREST:g}"
        )
    straight = chain.points(np.zeros((1, chain.n)))[0]
    out = straight[-1] - straight[chain.foot]
    off = max(
        float(np.linalg.norm(ahead / h - T.R[:, 0])),
        float(np.linalg.norm(out / np.linalg.norm(out) - T.R[:, 0])),
    )
    if off > STRAIGHT:
        raise ConfigError(
            f"{where}.entrance: must lie straight ahead of the first joint, along x: "
            f"{off:.4f} rad off"
        )
    if section.least < 1.02 * (h - advance):
        raise ConfigError(
            f"{where}.least: value {section.least:g}: must be at least 1.02 times the way to "
            f"the entrance, {h - advance:.4f} m: joints' speeds have no bound there"
        )
    if chain.length < 1.02 * h:
        raise ConfigError(
            f"{where}.entrance: {h:.4f} m away with the feed back: the arm of {chain.length:.4f} "
            "m must be 1.02 times as long"
        )
    if section.start > chain.length:
        raise ConfigError(
            f"{where}.start: value {section.start:g}: the arm is {chain.length:.4f} m long"
        )
    arcs = yield from _arcs(T, cell, section, chain, where)
    _judge_passages(arcs, section, chain.length, where)
    bow = _bow_angle(section)
    aside = T.R @ np.array([0.0, np.cos(bow), np.sin(bow)])
    chord = Chord(back, np.stack((aside, T.R[:, 0])), h)
    modal = section.exterior == "modal"
    exterior = Modal(chord, np.array(section.modes)) if modal else Bow(chord)
    return Curve(exterior, arcs, advance / (chain.length - section.least), chain.length)


def _feet(chain: Chain, section: BackboneSection) -> tuple[Array, Array]:
    """Return where the foot is at the greatest and the least free length (3,) in World [m]."""
    feed = section.feed
    if feed is None:
        return chain.foot_at(0.0), chain.foot_at(0.0)
    return chain.foot_at(feed.back), chain.foot_at(feed.front)


def told_section(section: BackboneSection, tunnel: ToldTunnel) -> BackboneSection:
    """Return the section with the tunnel that an operator told; the free part bows out as before.

    Raises `ValueError` for pieces that no cell file may have.
    """
    names, walled = ("length", "bend", "climb", "roll"), len(tunnel.pieces) - tunnel.open
    pieces: list[dict[str, object]] = []
    for i, piece in enumerate(tunnel.pieces):
        told: dict[str, object] = dict(zip(names, piece, strict=False))
        if len(piece) > len(names):
            told = {"length": piece[0], "to": {"xyz": piece[1:4], "rpy": piece[4:]}}
        pieces.append({**told, "open": i >= walled})
    bow = math.remainder(_bow_angle(section), 2.0 * math.pi)
    try:
        return section.model_copy(update={"tunnel": pieces, "bow": bow})
    except ValidationError as error:
        # It names the cell's key; here pieces were told.
        words = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise ValueError(words.replace("tunnel[", "pieces[")) from None


def centre_line(section: BackboneSection, step_m: float) -> list[list[Pose]]:
    """Return frames along what has walls, at most so far apart: a row for each without a gap.

    Their x is the tangent, y is to the left; in World.
    """
    T = Pose.from_xyz_rpy(section.entrance.xyz, section.entrance.rpy)
    rows = [[T]]
    for piece in section.tunnel:
        if piece.open:
            break
        if piece.to is not None:
            T = Pose.from_xyz_rpy(piece.to.xyz, piece.to.rpy)
            rows.append([T])
            continue
        count = math.ceil(piece.length / step_m)
        onward = Turn(*(value / count for value in _turn(piece))).end
        for _ in range(count):
            T = T @ onward
            rows[-1].append(T)
    return rows


def _turn(piece: SegmentSection) -> Turn:
    return Turn(piece.length, piece.bend, piece.climb, piece.roll)


def sharpest_bend(cell: Cell, section: BackboneSection, chain: Chain) -> float:
    """Return the greatest curvature that the joints' ranges can follow [1/m]."""
    low, high = joint_bounds(cell.robot.joints, cell.config.mechanism.drives)
    most = min(*(abs(x) for x in low), *(abs(x) for x in high))
    links = np.diff(chain.stations, prepend=0.0)
    return most / (float(links.max()) * (1.0 if section.axes == "planar" else 2.0))


def _arcs(T: Pose, cell: Cell, section: BackboneSection, chain: Chain, where: str) -> Parts[Arcs]:
    """Return the pieces of a tunnel one after the other, with the curves across its gaps.

    Raises `ConfigError` for a gap that no curve crosses which joints can follow.
    """
    planar, sharpest = section.axes == "planar", sharpest_bend(cell, section, chain)
    pieces: list[Arcs] = []
    for i, piece in enumerate(section.tunnel):
        turns = [_turn(piece)]
        if piece.to is not None:
            to = Pose.from_xyz_rpy(piece.to.xyz, piece.to.rpy)
            try:
                turns = yield from solve_gap(T, to, piece.length, planar, sharpest)
            except ValueError as error:
                raise ConfigError(f"{where}.tunnel[{i}].to: {error}") from None
        pieces.append(Arcs.from_entrance(T, turns))
        T = pieces[-1].end if piece.to is None else to
    return Arcs.of_all(pieces)


def _judge_passages(arcs: Arcs, section: BackboneSection, reach: float, where: str) -> None:
    """Raise `ConfigError` where two passages of a tunnel are one, as far as the arm reaches [m].

    So is a helix whose turns are less than the tunnel's width apart. No piece's radius is within
    the half width: places up to π half widths from each other along the curve are apart by no less
    than those of a semicircle of that radius (Schur's comparison theorem).
    """
    lengths = np.array([piece.length for piece in section.tunnel])
    ends = np.cumsum(lengths)
    gaps = [i for i, piece in enumerate(section.tunnel) if piece.to is not None]
    exit_at = ends[sum(not piece.open for piece in section.tunnel) - 1]
    runs = np.column_stack(([0.0, *ends[gaps]], [*(ends - lengths)[gaps], exit_at])).clip(max=reach)
    half = section.half_width
    off, *at = passages_meet(arcs[:], runs, math.pi * half, 2.0 * half, FINE * half)
    if off < math.inf:
        one, other = (int(np.searchsorted(ends[:-1], x, side="right")) for x in at)
        raise ConfigError(
            f"{where}.tunnel[{other}]: its centre line comes to {off:.4f} m of that of "
            f"tunnel[{one}]: at least {2.0 * half:g} m, two half widths, leave a wall between"
        )


def _bow_angle(section: BackboneSection) -> float:
    """Return where the exterior bows out to, about the entrance's x from its y [rad]."""
    angle = section.bow
    if angle is None:
        bend, climb = next(((s.bend, s.climb) for s in section.tunnel if s.bend or s.climb), (1, 0))
        angle = float(np.arctan2(-climb, -bend))
        if section.axes != "planar":
            angle += np.pi / 4
    return float(angle)
