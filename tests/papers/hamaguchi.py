"""Hamaguchi & Taniguchi 2013: follow a hand, and avoid what is beside the arm before that."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from telerobot.config.load import Cell, altered, load_cell
from telerobot.config.schema.surroundings import ObstacleSection
from telerobot.protocols.messages.rig import RigTruth
from telerobot.server.control.mechanism.redundancy import alpha_of, size_of
from telerobot.server.control.spatial import Array

from .exhibit import Exhibit, Number, Paper, Shown, at_least, at_most, near, recalled
from .runs import run
from .style import BODY, BOUND, COLOURS, PRINTED, above, label, panels, svg

POLE_CELL, HAND_CELL = "pa10_hand_pole", "pa10_hand"
PAPER_CELL = "pa10_hand_paper"
"""At torque level, with the paper's own impedance."""
CASES: Final[Mapping[int, Mapping[str, object]]] = {
    0: {"joints": (), "precedence": False},
    1: {"joints": ("s1",), "precedence": False},
    2: {"joints": ("s1", "s3"), "precedence": False},
    3: {"joints": ("s1", "s3"), "precedence": True},
}
"""Keys of `[priority]`: nothing, ξ₁ alone, ξ₁ and ξ₃, and both with the priority of avoidance."""
LEVELS: Final[Mapping[str, Mapping[str, object]]] = {
    "rate": {},
    "torque": {
        "mechanism.operation_mode": "cst", "torque.stiffness": 100.0, "torque.damping": 20.0,
    },
}  # fmt: skip
"""Keys of a cell: positions to the drives, or torques by the paper's k_e / m_e and b_e / m_e."""
PLAIN: Final[Mapping[str, object]] = {"sources.following.deadband": 0.0}
"""As printed: the cell takes forces below 0.3 N for noise, which keeps 10 mm of the way."""
CENTRE: Final = (0.4, 0.3, 0.78)
POLE: Final = ObstacleSection(name="pole", shape="box", xyz=CENTRE, half_size=(0.05, 0.05, 0.175))
"""Of the experiment."""
BALL: Final = ObstacleSection(name="ball", shape="sphere", xyz=CENTRE, radius=0.05)
"""Of the simulation."""
SHOULDER: Final = np.array([0.0, 0.0, 0.315])
"""In World (3,) [m]."""
L_MIN, L_MAX, K_A, K_B = 0.15, 0.25, 0.3, 5.0
FORCE_N, SWELL_S, MASS_KG, DAMPING = 4.0, 6.0, 1.0, 20.0
"""Hand, and impedance m_e and b_e [N, s, kg, N·s/m]."""


def case_of(case: int, obstacle: ObstacleSection, **keys: object) -> Cell:
    """Return the cell of one of the four cases beside an obstacle, with other keys changed too."""
    cell = altered(load_cell(POLE_CELL), CASES[case], "priority")
    return altered(cell, {"obstacles": (obstacle,), **keys})


def distances(truths: Sequence[RigTruth], obstacle: ObstacleSection = POLE) -> Array:
    """Return how far elbow and middle of the forearm truly are from an obstacle (k, 2) [m]."""
    half = np.zeros(3) if obstacle.half_size is None else np.array(obstacle.half_size)
    found = []
    for truth in truths:
        elbow = SHOULDER + _turned(truth.q[:2], 0.45)
        forearm = elbow + _turned(truth.q[:4], 0.25)
        out = np.maximum(np.abs(np.array([elbow, forearm]) - CENTRE) - half, 0.0)
        found.append(np.linalg.norm(out, axis=1) - (obstacle.radius or 0.0))
    return np.array(found)


def elbows(truths: Sequence[RigTruth]) -> Array:
    """Return where the elbow, joint 4, truly is in World (k, 3) [m]."""
    return np.array([SHOULDER + _turned(truth.q[:2], 0.45) for truth in truths])


def _turned(angles: Sequence[float], length: float) -> Array:
    """Return a link's vector (3,) [m] after rotations about z, y, z, y, as drawn in figure 7."""
    v = np.array([0.0, 0.0, length])
    for i in reversed(range(len(angles))):
        c, s = math.cos(angles[i]), math.sin(angles[i])
        about_z, about_y = [[c, -s, 0], [s, c, 0], [0, 0, 1]], [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        v = np.array(about_y if i % 2 else about_z) @ v
    return v


# --- Figures 5 and 6: the size of ξ, and the priority ---------------------------------------------


def xi_alpha() -> Shown:
    """Show the size of ξ and the priority over the distance."""
    law = load_cell(POLE_CELL).config.priority
    assert law is not None
    figure, (left, right) = panels(1, 2, 2.7)
    d, marks = np.linspace(0.10, 0.30, 81), np.linspace(0.10, 0.30, 21)
    printed_xi = np.where(marks <= L_MAX, K_A * (L_MAX - marks) / (L_MAX - L_MIN), 0.0)
    printed_alpha = np.minimum(np.exp(-K_B * (marks - L_MIN) / (L_MAX - L_MIN)), 1.0)
    for ax, ours, printed, names in (
        (left, size_of, printed_xi, ("|ξ₁|, |ξ₃| [rad/s]", "eq. 8")),
        (right, alpha_of, printed_alpha, ("priority α [1]", "eq. 9")),
    ):
        ax.plot(d, [ours(float(x), law) for x in d], color=COLOURS[0], label="telerobot")
        ax.plot(marks, printed, **PRINTED, label=names[1])
        ax.axvspan(0.10, L_MIN, color=BODY)
        label(ax, "distance d [m]", names[0])
        ax.legend()
    xi, alpha = (np.array([of(float(x), law) for x in marks]) for of in (size_of, alpha_of))
    off = float(np.abs([xi - printed_xi, alpha - printed_alpha]).max())
    return Shown(
        [
            at_most("ξ and α, farthest from eqs. 8 and 9", off, "0", 1e-12, "rad/s, 1"),
            near("α at L_max", alpha_of(L_MAX, law), math.exp(-K_B), 1e-9),
        ],
        svg(figure),
    )


# --- Figure 11 and eq. 4: the hand is followed ----------------------------------------------------


def led(t: Array) -> Array:
    """Return where m_e and b_e of eq. 4 are under F sin²(πt/6), from rest (k,) [m]: closed form."""
    w, tau, M, B = 2.0 * math.pi / SWELL_S, MASS_KG / DAMPING, MASS_KG, DAMPING
    s = np.clip(t, 0.0, SWELL_S)
    Z = B * B + (M * w) ** 2
    C = B / Z - 1.0 / B
    x = s / B - (B * np.sin(w * s) + M * w * (1.0 - np.cos(w * s))) / (w * Z)
    x = 0.5 * FORCE_N * (x + C * tau * (1.0 - np.exp(-s / tau)))
    v_end = 0.5 * FORCE_N * (1.0 / B - B / Z + C * math.exp(-SWELL_S / tau))
    found: Array = x + v_end * tau * (1.0 - np.exp(-np.maximum(t - SWELL_S, 0.0) / tau))
    return found


def following() -> Shown:
    """Show the tool that follows the hand, at both levels."""
    figure, (left, right) = panels(1, 2, 2.9)
    numbers: list[Number] = []
    for (level, keys), colour in zip(LEVELS.items(), COLOURS, strict=False):
        found = run(altered(load_cell(HAND_CELL), {**PLAIN, **keys}), "hand_swell")
        t = found.times
        poses = np.array([truth.pose_mrf for truth in found.truths])
        moved = poses[:, :3] - poses[int(np.argmin(np.abs(t))), :3]
        left.plot(t, moved[:, 1], color=colour, label=f"telerobot, {level} level")
        right.plot(t, 1e3 * (moved[:, 1] - led(t)), color=colour)
        aside = float(np.abs(moved[:, [0, 2]]).max())
        off = float(np.abs(moved[:, 1] - led(t)).max())
        numbers += [
            near(f"way at the end, {level} level", float(moved[-1, 1]), 0.6, 0.003, "m"),
            at_most(f"off eq. 4 at any time, {level} level", off, "0, but for the lag", 6e-3, "m"),
            at_most(f"off the hand's line, {level} level", aside, "0", 2e-3, "m"),
        ]
    marks = np.linspace(0.0, 7.0, 29)
    left.plot(marks, led(marks), **PRINTED, label="eq. 4, closed form")
    label(left, "time [s]", "y of the hand [m]", "way of the tool")
    label(right, "time [s]", "difference [mm]", "from eq. 4")
    left.legend()
    return Shown(numbers, svg(figure))


# --- Figures 10 to 20: four cases beside an obstacle ----------------------------------------------


def beside(obstacle: ObstacleSection, told: Mapping[int, str], expected: Array) -> Shown:
    """Show the distance of the nearer sphere in the four cases, at both levels.

    Least distances are `expected` (4,) [m]; the paper has `told` of them.
    """
    figure, axes = panels(1, 2, 3.0, sharey=True)
    numbers: list[Number] = []
    for ax, (level, keys) in zip(axes, LEVELS.items(), strict=True):
        least: list[float] = []
        for case in CASES:
            found = run(case_of(case, obstacle, **keys), "hand_swell")
            nearest = distances(found.truths, obstacle).min(axis=1)
            least.append(float(nearest.min()))
            ax.plot(found.times, nearest, color=COLOURS[case], label=f"case {case}")
        ax.axhline(L_MIN, **BOUND, label="L_min")
        label(ax, "time [s]", "d_min [m]" if ax is axes[0] else "", f"{level} level")
        numbers += [
            recalled(f"least d_min, case {i}, {level} level", d, told[i], expected[i], 1e-3, "m")
            for i, d in enumerate(least)
        ]
        rise = float(np.diff(least).min())
        numbers.append(at_least(f"rise from case to case, {level} level", rise, "> 0", 1e-5, "m"))
    above(figure, axes[0])
    return Shown(numbers, svg(figure))


def ball() -> Shown:
    """Show the simulation of section 5."""
    told = {0: "–", 1: "< 0.15", 2: "< 0.15", 3: "≥ 0.15"}
    return beside(BALL, told, np.array([0.2050, 0.2084, 0.2132, 0.2134]))


def pole() -> Shown:
    """Show the obstacle of section 6."""
    told = {0: "–", 1: "< 0.15", 2: "< 0.15", 3: "> 0.15"}
    return beside(POLE, told, np.array([0.0805, 0.1103, 0.1474, 0.1679]))


# --- Figures 17 to 19: both priorities, both levels -----------------------------------------------

PRIORITIES: Final = {"following first": False, "avoiding first": True}
BY_LEVEL: Final = {"rate": POLE_CELL, "torque": PAPER_CELL}
WAYS: Final = {False: 0.590, True: 0.461}
"""Way of the tool, without and with precedence [m]: as it was when the row was written."""


def levels() -> Shown:
    """Show distance, elbow and tool beside the pole, with and without priority, at both levels."""
    figure, axes = panels(3, 2, 5.6, sharex=True, sharey="row")
    numbers: list[Number] = []
    for column, (name, precedence) in enumerate(PRIORITIES.items()):
        ends: list[Array] = []
        for (level, shipped), colour in zip(BY_LEVEL.items(), COLOURS, strict=False):
            cell = altered(load_cell(shipped), {"priority.precedence": precedence})
            found, what = run(cell, "hand_swell"), f"{name}, {level} level"
            t, nearest = found.times, distances(found.truths).min(axis=1)
            elbow = elbows(found.truths)[:, 1]
            tool = np.array([truth.pose_mrf for truth in found.truths])[:, :3]
            moved = tool - tool[int(np.argmin(np.abs(t)))]
            for row, drawn in enumerate((nearest, elbow, moved[:, 1])):
                axes[2 * row + column].plot(t, drawn, color=colour, label=f"{level} level")
            ends.append(moved[-1])
            least, aside = float(nearest.min()), float(np.abs(moved[:, [0, 2]]).max())
            if precedence:
                turns = float(t[int(elbow.argmax())])
                numbers += [
                    at_least(f"least d_min, {what}", least, "> 0.15", L_MIN, "m"),
                    recalled(f"elbow turns back, {what}", turns, "about 4", 5.17, 0.15, "s"),
                ]
            else:
                numbers.append(at_most(f"least d_min, {what}", least, "< 0.15", L_MIN, "m"))
            way, expected = float(moved[-1, 1]), WAYS[precedence]
            numbers += [
                recalled(f"way of the tool, {what}", way, "left open", expected, 3e-3, "m"),
                at_most(f"off the hand's line, {what}", aside, "0", 2e-3, "m"),
            ]
        apart = float(np.linalg.norm(ends[1] - ends[0]))
        numbers.append(at_most(f"ends of both levels apart, {name}", apart, "0", 2e-3, "m"))
        axes[column].axhline(L_MIN, **BOUND, label="L_min")
        for row, y in enumerate(("d_min [m]", "y of joint 4 [m]", "y of the tool [m]")):
            end, first = row == 2, row == 0
            label(
                axes[2 * row + column],
                "time [s]" if end else "",
                "" if column else y,
                name if first else "",
            )
    above(figure, axes[0])
    return Shown(numbers, svg(figure))


HAMAGUCHI = Paper(
    "An Obstacle Avoidance Method for Action Support 7-DOF Manipulators Using Impedance Control",
    "Hamaguchi and Taniguchi, Journal of Robotics, 2013",
    {
        "xi_alpha": Exhibit(
            "Figs. 5 and 6, eqs. 8 and 9",
            "Rates of avoiding, and their priority",
            "Size of ξ₁ and ξ₃, and priority α, over the distance: L_min 0.15 m, L_max 0.25 m, "
            "k_a 0.3 rad/s, k_b 5.",
            "α is said to be 0 from L_max on; by eq. 9 it is e⁻⁵ = 0.0067 there. Eq. 8 gives a "
            "size only: the sign of each rate is that in which the self-motion leads away, and "
            "with the other one the arm is led to the obstacle.",
            "The server's laws over the printed ones; grey is the inner sphere.",
            'make papers ARGS="--only xi_alpha"',
            xi_alpha,
        ),
        "following": Exhibit(
            "Fig. 11, eqs. 4 and 6",
            "The hand is followed",
            "A hand's force moves a mass of 1 kg with a damping of 20 N·s/m, and the tool follows "
            "that reference at a stiffness of 100 N/m, every 10 ms.",
            "The force is printed as a picture only: ours is (0, 4, 0) N · sin²(πt/6) for 6 s. "
            "Eq. 6 alone leaves the self-motion to itself: the server adds a law in the "
            "dynamically consistent null space. The cell takes forces below 0.3 N for noise, "
            "which is off here.",
            "The true way of the tool in the physics, on drives that take positions and on drives "
            "that take torques; the difference is the loop's lag of some 25 ms.",
            'make papers ARGS="--only following"; telerobot simulate pa10_hand hand_swell; '
            "telerobot simulate pa10_hand_torque hand_swell",
            following,
        ),
        "ball": Exhibit(
            "Figs. 10 and 12–15",
            "Four cases beside the sphere of the simulation",
            "With ξ₁ alone and with both, the sphere of 0.05 m radius at (0.4, 0.3, 0.78) m comes "
            "inside L_min; with the priority of avoidance it never does.",
            "What is printed of the scene does not give the collision: a hand along y leads the "
            "elbow past the sphere at 0.205 m, without any avoidance. The force of Fig. 11 or the "
            "place of the sphere must have been another. The order of the cases is the printed "
            "one.",
            "True distance of the nearer of the spheres at joints 4 and 5; case 0 avoids nothing.",
            'make papers ARGS="--only ball"',
            ball,
        ),
        "pole": Exhibit(
            "Figs. 16–20",
            "Four cases beside the pole of the experiment",
            "The pole of 0.1 × 0.1 × 0.35 m at the same place is kept outside L_min by priority.",
            "No numbers are printed but the bounds. Table 2's axes are those of DH frames: I_y and "
            "I_z of links 2, 4 and 6 are exchanged in our model; the centres of mass of links 3, "
            "5 and 6 lie below their joints. J_4's and J_5's spheres are at elbow and middle of "
            "the forearm.",
            "The same hand beside the pole. Without priority the inner sphere is entered, as "
            "printed for the simulation; with it, it is not.",
            'make papers ARGS="--only pole"; telerobot simulate pa10_hand_pole hand_swell',
            pole,
        ),
        "levels": Exhibit(
            "Figs. 17–19, eq. 6",
            "Both priorities at both levels, with the paper's impedance",
            "With M_e 1 kg, B_e 20 N·s/m and K_e 100 N/m, avoiding before following keeps d_min "
            "above L_min; the 4th joint goes with the hand until about 4 s, and back until 6 s.",
            "The hand of Fig. 17 shook, and is printed as a picture only: ours is that of Fig. 11, "
            "whose 4th joint turns back as that force fades, a second later. The way "
            "of the tool is not printed: eq. 4 has 0.600 m for the whole force, and "
            "0.590 m without what the cell takes for noise, below 0.3 N.",
            "Beside the pole, by positions to the drives (`pa10_hand_pole`) and by the torques of "
            "eq. 6 (`pa10_hand_paper`). The curves lie on one another: their "
            "ends differ by less than a millimetre.",
            'make papers ARGS="--only levels"; telerobot simulate pa10_hand_pole; '
            "telerobot simulate pa10_hand_paper",
            levels,
        ),
    },
)
