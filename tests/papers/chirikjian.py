"""Chirikjian & Burdick 1992: the backbone's curve and the joints that follow it."""

from itertools import pairwise
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from telerobot.config.load import load_cell
from telerobot.server.control.backbone.fit import Chain
from telerobot.server.control.spatial import Array

from .exhibit import Exhibit, Paper, Shown, at_least, at_most, recalled
from .maze import MAZE, S1, H, L, alternating, descended, planar, planar_points
from .runs import run
from .style import BODY, BOUND, COLOURS, PRINTED, above, label, panels, svg

FREE = 0.68
"""Free length at which the fit leaves most, of the six [1]."""
COUNTS: Final = (10, 20, 30, 50, 100, 200, 300, 500, 1000)
DENSE: Final = (10, 20, 30, 50, 100)
"""So many joints are also fitted by a dense solver, which takes the cube of their number."""
CURVE = np.linspace(0.0, 1.0, 151)
"""Arc lengths at which curves are drawn [1]."""
HALF_WIDTH = 0.022
"""Half of the tunnel's width in the pictures [1]."""
KAPPA, TORSION, JOINTS = 3.0, 2.0, 30
"""Quasi-curvature and quasi-torsion of the curve in space [1/length], and joints along it."""


# --- What the equations say, computed without the server's code -----------------------------------


def bessel_0(x: float) -> float:
    """Return J0(x) by its integral, ∫ cos(x sin t) dt / π from 0 to π."""
    return float(np.cos(x * np.sin(np.arange(400) * np.pi / 400)).mean())


def printed_mu(s1: float) -> float:
    """Return μ = J0⁻¹(h / s1) of eq. 21 by bisection on (0, 2.405)."""
    low, high = 0.0, 2.404825557695773
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if bessel_0(middle) > H / s1 else (low, middle)
    return 0.5 * (low + high)


def printed_theta(s1: float, s: Array) -> Array:
    """Return θ (m,) of eq. 25 at arc lengths (m,) [rad]; 0 below s = 0, as eq. 29 needs it."""
    mu, along = printed_mu(s1), s - s1
    free = (s >= 0.0) & (along < 0.0)
    found: Array = np.where(free, mu * np.sin(2.0 * np.pi * s / s1), 0.0)
    windows = [(along >= k * L) & (along < (k + 1) * L) for k in range(3)]
    found += -np.pi / L * along * windows[0]
    found += (np.pi / L * (along - L) - np.pi) * windows[1]
    found += -np.pi / L * (along - 2.0 * L) * windows[2]
    found -= np.pi * (along >= 3.0 * L)
    return found


def printed_curve(s1: float, stations: Array) -> Array:
    """Return points (m, 2) of eq. 4 at increasing arc lengths, by midpoints 2e-5 long."""
    edges = [0.0, *stations.tolist()]
    found, at = [], np.zeros(2)
    for begin, end in pairwise(edges):
        # The curvature jumps at s1 and between the semicircles: no panel lies across.
        jumps = [s1 + k * L for k in range(4) if begin < s1 + k * L < end]
        for a, b in pairwise([begin, *jumps, end]):
            count = max(1, round((b - a) / 2e-5))
            middles: Array = a + (b - a) / count * (np.arange(count, dtype=float) + 0.5)
            theta = printed_theta(s1, middles)
            at = at + np.array([np.sin(theta).sum(), np.cos(theta).sum()]) * (b - a) / count
        found.append(at)
    return np.array(found)


def printed_start(s1: float, n: int) -> Array:
    """Return joints (n,) by eq. 29 with ε = 0 [rad]; about z, while θ is clockwise."""
    theta = printed_theta(s1, np.arange(-1, n, dtype=float) / n + 0.5 / n)
    return -np.diff(theta)


# --- Pictures and numbers -------------------------------------------------------------------------


def fitted(chain: Chain, points: Array) -> Array:
    """Return joints (n,) that follow points (n, 3) of a curve [rad]."""
    return chain.settled(chain.guess(points), points, np.zeros((chain.n, 3))).q


def farthest(points: Array, curve: Array) -> float:
    """Return the greatest distance of points (m, k) from those of a curve (m, k)."""
    return float(np.linalg.norm(points - curve, axis=1).max())


def _maze(ax: Axes) -> None:
    """Draw the tunnel of figure 3."""
    depths = np.linspace(0.0, 3.0 * L, 61)
    centre, tangents = (found[:, :2] for found in MAZE.arcs.at(depths))
    aside = HALF_WIDTH * np.column_stack((-tangents[:, 1], tangents[:, 0]))
    outline = np.vstack((centre + aside, (centre - aside)[::-1]))
    ax.add_patch(Polygon(outline, facecolor=BODY, edgecolor="none"))
    ax.plot(0.0, 0.0, "s", color="black", ms=3)
    ax.set_aspect("equal")


def figure_4() -> Shown:
    """Show the continuous arm at six free lengths."""
    figure, axes = panels(2, 3, 4.4, sharex=True, sharey=True)
    marked = np.linspace(0.0, 1.0, 41)[1:]
    off, entrance, length, mu = 0.0, 0.0, 0.0, 0.0
    for i, (ax, s1) in enumerate(zip(axes, S1, strict=True)):
        _maze(ax)
        ours, printed = MAZE.at(s1, CURVE).points[:, :2], printed_curve(s1, marked)
        ax.plot(*ours.T, color=COLOURS[0], label="telerobot")
        ax.plot(*printed.T, **PRINTED, label="eqs. 4 and 25")
        label(ax, "x₁ [1]" if i > 2 else "", "x₂ [1]" if i % 3 == 0 else "", f"s₁ = {s1:.2f}")
        off = max(off, farthest(MAZE.at(s1, marked).points[:, :2], printed))
        entrance = max(
            entrance, farthest(MAZE.at(s1, np.array([s1])).points[:, :2], np.array([[0.0, H]]))
        )
        dense = MAZE.at(s1, np.linspace(0.0, 1.0, 20001)).points
        length = max(length, abs(np.linalg.norm(np.diff(dense, axis=0), axis=1).sum() - 1.0))
        mu = max(mu, printed_mu(s1))
    above(figure, axes[0])
    return Shown(
        [
            at_most("six curves, farthest from eqs. 4 and 25", off, "0", 1e-7),
            at_most("curve at s₁, off the entrance (0, 0.4)", entrance, "0", 1e-9),
            at_most("length of the curves less 1", length, "0", 1e-6),
            at_most("greatest μ = a s₁ / 2π, at s₁ = 1", mu, "< 2.405", 2.405),
        ],
        svg(figure),
    )


def figure_5() -> Shown:
    """Show ten links fitted to these curves."""
    figure, axes = panels(2, 3, 4.4, sharex=True, sharey=True)
    n, chain = 10, planar(10)
    starts, offs, over, linear = [], [], [], []
    for i, (ax, s1) in enumerate(zip(axes, S1, strict=True)):
        _maze(ax)
        curve = MAZE.at(s1, chain.stations).points
        q, start = fitted(chain, curve), printed_start(s1, n)
        placed = chain.points(q[None])[0][:, :2]
        least = descended(start[None], curve[:, :2], np.ones(n), 200)[1][0]
        ax.plot(*MAZE.at(s1, CURVE).points[:, :2].T, color="0.65", lw=0.9)
        ax.plot(*placed.T, "-", color=COLOURS[0], marker="o", ms=2.6, label="telerobot, 10 links")
        ax.plot(*printed_curve(s1, chain.stations).T, **PRINTED, label="curve at i / n")
        label(ax, "x₁ [1]" if i > 2 else "", "x₂ [1]" if i % 3 == 0 else "", f"s₁ = {s1:.2f}")
        starts.append(farthest(planar_points(start[None])[0][0], curve[:, :2]))
        offs.append(farthest(placed[1:], curve[:, :2]))
        stepped = chain.fitted(start, curve, np.zeros((n, 3)), 1).q
        linear.append(float(descended(stepped[None], curve[:, :2], np.ones(n), 0)[1][0]) / least)
        over.append(((placed[1:] - curve[:, :2]) ** 2).sum() / least - 1.0)
    above(figure, axes[0])
    return Shown(
        [
            recalled(
                "joints off the curve by eq. 29 alone", max(starts), "left open", 0.0478, 1e-4
            ),
            recalled("joints off the curve, fitted", max(offs), "left open", 0.0097, 1e-4),
            recalled("G after one linear step, over the least", max(linear), "near 1", 1.02, 1e-2),
            at_most("G above the least that a dense solver finds", max(over), "0", 1e-9),
        ],
        svg(figure),
    )


def slither() -> Shown:
    """Show thirty driven joints that slither through the maze, in the physics."""
    found, cell = run("snake", "figure_5"), load_cell("snake")
    chain = Chain.from_cell(cell)
    length = chain.length
    told = [state.insertion for state in found.states]
    free = np.array([np.nan if i is None else 1.0 - i["depth"] / length for i in told])
    clock = np.array([state.time_s for state in found.states])
    figure, axes = panels(2, 3, 4.4, sharex=True, sharey=True)
    offs, apart = [], 0.0
    for i, (ax, s1) in enumerate(zip(axes, S1, strict=True)):
        _maze(ax)
        at = int(np.nanargmin(np.abs(free - s1)))
        apart = max(apart, abs(float(free[at]) - s1))
        truth = min(found.truths, key=lambda truth: abs(truth.time_s - clock[at]))
        placed = chain.points(np.array([truth.q]))[0][:, :2] / length
        curve = printed_curve(float(free[at]), chain.stations / length)
        offs.append(1e3 * length * farthest(placed[1:], curve))
        ax.plot(*placed.T, color=COLOURS[0], marker="o", ms=2.0, lw=1.1, label="30 driven joints")
        ax.plot(*curve.T, **PRINTED | {"ms": 2.8, "mew": 0.6}, label="eqs. 4 and 25")
        label(ax, "x₁ [1]" if i > 2 else "", "x₂ [1]" if i % 3 == 0 else "", f"s₁ = {s1:.2f}")
    above(figure, axes[0])
    gap = 1e3 * min(t.clearance_m for t in found.truths if t.clearance_m is not None)
    press = max(arm.contact_peak for t in found.truths for arm in t.arms.values())
    return Shown(
        [
            at_most("s₁ of the six instants, from the printed ones", apart, "0", 2e-3),
            at_most(
                "farthest joint off the curve, arm of 1.5 m", max(offs), "left open", 4.0, "mm"
            ),
            at_least("least distance from the tunnel's walls", gap, "confined", 8.0, "mm"),
            at_most("force on the walls", press, "0", 0.0, "N"),
        ],
        svg(figure),
    )


def growth() -> Shown:
    """Show what the fit leaves, from 10 to 1000 joints."""
    G, offs, dense = [], [], []
    for n in COUNTS:
        chain = planar(n)
        curve = MAZE.at(FREE, chain.stations).points
        placed = chain.points(fitted(chain, curve)[None])[0][1:]
        G.append(0.5 * float(((placed - curve) ** 2).sum()))
        offs.append(farthest(placed, curve))
        if n in DENSE:
            start = printed_start(FREE, n)[None]
            dense.append(0.5 * float(descended(start, curve[:, :2], np.ones(n), 200)[1][0]))
    figure, (left, right) = panels(1, 2, 2.9)
    left.loglog(COUNTS, G, color=COLOURS[0], marker=".", label="telerobot")
    left.loglog(DENSE, dense, **PRINTED, label="dense least squares from eq. 29")
    left.loglog(COUNTS, G[-1] * (1000.0 / np.array(COUNTS)) ** 3, **BOUND, label="n⁻³")
    label(left, "joints n [1]", "G of eq. 30 [1]", "sum of squares")
    right.loglog(COUNTS, offs, color=COLOURS[0], marker=".", label="telerobot")
    right.loglog(COUNTS, offs[-1] * (1000.0 / np.array(COUNTS)) ** 2, **BOUND, label="n⁻²")
    label(right, "joints n [1]", "distance [1]", "farthest joint")
    for ax in (left, right):
        ax.legend(loc="lower left")
    apart = max(abs(a / b - 1.0) for a, b in zip(G, dense, strict=False))
    order = np.polyfit(np.log(COUNTS[5:]), np.log(G[5:]), 1)[0]
    beside = "left open"
    return Shown(
        [
            at_most("G against a dense solver's, up to 100 joints, less 1", apart, "0", 1e-8),
            recalled("G, 10 joints", G[0], beside, 1.6327e-4, 1e-8),
            recalled("G, 100 joints", G[COUNTS.index(100)], beside, 1.0666e-7, 1e-11),
            recalled("G, 1000 joints", G[-1], beside, 1.0200e-10, 1e-13),
            recalled("order of G in n, from 200 joints on", order, beside, -3.0, 0.05),
        ],
        svg(figure),
    )


def printed_space(stations: Array) -> Array:
    """Return points (m, 3) of eq. 6 with constant quasi-curvature and quasi-torsion, by midpoints.

    Stations are evenly spaced, beyond 0.
    """
    fine = 200
    step = stations[0] / fine
    s = (np.arange(fine * len(stations)) + 0.5) * step
    K, T = KAPPA * s, TORSION * s
    x = np.stack((np.sin(K) * np.cos(T), np.cos(K) * np.cos(T), np.sin(T)), axis=1)
    found: Array = np.cumsum(x, axis=0)[fine - 1 :: fine] * step
    return found


def space() -> Shown:
    """Show thirty joints, about two axes in turn, at stations of the curve in space."""
    chain = alternating(JOINTS)
    curve = printed_space(chain.stations)
    placed = chain.points(fitted(chain, curve)[None])[0]
    off = np.linalg.norm(placed[1:] - curve, axis=1)
    figure, axes = panels(1, 3, 3.0)
    dense = np.vstack((np.zeros(3), printed_space(CURVE[1:])))
    for ax, (i, j) in zip(axes, ((0, 1), (0, 2)), strict=False):
        ax.plot(*dense[:, [i, j]].T, color="0.65", lw=0.9)
        ax.plot(
            *placed[:, [i, j]].T, color=COLOURS[0], marker="o", ms=2.4,
            label="telerobot, 30 joints",
        )  # fmt: skip
        ax.plot(*curve[:, [i, j]].T, **PRINTED, label="eq. 6 at i / n")
        label(ax, f"x{'₁₂₃'[i]} [1]", f"x{'₁₂₃'[j]} [1]", ("from above", "from the side")[j - 1])
        ax.axis("equal")
    axes[2].plot(np.arange(1, JOINTS + 1), 1e3 * off, color=COLOURS[0], marker=".")
    axes[2].axvline(0.5 * np.pi / TORSION * JOINTS, **BOUND)
    axes[2].annotate("T = π/2", (0.5 * np.pi / TORSION * JOINTS, 2.2), ha="right")
    label(axes[2], "joint i [1]", "distance [10⁻³]", "off their stations")
    axes[2].set_ylim(0.0, 2.5)
    above(figure, axes[0])
    return Shown(
        [
            recalled("farthest joint off its station", off.max(), "left open", 1.752e-3, 1e-5),
            recalled("tip off the end of the curve", off[-1], "left open", 2.73e-4, 1e-5),
        ],
        svg(figure),
    )


CHIRIKJIAN = Paper(
    "A Geometric Approach to Hyper-Redundant Manipulator Obstacle Avoidance",
    "Chirikjian and Burdick, Journal of Mechanical Design 114, 1992",
    {
        "figure_4": Exhibit(
            "Figs. 3 and 4, eqs. 4 and 19–25",
            "The backbone slides through a maze",
            "Six configurations with h = 0.4, L = 0.2 and s₁ = 1.00, 0.94, 0.83, 0.68, 0.54, 0.44, "
            "in lengths of the arm.",
            "κ of eq. 3 has a sign, though the text below it prints a magnitude. The last term of "
            "eq. 25 never acts here, since s₁ + 3L ≥ 1.04. Below eq. 13 read s₂ᵢ − s₂ᵢ₋₁ = const: "
            "the segments inside a tunnel have even numbers. κ jumps at s₁ and between the "
            "semicircles, so the tangent is continuous and the curvature is not.",
            "The curve of the server at six free lengths, over points of the printed equations, "
            "which are integrated numerically.",
            'make papers ARGS="--only figure_4"',
            figure_4,
        ),
        "figure_5": Exhibit(
            "Fig. 5, eqs. 26–30",
            "Ten links follow the backbone",
            "Ten links fitted to the six configurations: joint angles by eq. 29, then the least "
            "sum of squared distances, eq. 30.",
            "The integrals of eq. 30 end at k / n, not at k. Eq. 29 asks for θ below s = 0, where "
            "it must be 0.",
            "Ten links of the server's fit; circles are where the curve is at i / n.",
            'make papers ARGS="--only figure_5"',
            figure_5,
        ),
        "slither": Exhibit(
            "Figs. 4 and 5, section 3.1",
            "Thirty driven joints in the maze",
            "The arm slithers through the tunnel: inside, its curvature is a travelling wave.",
            "As s₁ comes down to h, dμ/ds₁ has no bound, and joints would have to turn infinitely "
            "fast: the server ends at s₁ = 0.42. The insertion is as fast as every joint's "
            "bounds allow.",
            "An arm of 1.5 m in the physics, on drives of two buses, at the instants when its free "
            "length is the printed one.",
            'make papers ARGS="--only slither"; telerobot simulate snake figure_5',
            slither,
        ),
        "growth": Exhibit(
            "Eq. 30",
            "What the fit leaves, from 10 to 1000 joints",
            "A hyper-redundant arm has many degrees of freedom, or infinitely many; an arm of ten "
            "links is shown.",
            "",
            "Least sum of squares and farthest joint at s₁ = 0.68. The server's fit takes a time "
            "that grows with n; the dense solver, which knows no structure, with its cube.",
            'make papers ARGS="--only growth"; make bench ARGS="--only fit"',
            growth,
        ),
        "space": Exhibit(
            "Eqs. 5 and 6",
            "Stations of a curve in space",
            "The spatial formulation, by quasi-curvature and quasi-torsion; no example is given.",
            "The parametrisation is singular where T = ±π/2: the curve points straight up there, "
            "and quasi-curvature turns it no more. The server's fit needs no such angles.",
            "A curve of constant quasi-curvature 3 and quasi-torsion 2, and thirty joints about "
            "two axes in turn at its stations.",
            'make papers ARGS="--only space"',
            space,
        ),
    },
)
