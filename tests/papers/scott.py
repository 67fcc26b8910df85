"""Scott & Carignan 2008: charged links, line obstacles, a camera's line of sight."""

from decimal import Decimal, localcontext
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from telerobot.config.load import altered, load_cell
from telerobot.server.control.arm import Arm
from telerobot.server.control.axes import HeldAxes, holding
from telerobot.server.control.inputs import ObjectiveGains, SelfMotionRequest
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.mechanism.potentials import by_charge, direction
from telerobot.server.control.mechanism.redundancy import Field
from telerobot.server.control.mechanism.self_motion import IDLE
from telerobot.server.control.parameters import Parameters
from telerobot.server.control.spatial import Array, Motion, Pose, rotation_exp
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap
from telerobot.tools.scripts.script import Script

from . import planar
from .around import acting, lines
from .exhibit import Exhibit, Paper, Shown, at_least, at_most, near, recalled
from .runs import run
from .search import Place, search
from .style import BODY, BOUND, COLOURS, PRINTED, above, label, panels, svg

TABLE: Final = {
    "obstacles": (-0.9161, -0.2268, -0.2858),
    "joint limits": (0.0, -0.0250, 0.0250),
    "singularities": (0.0, 0.0, 0.0),
    "total": (-0.9161, -0.2518, -0.2608),
}
"""Table II [N·m]."""
DIGITS: Final = 5.1e-5
"""Half of the last digit of Table II, and what the cell's least distance of 1 mm changes [N·m]."""
PLANAR, PARTS_OF_V = "planar3", ("obstacles", "joint_limits", "manipulability")
"""The cell of the planar arm, and its potentials in the order of the table."""
CLEAR_M: Final = 0.05
"""Of each link from the line of sight: section V [m]."""
PARTS: Final = {"upper arm": ("link2", "link3"), "forearm": ("link4", "link5")}
"""Links of our arm of eight joints."""
MINIMUM: Final = (-0.3732, 0.7572, 1.0446)
"""Where the search of figure 4 ends [rad]."""
LENGTH, AHEAD = 0.7, -0.4
"""Length of a link, and a of Table I, of a charge beside the link's prolongation [m]."""


# --- Figures 2 and 3: a charge beside a link ------------------------------------------------------


def printed_charge(a: Any, b: Any, c: Any) -> tuple[Any, Any, Any]:
    """Return F_x, F_y and M about P2 by eqs. 12–14 for a strength of 1; floats or decimals."""
    ra, rb = (a * a + c * c) ** half(a), (b * b + c * c) ** half(b)
    F_x = 1 / ra - 1 / rb
    F_y = -a / (c * ra) - b / (c * rb)
    return F_x, F_y, (a * b - c * c) / (c * ra) - (-b * b - c * c) / (c * rb)


def half(of: Any) -> Any:
    """Return 1/2 in the arithmetic of a number."""
    return type(of)("0.5") if isinstance(of, Decimal) else 0.5


def exact_charge(a: float, b: float, c: float) -> Array:
    """Return the same with fifty digits, rounded at the end (3,)."""
    with localcontext() as context:
        context.prec = 50
        return np.array([float(x) for x in printed_charge(Decimal(a), Decimal(b), Decimal(c))])


def our_charge(a: float, b: float, c: float) -> Array:
    """Return the same (3,) by the server, in the frame of figure 3: P2 at its origin."""
    first, last = (-a - b, 0.0, 0.0), (0.0, 0.0, 0.0)
    u, length = direction(first, last)
    force, lever, _ = by_charge(first, u, length, (-b, c, 0.0), 0.0)
    # The moment is told about the link's first end.
    moment = np.cross(u, lever) + np.cross(first, force)
    return np.array([force[0], force[1], moment[2]])


def charge() -> Shown:
    """Show force and moment of a charge on a link, and the digits that the printed forms lose."""
    figure, (left, right) = panels(1, 2, 3.0)
    along, c = np.linspace(-0.5, 1.5, 81), 0.25
    ours = np.array([our_charge(s, 1.0 - s, c) for s in along])
    printed = np.array([printed_charge(s, 1.0 - s, c) for s in along[::4]])
    for i, name in enumerate(("F_x [N]", "F_y [N]", "M about P₂ [N·m]")):
        left.plot(along, ours[:, i], color=COLOURS[i], label=name)
        left.plot(along[::4], printed[:, i], **PRINTED, label="eqs. 12–14" if i == 2 else None)
    label(
        left, "a: charge along the link [m]", "force [N], moment [N·m]", "link of 1 m, c = 0.25 m"
    )
    above(figure, left)
    distances = np.logspace(-9.0, 0.0, 46)
    lost, kept = [], []
    for d in distances:
        true = exact_charge(AHEAD, LENGTH - AHEAD, float(d))
        size = np.abs(true)
        lost.append(np.abs(printed_charge(AHEAD, LENGTH - AHEAD, float(d)) - true) / size)
        kept.append(np.abs(our_charge(AHEAD, LENGTH - AHEAD, float(d)) - true) / size)
    worst, best = np.max(lost, axis=1), np.max(kept, axis=1)
    right.loglog(distances, np.maximum(best, 1e-17), color=COLOURS[0], label="telerobot")
    right.loglog(distances, np.maximum(worst, 1e-17), **PRINTED, label="eqs. 12–14, in doubles")
    label(right, "c [m]", "relative error [1]", "0.4 m beyond the end of a link of 0.7 m")
    right.legend(loc="center left")
    beyond = AHEAD, LENGTH - AHEAD, 1e-9
    near_ = our_charge(*beyond)[1]
    return Shown(
        [
            at_most(
                "printed forms and ours at c = 0.25 m, farthest",
                float(np.abs(ours[::4] - printed).max()), "0", 1e-12, "N, N·m",
            ),
            at_most("our greatest relative error, c from 1 nm to 1 m", best.max(), "0", 1e-12),
            near("F_y at c = 1 nm", near_, exact_charge(*beyond)[1], 1e-18, "N"),
            at_least("relative error of eq. 13 in doubles at c = 1 nm", float(worst[0]), "0", 1.0),
        ],
        svg(figure),
    )  # fmt: skip


# --- Table II and figure 4: the planar arm --------------------------------------------------------


def slopes(part: str) -> Array:
    """Return −∂V/∂q (3,) at the start, of one of the cell's potentials alone [N·m]."""
    others = {f"potential.{name}": 0.0 for name in PARTS_OF_V if name != part}
    cell = altered(load_cell(PLANAR), others)
    p, mechanism = Parameters.from_cell(cell), Mechanism.from_cell(cell)
    k = mechanism.kinematics(planar.START, Pose.identity())
    # The task is the tool's place: in the plane, two rows.
    holds = holding(("rz",))
    assert holds is not None
    held = HeldAxes.of(holds, k.T_world_mrf.R, (2, 2))
    field = Field(p.joints, p.potential, p.capsules, mechanism.rank)
    scene = ObstacleMap.from_cell(cell, Events()).scene(0)
    gains = ObjectiveGains({"field": 1.0}, planar.START)
    seen = field.look(planar.START, k, scene, gains, held=held)
    assert seen is not None
    return seen.value.torque


def table_2() -> Shown:
    """Show the torques of Table II."""
    parts = [slopes(part) for part in PARTS_OF_V]
    ours = dict(zip(TABLE, (*parts, np.sum(parts, axis=0)), strict=True))
    figure, axes = panels(1, 4, 2.6, sharey=True)
    for ax, (source, torques) in zip(axes, ours.items(), strict=True):
        ax.bar((1, 2, 3), torques, 0.55, color=COLOURS[0], label="telerobot")
        ax.plot((1, 2, 3), TABLE[source], **PRINTED, label="Table II")
        label(ax, "joint [1]", "" if ax is not axes[0] else "torque [N·m]", source)
        ax.set_xticks((1, 2, 3))
    above(figure, axes[0])
    return Shown(
        [
            near(f"{source}, τ{'₁₂₃'[i]}", float(torques[i]), TABLE[source][i], DIGITS, "N·m")
            for source, torques in ours.items()
            for i in range(3)
        ],
        svg(figure),
    )


def by_elbow(phi: Array) -> list[Array]:
    """Return postures (3,) with the tool of figure 4, by the direction of link 3 [rad]."""
    tip, found = planar.joints(planar.START)[:2, -1], []
    for angle in phi:
        wrist = tip - np.array([np.cos(angle), np.sin(angle)])
        elbow = np.arccos(0.5 * (wrist @ wrist) - 1.0)
        shoulder = np.arctan2(wrist[1], wrist[0]) - 0.5 * elbow
        found.append(np.array([shoulder, elbow, angle - shoulder - elbow]))
    return found


def printed_search() -> tuple[Array, int]:
    """Iterate eq. 5 as it is printed, until |Δq| is below 0.001; return the posture, and steps."""
    q, steps = planar.START, 0
    while np.linalg.norm(step := planar.projected(q)) >= 1e-3:
        q, steps = q + step, steps + 1
    return q, steps


def _arm(ax: Axes, q: Array, **style: Any) -> None:
    ax.plot(*planar.joints(q)[:2], **style)


def minimum() -> Shown:
    """Show that the minimum of figure 4 is none, and where the minimum is."""
    found = search(planar.START, planar.look, planar.LOWER, planar.UPPER, 1e-8)
    ended, steps = printed_search()
    tip = planar.joints(planar.START)[:, -1]
    drift = float(np.linalg.norm(planar.joints(ended)[:, -1] - tip))
    slope = float(np.linalg.norm(planar.projected(planar.PRINTED_MINIMUM)))
    there = planar.look(planar.PRINTED_MINIMUM).potential
    joints = [
        recalled(f"our minimum, {name}", float(q), f"{printed:g}", kept, 1e-4, "rad")
        for name, q, printed, kept in zip(
            ("q₁", "q₂", "q₃"), found.q, planar.PRINTED_MINIMUM, MINIMUM, strict=True
        )
    ]
    ran = run(PLANAR, "figure_4")
    q = np.array([truth.q for truth in ran.truths])
    off = np.array([truth.pose_mrf[:3] for truth in ran.truths]) - ran.truths[0].pose_mrf[:3]
    q1, q2, q3 = planar.PRINTED_MINIMUM
    mirrored = float(np.linalg.norm(planar.projected(np.array([q1, q2 + q3, -q3]))))
    ended_off = float(np.abs(q[-1] - found.q).max())
    moved = float(np.linalg.norm(off, axis=1).max())
    figure, (left, right) = panels(1, 2, 3.2)
    _arm(left, planar.START, color="0.65", marker="o", ms=3, label="start")
    _arm(left, planar.PRINTED_MINIMUM, **PRINTED | {"ls": "--", "lw": 0.9}, label="printed minimum")
    _arm(left, q[-1], color=COLOURS[0], marker="o", ms=3, label="telerobot")
    left.plot(*planar.OBSTACLE[:2], "*", color=COLOURS[1], ms=9, label="obstacle")
    label(left, "x [m]", "y [m]", "figure 4")
    left.axis("equal")
    left.legend(loc="upper left")
    phi = np.linspace(-0.3, 1.55, 75)
    right.plot(phi, [planar.look(q).potential for q in by_elbow(phi)], color=COLOURS[0])
    way = q[:: len(q) // 40]
    right.plot(way.sum(axis=1), [planar.look(x).potential for x in way], ".", color=COLOURS[2])
    for x, style in (
        (planar.START, {"marker": "o", "color": "0.65"}),
        (planar.PRINTED_MINIMUM, PRINTED | {"ms": 6}),
        (found.q, {"marker": "o", "color": COLOURS[0]}),
    ):
        right.plot(x.sum(), planar.look(x).potential, **style)
    label(right, "direction of link 3 [rad]", "V [N·m]", "potential, the tool held")
    return Shown(
        [
            at_least("|Pτ| at the printed minimum", slope, "< 0.001", 0.1, "N·m"),
            *joints,
            at_most("run in the physics, off that minimum", ended_off, "–", 5e-4, "rad"),
            at_most("run in the physics, tool moved", moved, "maintained", 3e-3, "m"),
            at_most("|Pτ| with links 2 and 3 exchanged", mirrored, "–", 0.005, "N·m"),
            at_most("|Pτ| at our minimum", found.slope, "< 0.001", 1e-8, "N·m"),
            recalled("V at our minimum", found.potential, "–", -0.010946, 1e-6, "N·m"),
            recalled("V at the printed minimum", there, "–", 0.16968, 1e-5, "N·m"),
            recalled("steps of eq. 5 until |Δq| < 0.001", steps, "–", 79, 0),
            recalled("by then the tool has drifted", drift, "–", 0.0727, 1e-3, "m"),
        ],
        svg(figure),
    )  # fmt: skip


# --- Equations 3 to 7: a search in each period, against the flow down the slope -------------------

CENTRE: Final = np.array([1.85, 1.0])
CIRCLE_M, CORNERS, ROUNDS = 0.15, 24, 2
"""The tool's circle, beside the obstacle of Table II, as a path of so many blended corners."""
BEGINS_S, ENDS_S = 8.0, 36.0
"""The arm has slid to its first minimum by then; and has gone round twice by then [s]."""
DIRECTIONS: Final = np.linspace(0.3, 2.0 * np.pi - 0.3, 90)
"""Of the tool from the circle's centre, where postures of the last round are compared [rad]."""


def circled(steps: int, sense: float) -> Array:
    """Return joints (90, 3) where the tool is at `DIRECTIONS`, in the last round of one sense."""
    turns = sense * 2.0 * np.pi * np.arange(1, ROUNDS * CORNERS + 1) / CORNERS
    corners = CENTRE + CIRCLE_M * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    target: dict[str, Any] = {"xyz": [2.0, 1.0, 0.5], "rpy": [0.0] * 3, "relative_to": "world"}
    path: dict[str, Any] = {
        "waypoints": [[x, y, 0.5, 0.0, 0.0, 0.0] for x, y in corners.tolist()],
        "speeds": [0.1] * len(corners),
        "blend": 0.01,
        "relative_to": "world",
    }
    told: list[dict[str, Any]] = [
        {"at_s": 0.2, "cmd/position": target},
        {"at_s": BEGINS_S, "cmd/path": path},
    ]
    found = run(
        altered(load_cell(PLANAR), {"potential.search": steps}),
        Script.model_validate({"duration_s": ENDS_S, "step": told}),
    )
    q = np.array([truth.q for truth in found.truths])
    off = np.array([truth.pose_mrf[:2] for truth in found.truths]) - CENTRE
    gone = sense * np.unwrap(np.arctan2(off[:, 1], off[:, 0]))
    # One that goes round to the right is at a direction a when it has gone by 2π − a.
    wanted = 2.0 * np.pi * (ROUNDS - 1) + (DIRECTIONS if sense > 0.0 else 2.0 * np.pi - DIRECTIONS)
    if gone[-1] < wanted.max():
        raise ValueError(f"the tool has gone round by {gone[-1]:.2f} rad only")
    return np.stack([np.interp(wanted, gone, q[:, j]) for j in range(3)], axis=1)


def least_of(q: Array) -> Array:
    """Return the posture (3,) of least potential that has the tool of q (3,), by the search."""
    tip = planar.joints(q)[:2, -1]

    def look(at: Array) -> Place:
        return planar.look(at)._replace(error=tip - planar.joints(at)[:2, -1])

    return search(q, look, planar.LOWER, planar.UPPER, 1e-7).q


def circle() -> Shown:
    """Show where joints are when the tool comes the one way and the other."""
    figure, (left, right) = panels(1, 2, 3.0)
    apart, behind = [], []
    for k, (steps, name) in enumerate(((0, "flow down the slope"), (2, "search"))):
        there, back = (circled(steps, sense) for sense in (1.0, -1.0))
        least = np.array([least_of(q) for q in there[::5]])
        apart.append(np.abs(there - back).max(axis=1))
        behind.append(float(np.abs(there[::5] - least).max()))
        left.plot(DIRECTIONS, there.sum(axis=1), color=COLOURS[k], label=name)
        left.plot(DIRECTIONS, back.sum(axis=1), color=COLOURS[k], ls=":")
        right.semilogy(DIRECTIONS, apart[-1], color=COLOURS[k])
    left.plot(DIRECTIONS[::5], least.sum(axis=1), **PRINTED, label="least potential")
    label(left, "tool from the circle's centre [rad]", "direction of link 3 [rad]")
    label(right, "tool from the circle's centre [rad]", "joints of both senses apart [rad]")
    above(figure, left)
    return Shown(
        [
            at_most("search: joints of both senses apart", float(apart[1].max()), "0", 2e-3, "rad"),
            at_most("search: joints from those of least potential", behind[1], "0", 2e-3, "rad"),
            recalled(
                "flow: joints of both senses apart", float(apart[0].max()), "not told", 0.02, 0.01,
                "rad",
            ),
            recalled(
                "flow: joints from those of least potential", behind[0], "not told", 0.01, 0.005,
                "rad",
            ),
        ],
        svg(figure),
    )  # fmt: skip


# --- Figure 5 and section VI: lines ---------------------------------------------------------------


def line() -> Shown:
    """Show the moment on a link that turns through parallel to a line."""
    scene = lines([-0.4, 0.0, 0.3], [0.4, 0.0, 0.3])

    def moment(angle: float, smooth: bool) -> float:
        along = np.array([np.cos(angle), 0.0, np.sin(angle)])
        return float(acting(scene, -0.5 * along, 0.5 * along, 0.0, smooth)[1][1])

    figure, (ax,) = panels(1, 1, 2.8)
    angles = np.linspace(-0.3, 0.3, 120)
    ax.plot(angles, [moment(a, True) for a in angles], color=COLOURS[0], label="charged line")
    for side in (angles < 0.0, angles > 0.0):
        ax.plot(
            angles[side], [moment(a, False) for a in angles[side]],
            color=COLOURS[1], label="closest point, as printed" if side[0] else None,
        )  # fmt: skip
    label(ax, "angle of the link to the line [rad]", "moment at k = 1 [N·m]")
    ax.legend()
    near_ = 1e-5
    jump = 0.1 * abs(moment(near_, False) - moment(-near_, False))
    smooth = 0.1 * abs(moment(near_, True) - moment(-near_, True))
    return Shown(
        [
            recalled(
                "jump of the closest point's moment within 20 µrad, k = 0.1",
                jump, "“discontinuous jump”", 0.2108, 1e-4, "N·m",
            ),
            at_most("change of the charged line's moment there", smooth, "–", 1e-5, "N·m"),
        ],
        svg(figure),
    )  # fmt: skip


# --- Figures 8 to 10: an arm of eight joints, and a camera ----------------------------------------


def sight_line() -> Shown:
    """Show the distances from the line of sight while the tool goes over it, and down."""
    figure, axes = panels(1, 2, 3.0, sharey=True)
    least = []
    for ax, name, title in zip(
        axes, ("sight_line_on", "sight_line_off"), ("with the field", "without"), strict=True
    ):
        found = run("ranger", name)
        rows = [truth.sight["head"] for truth in found.truths]
        for (part, links), colour in zip(PARTS.items(), COLOURS, strict=False):
            far = [100.0 * min(row[link] for link in links) for row in rows]
            ax.plot(found.times, far, color=colour, label=part)
        ax.axhline(100.0 * CLEAR_M, **BOUND, label="5 cm, as printed")
        ax.axhspan(-5.0, 0.0, color=BODY)
        label(ax, "time [s]", "distance [cm]" if ax is axes[0] else "", title)
        ax.set_ylim(-5.0, 30.0)
        least.append(min(min(row.values()) for row in rows))
    above(figure, axes[0])
    on, off = least
    return Shown(
        [
            at_least("least distance of a link's housing", on, "≥ 5 cm", CLEAR_M, "m"),
            at_most("the same motion without the field", off, "occluded", 0.0, "m"),
        ],
        svg(figure),
    )  # fmt: skip


# --- Figure 6: the shoulder–elbow–wrist angle -----------------------------------------------------

UPPER, FORE = 0.45, 0.5
"""Upper arm and forearm of the PA-10 [m]."""
ELBOW_UP: Final = (0.0, 0.6, 0.0, 1.3, 0.0, 0.9, 0.0)
"""A posture with the elbow up, φ = 0 [rad]."""
TURNS, STEP = 120, 0.01
"""Steps of φ to either side, and their size [rad]."""


def about(axis: int, angle: float) -> Array:
    """Return the rotation (3, 3) by an angle about an axis."""
    return rotation_exp(angle * np.eye(3)[axis])


def elbow_and_wrist(q: Array) -> tuple[Array, Array]:
    """Return elbow and wrist of the PA-10 seen from its shoulder, by its axes Z Y Z Y alone."""
    R = about(2, q[0]) @ about(1, q[1]) @ about(2, q[2])
    E = UPPER * R[:, 2]
    return E, E + FORE * (R @ about(1, q[3]))[:, 2]


def turned_elbows(sign: float) -> tuple[Array, Array, float]:
    """Return postures (m, 7) along the server's self-motion, the angles that it tells (m,).

    And the greatest error of their change per turn against differences.
    """
    arm, rate = Arm.of(load_cell("pa10")), 0.01 * sign
    mechanism, mrf = arm.mechanism, arm.p.T_wrist_tool
    reader = mechanism.arm_angle
    assert reader is not None
    before = IDLE._replace(motion=Motion(np.zeros(1), np.array([rate]), np.zeros(1)))

    def way(q: Array) -> Array:
        """Return the joints' motion for a radian."""
        k = mechanism.kinematics(q, mrf)
        null = np.linalg.svd(k.J)[2][6:]
        asked = SelfMotionRequest(rate)
        return arm.body.by_hand.step(k, null, asked, before, np.zeros(7), 1.0, 1.0).dq / rate

    q, postures, angles, worst = np.array(ELBOW_UP), [], [], 0.0
    for _ in range(TURNS + 1):
        found = reader.look(mechanism.kinematics(q, mrf))
        postures.append(q)
        angles.append(found.angle)
        small = 1e-6 * way(q)
        ends = [reader.look(mechanism.kinematics(q + d * small, mrf)).angle for d in (1.0, -1.0)]
        worst = max(worst, abs((ends[0] - ends[1]) / 2e-6 - 1.0))
        # Runge–Kutta, fourth order.
        h = sign * STEP
        a = way(q)
        b = way(q + 0.5 * h * a)
        c = way(q + 0.5 * h * b)
        q = q + h / 6.0 * (a + 2.0 * b + 2.0 * c + way(q + h * c))
    return np.array(postures), np.array(angles), worst


def elbow() -> Shown:
    """Turn the elbow about the line from shoulder to wrist while the tool stays."""
    sides = [turned_elbows(sign) for sign in (-1.0, 1.0)]
    postures = np.vstack([sides[0][0][::-1], sides[1][0][1:]])
    angles = np.concatenate([sides[0][1][::-1], sides[1][1][1:]])
    points = [elbow_and_wrist(q) for q in postures]
    E, W = np.array([p[0] for p in points]), np.array([p[1] for p in points])
    reach = float(np.linalg.norm(W[TURNS]))
    w = W[TURNS] / reach
    # The elbow of φ = 0 by the law of cosines, turned about ŵ.
    lift = np.arccos((UPPER**2 + reach**2 - FORE**2) / (2.0 * UPPER * reach))
    up = UPPER * (about(1, float(np.arccos(w[2])) - float(lift)))[:, 2]
    circle = np.array([rotation_exp(angle * w) @ up for angle in angles])
    centre = w * float(w @ up)
    side = np.cross(w, up - centre)
    across = np.stack([side, up - centre]) / np.linalg.norm(up - centre)
    figure, (left, right) = panels(1, 2, 3.0)
    seen, own = (circle - centre) @ across.T, (E - centre) @ across.T
    left.plot(*own.T, color=COLOURS[0], label="elbow of the server's self-motion")
    left.plot(*seen[::20].T, **PRINTED, label="reference elbow turned by φ")
    left.plot(0.0, 0.0, "k+", ms=6)
    left.set_aspect("equal")
    label(left, "across the reference plane [m]", "up in it [m]", "Seen from the shoulder, along ŵ")
    turns = STEP * np.arange(-TURNS, TURNS + 1)
    right.plot(turns, angles, color=COLOURS[0])
    right.plot(turns[::20], turns[::20], **PRINTED)
    label(right, "turn that was asked for [rad]", "φ [rad]", "The angle that is told")
    above(figure, left)
    numbers = [
        at_most("elbow from the turned reference", float(np.abs(E - circle).max()), "0", 1e-8, "m"),
        at_most("wrist from where it was", float(np.abs(W - W[TURNS]).max()), "held", 1e-8, "m"),
        at_most("φ from the turn", float(np.abs(angles - turns).max()), "0", 1e-8, "rad"),
        at_most("dφ per turn from 1", max(s[2] for s in sides), "0", 1e-6),
    ]
    return Shown(numbers, svg(figure))


SCOTT = Paper(
    "A Line-Based Obstacle Avoidance Technique for Dexterous Manipulator Operations",
    "Scott and Carignan, IEEE International Conference on Robotics and Automation, 2008",
    {
        "charge": Exhibit(
            "Figs. 2 and 3, Table I, eqs. 12–14",
            "A charge beside a link",
            "Force and moment of a point charge on a charged link, by a, b and c of Table I.",
            "The formulas are right and lose their digits: beyond the end of a link the two terms "
            "of F_y and of M cancel as c goes to 0, and are divided by it. The server uses forms "
            "that keep them, k L (r̂₁ + r̂₂) / S.",
            "Left: the server's force and moment over the printed formulas. Right: the relative "
            "error of both against fifty digits; 10⁻¹⁷ stands for none.",
            'make papers ARGS="--only charge"',
            charge,
        ),
        "table_2": Exhibit(
            "Table II",
            "Torques on the planar arm",
            "Joint torques of obstacle, joint limits and singularities at q = [0, 1.57, −1.57], "
            "obstacle at (1.5, 1.3) m, links of 1 m, all strengths 0.1.",
            "The digits need q = [0, π/2, −π/2] exactly. Manipulability is stationary there, so "
            "the table says nothing of its potential.",
            "Torques of the cell `planar3` over the table.",
            'make papers ARGS="--only table_2"',
            table_2,
        ),
        "minimum": Exhibit(
            "Fig. 4, eq. 5",
            "The printed minimum is none",
            "The search from that posture ends at q = [−0.36, 1.79, −1.07], when |Δq| is below "
            "0.001.",
            "At the printed posture |Pτ| is 0.14 N·m, and so is the next step: the potential falls "
            "on, through the straight wrist, to another branch. Eq. 5 as printed passes there "
            "and stops beyond; it never returns to the tool's pose, which drifts by "
            "centimetres meanwhile. With links 2 and 3 exchanged, [−0.36, 0.72, 1.07], the tool is "
            "at the same place beside the true minimum: that may be what was meant. A small step "
            "says only that the gain is small: the search has "
            "to end on |Pτ|.",
            "Left: the arm; the run is in the physics, its task the tool's place. Right: the "
            "potential along the self-motion, with the run's postures as dots.",
            'make papers ARGS="--only minimum"; telerobot simulate planar3 figure_4',
            minimum,
        ),
        "circle": Exhibit(
            "Section II, eqs. 3–7",
            "Joints come back with the tool",
            "Each target is searched for the posture of least potential, so that a closed path of "
            "the tool closes in the joints (Wang's cyclic property).",
            "Eqs. 3 to 7 are iterated until they end, which takes as long as it takes: the server "
            "does at most `potential.search` steps in each period, of at most 0.2 rad each. "
            "Without, it goes down the slope where the arm is, which lags behind a least that "
            "moves.",
            "The planar arm of Table II draws a circle of 0.15 m in 12 s, once in each sense, in "
            "the physics. Left: its last link, in the other sense dotted. Right: the greatest "
            "difference of a joint.",
            'make papers ARGS="--only circle"',
            circle,
        ),
        "line": Exhibit(
            "Fig. 5, section VI",
            "A line beside a link",
            "A line of sight acts by its point closest to each link; the moment jumps where line "
            "and link are parallel.",
            "What is printed is a limitation, and true. The server integrates along the charged "
            "line, which is smooth there; the closest point can be chosen instead.",
            "Moment of a line of 0.8 m on a link of 1 m, 0.3 m away, that turns through parallel.",
            'make papers ARGS="--only line"',
            line,
        ),
        "elbow": Exhibit(
            "Fig. 6",
            "The shoulder–elbow–wrist angle",
            "The elbow orbits about the vector from shoulder to wrist while both stand; φ is the "
            "angle of the plane of the three points with a reference plane.",
            "The reference plane and the sign are left open: ours is the plane of that vector and "
            "the first axis, right-handed about the vector (Kreutz-Delgado, Long and Seraji 1992).",
            "A PA-10 whose tool stands, turned by 1.2 rad to either side by the server's "
            "self-motion; in black the elbow by the law of cosines, turned about the vector.",
            'make papers ARGS="--only elbow"',
            elbow,
        ),
        "sight_line": Exhibit(
            "Figs. 8–10",
            "The line of sight is kept",
            "An arm of eight joints moves its tool over the line of sight and down; every link "
            "keeps at least 5 cm from it.",
            "No lengths of the arm, and no numbers of the motion, are printed: ours are our own. "
            "The paper measures from the links' axes, we from their housings.",
            "True distances in the physics of two runs of the same motion.",
            'make papers ARGS="--only sight_line"; telerobot simulate ranger sight_line_on; '
            "telerobot simulate ranger sight_line_off",
            sight_line,
        ),
    },
)
