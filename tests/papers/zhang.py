"""Zhang et al. 2013: an arm on wheels that sees a bridge, folds, and drives through below."""

import itertools
import math
import tempfile
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.rig import RigBridgeSection
from telerobot.server.control.arm import Arm
from telerobot.server.control.bodies.rates import ArmTick
from telerobot.server.control.inputs import Inputs, Intent, Settings
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.mechanism.potentials import manipulability_slope
from telerobot.server.control.scene import Flags
from telerobot.server.control.spatial import Array, Pose, pose_error, rotation_rpy, sizes
from telerobot.server.control.stop.limiter import Commanded
from telerobot.server.control.wheels import DifferentialDrive, Rolled
from telerobot.server.perception.scanning.reflex import CriticalPoints
from telerobot.tools.scripts.script import Script

from .exhibit import Exhibit, Paper, Shown, at_least, at_most, near, recalled
from .lwa3 import PLANE, START, bridge, cell_of, crossed, search, touched
from .rover import FOOT, Rover, filled, found_and_false
from .runs import Run, run
from .style import BOUND, COLOURS, PRINTED, above, label, panels, svg

ROVER, SCANNING, SKIDDING = "rover", "rover_bridge", "rover_skid"
ROLLING: Final = DifferentialDrive(radius=0.12, track=0.5)
"""The base of the cell `rover`."""
K, STEP_S, STEPS = 1.0, 1e-3, 1000
REACHED_OUT_S: Final = 5.3
"""When the arm has reached out, and its tool is held in World [s]."""
HERE: Final = {"xyz": (0.0, 0.0, 0.0), "rpy": (0.0, 0.0, 0.0), "relative_to": "mrf"}
REACHING: Final[Any] = [
    {"at_s": 0.2, "cmd/posture": {"posture": "ready"}},
    {"at_s": 2.5, "cmd/position": {**HERE, "xyz": (0.0, 0.0, 0.28), "speed": 0.25}},
    {"at_s": 5.0, "operator/frame": {"frame": "crf", "moves_with": "world"}},
    {"at_s": 5.2, "cmd/position": HERE},
]
ARM: Final = slice(2, None)
"""The arm's joints, behind the wheels, whose angles change nothing of it."""
SPOT_S: Final = (5.5, 8.0)
"""While the script `skid` turns the base on the spot, at an even rate [s]."""
HEIGHT_M, HIGHER_M = 0.60, 0.65
"""Undersides of two bridges [m]; below the second an elbow from a grid, in place of one on its
circle, undoes what F₁ did."""


# --- Equations 1 to 8: a base and an arm as one ---------------------------------------------------


def worst_column(postures: int) -> float:
    """Return the greatest difference of J_n from finite differences of the tool's pose."""
    cell = load_cell(ROVER)
    mechanism, draw, h, worst = Mechanism.from_cell(cell), np.random.default_rng(1), 1e-5, 0.0
    T_wrist_mrf = Pose(rotation_rpy(0.3, -0.2, 0.5), np.array([0.05, -0.02, 0.14]))
    low = [max(joint.lower, -3.0) for joint in cell.robot.joints]
    high = [min(joint.upper, 3.0) for joint in cell.robot.joints]
    for _ in range(postures):
        q = draw.uniform(low, high)
        T = Pose(rotation_rpy(0.0, 0.0, draw.uniform(-3.0, 3.0)), draw.uniform(-5.0, 5.0, 3))
        J = mechanism.kinematics(q, T_wrist_mrf, T).J

        def pose(there: Array, q: Array = q, T: Pose = T) -> Pose:
            base = ROLLING.roll(Rolled.at(T, q[:2]), there[:2])
            return mechanism.pose_wrist(there, base) @ T_wrist_mrf

        for j, step in enumerate(h * np.eye(9)):
            slope = pose_error(pose(q + step), pose(q - step)) / (2.0 * h)
            worst = max(worst, float(np.abs(J[:, j] - slope).max()))
    return worst


def errors(arm: Arm, ahead_m: float, sign: float = 1.0) -> Array:
    """Return the tool's error (1 + steps, 2) [m, rad] by eq. 8, its error term times `sign`."""
    mrf = arm.p.T_wrist_tool
    q = np.array([0.0, 0.0, 0.1, -0.7, 0.1, 1.5, 0.1, 0.6, 0.1])
    base = Rolled.at(Pose.identity(), q[:2])
    target = arm.mechanism.pose_wrist(q, base) @ mrf
    away = target.p + np.array([ahead_m, 0.1 * ahead_m, 0.0])
    target = Pose(rotation_rpy(0.2, 0.1, -0.2) @ target.R, away)
    settings = Settings({}, mrf, Pose.identity(), np.zeros(6))
    inputs, found = Inputs(0.0, Intent.MOVE, q, settings), []
    for i in range(STEPS + 1):
        k = arm.mechanism.kinematics(q, mrf, base)
        e = pose_error(target, k.T_world_mrf)
        found.append(sizes(e))
        if i == STEPS:
            break
        told = Commanded.at_rest(q)
        request = ArmTick(inputs, k, k.T_world_wrist, np.zeros(9), told, T_world_base=base)
        request.objectives, request.asked = arm.redundancy.objectives, sign * K * e
        q = q + STEP_S * arm.body.rates(request).dq
        base = ROLLING.roll(base, q[:2])
    return np.array(found)


def kinematics() -> Shown:
    """Show the tool's error by eq. 8, with the sign that is needed and with the printed one."""
    arm = Arm.of(load_cell(ROVER))
    t = STEP_S * np.arange(STEPS + 1)
    added, subtracted = errors(arm, 0.3), errors(arm, 0.3, -1.0)
    figure, (left, right) = panels(1, 2, 2.9)
    for ax, column, unit, name in ((left, 0, "m", "position"), (right, 1, "rad", "attitude")):
        ax.plot(t, added[:, column], color=COLOURS[0], label="telerobot: K e added")
        ax.plot(t, subtracted[:, column], color=COLOURS[1], label="K e subtracted, as printed")
        ax.plot(t[::50], added[0, column] * np.exp(-K * t[::50]), **PRINTED, label="exp(−K t)")
        label(ax, "time [s]", f"error [{unit}]", name)
        ax.set_ylim(bottom=0.0)
    above(figure, left)
    decay, growth = added[-1] / added[0], subtracted[-1] / subtracted[0]
    return Shown(
        [
            at_most("J_n from finite differences, 30 postures", worst_column(30), "0", 1e-8),
            near("position error left after 1 s", float(decay[0]), math.exp(-1.0), 0.007),
            near("attitude error left after 1 s", float(decay[1]), math.exp(-1.0), 0.007),
            at_least("position error after 1 s, sign as printed", float(growth[0]), "decays", 2.0),
        ],
        svg(figure),
    )


# --- Equation 7: η_s of the whole robot -----------------------------------------------------------


def dexterity(mechanism: Mechanism, q: Array) -> float:
    """Return √det(J_n J_nᵀ) of base and arm."""
    J = mechanism.kinematics(q, Pose.identity(), Pose.identity()).J
    return math.sqrt(max(0.0, float(np.linalg.det(J @ J.T))))


def worst_slope(postures: int) -> float:
    """Return how far the server's slope of that is off finite differences, in parts of it."""
    cell = load_cell(ROVER)
    mechanism, draw, h, worst = Mechanism.from_cell(cell), np.random.default_rng(2), 1e-5, 0.0
    low = [max(joint.lower, -3.0) for joint in cell.robot.joints]
    high = [min(joint.upper, 3.0) for joint in cell.robot.joints]
    for _ in range(postures):
        q = draw.uniform(low, high)
        J = mechanism.kinematics(q, Pose.identity(), Pose.identity()).J
        slope = manipulability_slope(J, mechanism.rank)[1]
        steps = h * np.eye(len(q))
        found = [
            (dexterity(mechanism, q + s) - dexterity(mechanism, q - s)) / (2 * h) for s in steps
        ]
        off = float(np.abs(slope - found)[ARM].max())
        worst = max(worst, off / float(np.abs(found).max()))
    return worst


def held(objectives: tuple[str, ...]) -> Run:
    """Return a run that reaches out, and then holds its tool in World for ten seconds.

    The base takes part in the `objectives`.
    """
    keys = {"mechanism.base.objectives": objectives, "redundancy.manipulability": 2.0}
    cell = altered(load_cell(ROVER), keys | {"redundancy.posture": 0.0})
    return run(cell, Script.model_validate({"duration_s": 15.2, "step": REACHING}))


def eta_s() -> Shown:
    """Show a base that goes where base and arm are more dexterous, and the tool meanwhile."""
    mechanism = Mechanism.from_cell(load_cell(ROVER))
    figure, (left, middle, right) = panels(1, 3, 2.7)
    off, way, values = [], [], []
    for objectives, colour, name in (
        (("manipulability",), COLOURS[0], "base and arm"),
        ((), "0.6", "arm alone"),
    ):
        found = held(objectives)
        late = found.times > REACHED_OUT_S
        t = found.times[late] - REACHED_OUT_S
        truths = [truth for truth, chosen in zip(found.truths, late, strict=True) if chosen]
        q = np.array([truth.q for truth in truths])
        value = np.array([dexterity(mechanism, each) for each in q[::10]])
        base = np.array([truth.frames["base"][0] for truth in truths])
        tool = np.array([truth.pose_mrf[:3] for truth in truths])
        moved = np.linalg.norm(tool - tool[0], axis=1)
        left.plot(t[::10], value, color=colour, label=name)
        middle.plot(t, base - base[0], color=colour)
        right.plot(t, 1e3 * moved, color=colour)
        off.append(float(moved.max()))
        way.append(float(base[-1] - base[0]))
        values.append(value)
    right.axhline(0.0, **BOUND, label="not affected at all")
    right.legend()
    label(left, "time [s]", "√det(JₙJₙᵀ)")
    label(middle, "time [s]", "way of the base [m]")
    label(right, "time [s]", "tool moved [mm]")
    above(figure, left)
    numbers = [
        at_most("slope of √det(JₙJₙᵀ) off finite differences", worst_slope(20), "0", 1e-6),
        at_most("tool moved, base and arm", off[0], "not affected", 1e-3, "m"),
        at_most("tool moved, arm alone", off[1], "not affected", 1e-3, "m"),
        recalled("way of the base", way[0], "left open", -0.14, 0.01, "m"),
        at_most("way of the base, arm alone", abs(way[1]), "0", 1e-3, "m"),
        recalled("√det(JₙJₙᵀ) at first", float(values[0][0]), "left open", 0.017, 5e-4),
        recalled("at the end, base and arm", float(values[0][-1]), "greater", 0.023, 5e-4),
        recalled("at the end, arm alone", float(values[1][-1]), "left open", 0.017, 5e-4),
    ]
    return Shown(numbers, svg(figure))


# --- Section 2.1: a base on four driven wheels skids ----------------------------------------------


class Driven(NamedTuple):
    """A run of the script `skid`: where Base is, and where it is taken to be, from its start."""

    t: Array
    """(t,) [s]"""
    true: Array
    """x, y and yaw (t, 3) [m, rad]."""
    told: Array
    """The same by the wheels, or by wheels and gyroscope."""

    @property
    def off(self) -> Array:
        """How far they are apart (t, 2) [m, rad]."""
        x, y, yaw = (self.told - self.true).T
        return np.stack((np.hypot(x, y), np.abs(yaw)), axis=1)


def driven(*, rolls: bool = False, gyroscope: bool = False) -> Driven:
    """Return a run of the script `skid`; it `rolls` by eq. 3, where wheels are told not to skid."""
    keys: dict[str, object] = {} if gyroscope else {"mechanism.imu": None}
    if rolls:
        keys |= {"mechanism.base.wheels.slip_factor": 1.0, "mechanism.base.wheels.centre": 0.0}
    cell = altered(load_cell(SKIDDING), keys)
    found = run(cell, "skid")
    t = np.array([state.time_s for state in found.states]) - found.start_s
    told = np.array([state.frames["base"] for state in found.states])[:, [0, 1, 5]]
    true = np.array([truth.frames["base"] for truth in found.truths])[:, [0, 1, 5]]
    at = np.searchsorted(found.times, t).clip(max=len(true) - 1)
    true, told = true[at] - true[0], told - told[0]
    return Driven(t, *(np.column_stack((x[:, :2], np.unwrap(x[:, 2]))) for x in (true, told)))


def skid() -> Shown:
    """Show where a base on four wheels is, and where it is by eq. 3, with and without skidding."""
    printed, ours, felt = driven(rolls=True), driven(), driven(rolls=True, gyroscope=True)
    figure, axes = panels(1, 3, 2.9)
    for ax, found, colour, name in (
        (axes[0], printed, COLOURS[1], "eq. 3, as printed"),
        (axes[1], ours, COLOURS[0], "with slip factor and centre"),
    ):
        ax.plot(found.true[:, 0], found.true[:, 1], color="0.6", label="true")
        ax.plot(found.told[:, 0], found.told[:, 1], color=colour)
        axes[2].plot(found.t, found.off[:, 1], color=colour, label=name)
        ax.axis("equal")
        label(ax, "x [m]", "y [m]" if ax is axes[0] else "", name)
    axes[2].plot(felt.t, felt.off[:, 1], color=COLOURS[2], label="eq. 3 and a gyroscope")
    axes[0].legend()
    label(axes[2], "time [s]", "heading off [rad]")
    above(figure, axes[2])
    spot = (ours.t > SPOT_S[0]) & (ours.t < SPOT_S[1])
    turned, rolled = (abs(float(np.ptp(x[spot, 2]))) for x in (printed.true, printed.told))
    numbers = [
        at_least("heading off at the end, eq. 3", float(printed.off[-1, 1]), "0", 0.1, "rad"),
        at_most("with slip factor and centre", float(ours.off[-1, 1]), "0", 0.02, "rad"),
        at_most("eq. 3 and a gyroscope", float(felt.off[-1, 1]), "0", 0.02, "rad"),
        at_least("place off at the end, eq. 3", float(printed.off[-1, 0]), "0", 0.1, "m"),
        at_most("with slip factor and centre", float(ours.off[-1, 0]), "0", 0.06, "m"),
        recalled("turn by eq. 3 over the true one, on the spot", rolled / turned, "1", 1.62, 0.05),
    ]
    return Shown(numbers, svg(figure))


# --- Figures 6 and 7: cells that the arm's lines forbid, and the printed order --------------------


def _grid(ax: Axes, cells: Flags, colour: str, strength: float) -> None:
    shown = np.where(cells, 1.0, np.nan)
    ax.grid(False)
    ax.imshow(
        shown, origin="lower", extent=(-1.0, 1.0, 0.0, 1.0), cmap=ListedColormap([colour]),
        alpha=strength, interpolation="nearest", aspect="equal", vmin=0.0, vmax=1.0,
    )  # fmt: skip


def printed_order(height_m: float, most: int) -> tuple[CriticalPoints, list[Array]]:
    """Return the postures (7,) that F1, F2, F3 lead to, one after the other, below a bridge."""
    with tempfile.TemporaryDirectory() as folder:
        found = search(Path(folder))
    obstacles, postures = bridge(height_m, 1.5), [START]
    for _ in range(most):
        answer = found.sequence(postures[-1], obstacles)
        if answer.q is None or answer.q is postures[-1]:
            break
        postures.append(answer.q)
    return found.points, postures


def bridge_cells(height_m: float) -> Flags:
    """Return the cells that the bridge of `lwa3.bridge` fills."""
    rows, columns = PLANE.shape
    z = np.arange(rows)[:, None] * 0.05 + 0.025
    off = np.abs(np.arange(columns)[None] * 0.05 + 0.025 - 1.0)
    beam = (z > height_m) & (z < height_m + 0.1) & (off < 0.8)
    pillar = (off > 0.7) & (off < 0.8) & (z < height_m + 0.1)
    found: Flags = beam | pillar
    return found


def order() -> Shown:
    """Show the forbidden cells, and the postures that the printed order leads to."""
    critical, postures = printed_order(HEIGHT_M, 6)
    occupied = bridge_cells(HEIGHT_M)
    figure, axes = panels(1, len(postures), 2.0, sharey=True)
    counts, heights, wrong = [], [], 0
    for ax, q, name in zip(axes, postures, ("posture of eq. 15", "then", "then"), strict=False):
        shoulder, elbow, *_, tool = critical.of(q[None])[0]
        _grid(ax, occupied, "#9aa4ae", 1.0)
        count = 0
        for (a, b), colour in zip(
            ((shoulder, tool), (shoulder, elbow), (elbow, tool)), COLOURS, strict=False
        ):
            area = crossed(a[1:], b[1:], PLANE)
            wrong += int(np.count_nonzero(area != touched(a[1:], b[1:])))
            count += int(np.count_nonzero(area & occupied))
            _grid(ax, area, colour, 0.5)
        line = np.array([shoulder, elbow, tool])[:, 1:]
        ax.plot(*line.T, color="black", marker="o", ms=3, lw=1.2)
        counts.append(count)
        heights.append((elbow[2], tool[2]))
        label(ax, "y [m]", "z [m]" if ax is axes[0] else "", name)
    for name, colour in zip(("F₁", "F₂", "F₃"), COLOURS, strict=False):
        axes[0].plot([], [], "s", color=colour, alpha=0.5, label=name)
    above(figure, axes[0])
    higher = critical.of(np.array(printed_order(HIGHER_M, 6)[1]))
    still = bridge_cells(HIGHER_M)
    left = sum(
        int(np.count_nonzero(crossed(a[1:], b[1:], PLANE) & still))
        for a, b in itertools.combinations(higher[-1][[0, 1, -1]], 2)
    )
    first, last = (critical.of(postures[k][None])[0] for k in (0, -1))
    cells = [cell_of(PLANE, x[1], x[2]) for x in (first[0], first[1], first[-1])]
    numbers = [
        at_most("cells of F₁ to F₃ unlike a grid ten times as fine", wrong, "0", 0),
        *(
            near(f"row of the {name}, posture of eq. 15", cells[k][0] + 1, row, 0)
            for k, (name, row) in enumerate((("shoulder", 7), ("elbow", 11), ("tool", 18)))
        ),
        at_least("cells of E that interfere, posture of eq. 15", counts[0], "≠ 0", 1),
        at_most("cells of E that interfere at the end", counts[-1], "0", 0),
        recalled("tool at first", heights[0][1], "above the bridge", 0.882, 2e-3, "m"),
        at_most("tool after the first step", heights[1][1], "below the bridge", HEIGHT_M, "m"),
        at_least("elbow after the first step", heights[1][0], "later than the tool", HEIGHT_M, "m"),
        at_most("elbow at the end", float(last[1, 2]), "below the bridge", HEIGHT_M, "m"),
        at_most("steps until nothing interferes, bridge at 0.65 m", len(higher) - 1, "not told", 3),
        at_most("cells of E that interfere at the end, bridge at 0.65 m", left, "not told", 0),
        at_most(
            "way of the tool while the elbow turns, bridge at 0.65 m",
            round(float(np.linalg.norm(higher[2, -1] - higher[1, -1])), 9), "not told", 1e-3, "m",
        ),
    ]  # fmt: skip
    return Shown(numbers, svg(figure))


# --- Figures 8 to 11: the scanner, and an arm in its view -----------------------------------------


def contour() -> Shown:
    """Show what the scanner makes of a bridge that the arm hides in part."""
    made = RigBridgeSection(height=0.95, width=1.4, distance=1.0 + FOOT[0])
    rover = Rover(made, start=(0.0, 0.9, 0.0, 1.2, 0.0, 0.0, 0.0), sweep=(-1.3, 0.5))
    q, rays = rover.q.copy(), []
    for _ in range(410):
        before = rover.newest
        rover.step()
        rover.q[2:-1] = q[2:-1]  # it stays where it is, whatever would fit
        looked = rover.newest
        if looked is not None and looked is not before:
            angle = looked.scan.first_rad + looked.scan.step_rad * np.arange(len(looked.own))
            hits = np.abs(looked.points[:, 0] - made.distance) < 0.15
            hits &= looked.points[:, 2] > FOOT[1]
            rays.append(np.stack((angle, np.full_like(angle, rover.q[-1]), hits, looked.own)))
    share, false = found_and_false(rover, made)
    angle, tilt, hits, own = np.concatenate(rays, axis=1)
    assert rover.newest is not None
    assert rover.newest.contour is not None
    figure, (left, right) = panels(1, 2, 2.6)
    for chosen, colour, name in (
        (hits > 0.0, COLOURS[0], "rays on the bridge"),
        (own > 0.0, COLOURS[1], "rays on the arm, dropped"),
    ):
        some = np.flatnonzero(chosen)[:: max(1, int(chosen.sum()) // 700)]
        left.plot(
            np.degrees(angle[some]), np.degrees(tilt[some]), ".", color=colour, ms=2, label=name
        )
    _grid(right, filled(made) > 0.0, "#c3cad1", 1.0)
    i, j = np.nonzero(~np.isnan(rover.newest.contour.nearest))
    right.plot(0.05 * j - 0.975, 0.05 * i + 0.025, "s", color=COLOURS[0], ms=2.2)
    label(left, "ray [°]", "tilt, up is less [°]", "figure 9: raw rays")
    label(right, "y [m]", "z [m]", "figure 11: contour")
    left.set(xlim=(30.0, 150.0))
    left.invert_yaxis()
    above(figure, left)
    return Shown(
        [
            at_least("share of the bridge's cells that are found", share, "“original look”", 0.95),
            at_most("cells found where nothing is", false, "0", 0),
            at_least("rays that hit the arm and are dropped", int(own.sum()), "“a lot”", 1000),
        ],
        svg(figure),
    )  # fmt: skip


# --- Figures 12 to 15: the bridge is passed -------------------------------------------------------


def passage() -> Shown:
    """Show heights, ways and distances of the arm under the bridge."""
    cell = load_cell(SCANNING)
    section, rig = cell.config.contour, cell.config.rig
    assert section is not None
    assert rig is not None
    assert rig.bridge is not None
    under, beyond = rig.bridge.height, rig.bridge.distance
    found, off = run(cell, "bridge"), run(cell, "bridge_off")
    critical = CriticalPoints(cell, section.shoulder, section.elbow, section.foot)
    q = np.array([truth.q for truth in found.truths])
    points = critical.of(q[:, critical.arm])
    x = np.array([truth.frames["base"][0] for truth in found.truths])
    elbow, tool = points[:, 1] + section.foot, points[:, -1] + section.foot
    figure, (left, middle, right) = panels(1, 3, 2.9)
    for place, colour, name in ((tool, COLOURS[0], "tool"), (elbow, COLOURS[1], "elbow")):
        left.plot(found.times, place[:, 2], color=colour, label=name)
        middle.plot(x + place[:, 0], place[:, 2], color=colour)
    left.axhline(under, **BOUND, label="underside of the bridge")
    middle.fill_between(
        (beyond, beyond + rig.bridge.thickness), under, under + rig.bridge.side, color="#9aa4ae"
    )
    label(left, "time [s]", "height [m]", "figure 13")
    label(middle, "x [m]", "height [m]", "figure 14, from the side")
    for ran, colour, name in ((found, COLOURS[2], "telerobot"), (off, "0.65", "without")):
        gaps = [1.0 if t.clearance_m is None else t.clearance_m for t in ran.truths]
        right.plot(ran.times, gaps, color=colour, label=name)
    label(right, "time [s]", "distance [m]", "figure 15, housings")
    right.set_ylim(bottom=0.0)
    right.legend()
    above(figure, left)
    gap, hit = found.summary["min_clearance_m"], off.summary["min_clearance_m"]
    within = np.abs(x + tool[:, 0] - beyond) < 0.05
    return Shown(
        [
            at_least("least distance of the housings", gap, "> 0", 0.02, "m"),
            at_most("least distance without avoidance", hit, "collides", 0.0, "m"),
            at_least("tool at first", float(tool[0, 2]), "above the bridge", under, "m"),
            at_most("tool under the bridge", float(tool[within, 2].max()), "below it", under, "m"),
            at_least("way of the base", float(x[-1]), "passes", 4.9, "m"),
        ],
        svg(figure),
    )  # fmt: skip


ZHANG = Paper(
    "Online Sensor Information and Redundancy Resolution Based Obstacle Avoidance for High DOF "
    "Mobile Manipulator Teleoperation",
    "Zhang, Jia, Guo, Qian, Song and Xi, International Journal of Advanced Robotic Systems, 2013",
    {
        "kinematics": Exhibit(
            "Eqs. 1–8",
            "Base and arm as one mechanism",
            "A Jacobian J_n of 6 × 9, and η_d = J_n⁺ (ξ̇_d − K ξ_err) + (I − J_n⁺ J_n) α η_s.",
            "With ξ_err = ξ_d − ξ, as in Fig. 3, the sign of K ξ_err is wrong: it has to be added. "
            "As printed, the error grows as exp(K t).",
            "The tool's error by the server's resolution, from 0.30 m and 0.30 rad, K = 1 /s.",
            'make papers ARGS="--only kinematics"',
            kinematics,
        ),
        "eta_s": Exhibit(
            "Eq. 7",
            "η_s of the whole robot",
            "η_s is an arbitrary vector of nine entries for the secondary task, and does not "
            "affect the control of the end-effector at all.",
            "No η_s is printed, and no result of one. J_n⁺ of eq. 7 adds m/s and rad/s, so that "
            "base and arm share the work by the choice of units: the server weighs the base "
            "(`base.weight`). With eq. 3's v and ω in place of wheels √det(JₙJₙᵀ) is another "
            "number with another slope, too; ours is per radian of a wheel.",
            "An arm that has reached out, its tool held in World from 0 s on, on a base that takes "
            "part in climbing √det(JₙJₙᵀ) (`base.objectives`), and on one that does not; in the "
            "physics.",
            'make papers ARGS="--only eta_s"',
            eta_s,
        ),
        "skid": Exhibit(
            "Section 2.1, eq. 3",
            "Four driven wheels that skid",
            "A base with four driven wheels, which is taken to roll without slipping: its rates "
            "are v and ω.",
            "Wheels on two axles have to skid where the base turns, so that eq. 3 does not hold "
            "for the printed robot. The base turns as if its track were wider, with even loads by "
            "1 + (L / b)² = 1.64 for our axles L = 0.4 m apart on a track of b = 0.5 m, and about "
            "a point towards the heavier end. Both are measured, 1.62 and 0.1 m ahead, and keys of "
            "the cell.",
            "An arc, a turn on the spot and a way ahead, in the physics: truly, and by odometry.",
            'make papers ARGS="--only skid"; telerobot simulate rover_skid skid',
            skid,
        ),
        "order": Exhibit(
            "Figs. 6 and 7, eqs. 12 and 13",
            "Forbidden cells, and F₁, F₂, F₃",
            "The lines shoulder–tool, shoulder–elbow and elbow–tool, in 20 × 40 cells of 50 mm, "
            "with their neighbours; F₁ moves the tool to the nearest safe cell, F₂ the elbow, F₃ "
            "brings the tool onto the line of the other two.",
            "The arm's lengths are not printed: ours are those of its data sheet, and the rows are "
            "those of an independent grid. How the elbow moves is left to another paper: the "
            "server turns it on its circle about the line of F₁, so that the tool stands. Where it "
            "took any posture of a grid, F₂ undid F₁ below a bridge of 0.65 m, and so on for ever. "
            "F₃ has to ask that its line be free, too. What still comes back to a posture is "
            "refused by name (`sequence_stuck`); by default the server searches whole postures "
            "instead. One neighbouring cell is too thin for a true housing: the server's reach is "
            "the link's radius and a margin.",
            "The arm from ahead, before and after each step; a bridge of 0.60 m above its foot.",
            'make papers ARGS="--only order"',
            order,
        ),
        "contour": Exhibit(
            "Figs. 8–11, eqs. 9–11",
            "A bridge seen past the arm",
            "Rays that hit the arm are deleted and replaced by a linear fit; the contour is that "
            "of the bridge.",
            "0 stands for *nothing* in eq. 11, and for an obstacle at the shoulder's plane: the "
            "server keeps a mask. The arm of eq. 14 is not in the view of our scanner; ours stands "
            "at q = [0, 0.9, 0, 1.2, 0, 0, 0] instead.",
            "Left: rays by their angle in the scan and the tilt. Right: cells found after two "
            "sweeps, over those that the true bridge fills.",
            'make papers ARGS="--only contour"',
            contour,
        ),
        "passage": Exhibit(
            "Figs. 12–15",
            "The bridge is passed",
            "From q = [0, −π/4, 0, π/2, 0, 0, 0] the tool moves down first, then the elbow is "
            "turned; the smallest distance stays above 0.",
            "The bridge is drawn without numbers: ours has its underside at 0.95 m, below tool and "
            "elbow. What the base does meanwhile is not told: ours waits until the arm is "
            "folded, which goes to a whole posture at once, not in the printed order. "
            "Distances are of the housings, not of points.",
            "The whole loop: every ray cast, drives, wheels and physics, base at 0.1 m/s.",
            'make papers ARGS="--only passage"; telerobot simulate rover_bridge bridge; '
            "telerobot simulate rover_bridge bridge_off",
            passage,
        ),
    },
)
