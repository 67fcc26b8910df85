"""Williams 1997: every input becomes a rate of the MRF, and all rates are added."""

from collections.abc import Callable
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from telerobot.config.load import Cell, altered, load_cell
from telerobot.protocols.topics import SWITCH
from telerobot.server.control.joint_task.load_shares import load_shares
from telerobot.server.control.spatial import (
    Array,
    Pose,
    pose_error,
    rotate_twist,
    rotation_exp,
    rotation_log,
    rotation_rpy,
    twist_at,
    wrench_to,
)
from telerobot.server.perception.cameras import board_of
from telerobot.server.perception.filters import pictured
from telerobot.tools.scripts.script import Script, load_script

from .exhibit import Exhibit, Number, Paper, Shown, at_least, at_most, near, recalled
from .runs import Run, run
from .style import BOUND, COLOURS, PRINTED, above, label, panels, svg

SOURCES: Final = ("joystick", "position", "vision", "force", "frames")
"""What the server adds up; `frames` is the motion of a CRF or Base that moves."""
WALLS: Final = (5_000.0, 10_000.0, 20_000.0)
"""Stiffness of the wall [N/m]."""
STICKS: Final = (0.004, 0.0075, 0.012)
"""K_HC u: what the stick asks for [m/s]."""
BASES: Final = np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]])
"""Two grasps, as seen from the MRF [m]."""
STARTS, TURNS, TURN_S = 200, 240, 0.05
"""Random attitudes, and steps of each of so long [1, 1, s]."""


# --- Equations 1 and 5: frames --------------------------------------------------------------------


def at_wrist(twist_mrf: Array, T_wrist_mrf: Pose) -> Array:
    """Return the Wrist's twist (6,) in its own axes, of the MRF's in its own: eq. 1."""
    return twist_at(rotate_twist(T_wrist_mrf.R, twist_mrf), -T_wrist_mrf.p)


def transforms() -> tuple[float, float]:
    """Return how far eq. 1 and 5 are off the printed matrices, and off one power."""
    draw, off, power = np.random.default_rng(1), 0.0, 0.0
    for _ in range(100):
        T = Pose(rotation_rpy(*draw.uniform(-3.0, 3.0, 3)), draw.uniform(-1.0, 1.0, 3))
        twist, wrench = draw.normal(size=(2, 6))
        p_hat = np.cross(T.p, np.eye(3)).T  # p_hat x = p × x
        rates = np.block([[T.R, p_hat @ T.R], [np.zeros((3, 3)), T.R]])
        forces = np.block([[T.R, np.zeros((3, 3))], [p_hat @ T.R, T.R]])
        off = max(off, float(np.abs(at_wrist(twist, T) - rates @ twist).max()))
        off = max(off, float(np.abs(wrench_to(T, wrench) - forces @ wrench).max()))
        there = wrench_to(T.inverse(), wrench)
        power = max(power, abs(float(there @ twist - wrench @ at_wrist(twist, T))))
    return off, power


def frames() -> Shown:
    """Show a run in which MRF and CRF are redefined on the way and in contact."""
    told = load_script("frames_here")
    keys = [None if step.message is None else step.message.topic.key for step in told.step]
    redefined = [s.at_s for s, key in zip(told.step, keys, strict=True) if key == "operator/frame"]
    found = run("pa10", told)
    t = np.array([state.time_s for state in found.states]) - found.start_s
    dq = np.array([state.dq_command for state in found.states])
    place = np.array([truth.pose_mrf[:3] for truth in found.truths])
    figure, (left, right) = panels(1, 2, 2.9)
    for i, axis in enumerate("xyz"):
        left.plot(found.times, 1e3 * (place[:, i] - place[0, i]), color=COLOURS[i], label=axis)
    for i in range(dq.shape[1]):
        right.plot(t, dq[:, i], color=COLOURS[i % 6], lw=0.9)
    for ax in (left, right):
        for at in redefined:
            ax.axvline(at, **BOUND | {"lw": 0.7}, label="redefined" if at == redefined[0] else None)
    label(left, "time [s]", "way of the tip [mm]")
    label(right, "time [s]", "joint rates [rad/s]")
    above(figure, left)
    off, power = transforms()
    pressed_n = float(np.mean([t.contact_force[0] for t in found.truths[-100:]]))
    steps = np.abs(np.diff(dq, axis=0)).max(axis=1)
    jump = max(float(steps[np.abs(t[1:] - at - 0.01) < 0.025].max()) for at in redefined)
    return Shown(
        [
            at_most("eqs. 1 and 5 off the printed matrices", off, "0", 1e-12),
            at_most("power at the MRF less power at the Wrist", power, "0", 1e-12, "W"),
            at_most(
                "change of a joint rate in a tick, redefined", jump, "none told", 0.03, "rad/s"
            ),
            near("force that is asked of the MRF at the end", pressed_n, 8.0, 0.3, "N"),
        ],
        svg(figure),
    )


# --- Equation 4: the attitude's error -------------------------------------------------------------


def euler_rates(R: Array, *, in_target: bool) -> Array:
    """Return the angular velocity (3,) of 3-2-1 angles of R (3, 3) that are their own rates.

    In the axes that R turns, as the MRF's are, or `in_target`: in those that it turns them to.
    """
    roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    pitch = -np.arcsin(np.clip(R[2, 0], -1.0, 1.0))
    about = rotation_rpy(0.0, 0.0, yaw)
    found = np.array([0.0, 0.0, yaw]) + about @ [0.0, pitch, 0.0]
    found += about @ rotation_rpy(0.0, pitch, 0.0) @ [roll, 0.0, 0.0]
    turned: Array = R.T @ found if in_target else found
    return turned


def rotation_vector(R: Array) -> Array:
    """Return the server's error of attitude (3,), in the axes of the MRF."""
    return pose_error(Pose(R, np.zeros(3)), Pose.identity())[3:]


def turned(law: Callable[[Array], Array], R: Array) -> Array:
    """Return the angle (steps,) from the target [rad] while the MRF turns by a law, at K = 1 /s."""
    angles = []
    for _ in range(TURNS):
        R = rotation_exp(-TURN_S * law(R)) @ R
        angles.append(float(np.linalg.norm(rotation_log(R))))
    return np.array(angles)


def attitude() -> Shown:
    """Show the error of attitude by the rotation vector and by 3-2-1 Euler rates."""
    draw, starts = np.random.default_rng(1), []
    for q in draw.normal(size=(STARTS, 4)):  # evenly distributed attitudes
        angle = 2.0 * np.arctan2(np.linalg.norm(q[1:]), abs(q[0]))
        starts.append(rotation_exp(angle * q[1:] / np.linalg.norm(q[1:])))
    laws: dict[str, Callable[[Array], Array]] = {
        "telerobot: rotation vector": rotation_vector,
        "3-2-1 rates, in MRF axes": partial(euler_rates, in_target=False),
        "3-2-1 rates, in target axes": partial(euler_rates, in_target=True),
    }
    figure, axes = panels(1, 3, 2.7, sharey=True)
    t, lost, grown = TURN_S * np.arange(1, TURNS + 1), [], []
    for ax, (name, law), colour in zip(axes, laws.items(), COLOURS, strict=False):
        rows = np.array([turned(law, R) for R in starts])
        lost.append(float((rows[:, -1] > 0.01).mean()))
        grown.append(float((np.diff(rows, axis=1).max(axis=1) > 1e-6).mean()))
        for row in rows[:24]:
            ax.plot(t[::6], row[::6], color=colour, lw=0.6)
        label(ax, "time [s]", "angle from the target [rad]" if ax is axes[0] else "", name)
    return Shown(
        [
            at_most("rotation vector: starts that do not arrive", lost[0], "0", 0.0),
            at_most("rotation vector: starts whose error grows meanwhile", grown[0], "0", 0.0),
            at_most("3-2-1 rates in MRF axes: do not arrive", lost[1], "0", 0.0),
            recalled("3-2-1 rates in MRF axes: grow meanwhile", grown[1], "not told", 0.085, 0.04),
            recalled("3-2-1 rates in target axes: do not arrive", lost[2], "0", 0.195, 0.06),
        ],
        svg(figure),
    )


def rate_sum() -> Shown:
    """Show all sources at once, and their sum."""
    found = run("pa10_all", "all_sources")
    t = np.array([state.time_s for state in found.states]) - found.start_s
    parts = np.array([[state.sources[name] for name in SOURCES] for state in found.states])
    total = np.array([state.twist for state in found.states])
    figure, axes = panels(1, 2, 3.0)
    for ax, axis, unit in ((axes[0], 0, "x [mm/s]"), (axes[1], 4, "about y [mrad/s]")):
        for k, name in enumerate(SOURCES[:4]):
            ax.plot(t, 1e3 * parts[:, k, axis], color=COLOURS[k], lw=1.0, label=name)
        ax.plot(t[::25], 1e3 * total[::25, axis], **PRINTED, label="twist that is made")
        ax.plot(t, 1e3 * parts[:, :, axis].sum(axis=1), color=COLOURS[5], lw=0.9, label="sum")
        label(ax, "time [s]", f"rate, {unit}")
        ax.set_xlim(3.5, 14.0)
    above(figure, axes[0])
    off = np.abs(parts.sum(axis=1) - total)[(t > 3.0) & (t < 14.0)].max()
    least = np.median(np.abs(parts[(t > 6.5) & (t < 9.0), :4]), axis=0).min()
    return Shown(
        [
            at_most("sum of the sources less the twist, all axes", float(off), "0", 1e-12),
            at_least("least typical rate of a source on an axis", float(least), "all axes", 1e-3),
        ],
        svg(figure),
    )


def pressed(stiffness: float, stick: float) -> Run:
    """Return a run in which a held stick drives the tool into a wall."""
    steps: list[dict[str, Any]] = [
        {"at_s": 0.2, "cmd/posture": {"posture": "ready"}},
        *(
            {"at_s": at_s, "cmd/joystick": {"twist": [u, 0, 0, 0, 0, 0], "expressed_in": "base"}}
            for at_s, u in ((3.5, 0.03), (6.5, stick))
        ),
    ]
    cell = altered(load_cell("pa10"), {"rig.wall.stiffness": stiffness})
    return run(cell, Script.model_validate({"duration_s": 10.5, "step": steps}))


def force() -> Shown:
    """Show the force at which a held stick settles."""
    gain = load_cell("pa10").config.sources.force.gain[0]
    figure, (left, right) = panels(1, 2, 2.9)
    numbers: list[Number] = []
    steady = []
    for i, (stiffness, stick) in enumerate(
        [*((k, STICKS[1]) for k in WALLS), *((WALLS[-1], u) for u in STICKS[::2])]
    ):
        found = pressed(stiffness, stick)
        pressing = np.array([truth.contact_force[0] for truth in found.truths])
        settled = float(pressing[found.times > 9.5].mean())
        if i < len(WALLS):
            left.plot(found.times, pressing, color=COLOURS[i], label=f"{1e-3 * stiffness:g} kN/m")
        steady.append((1e3 * stick, settled))
        numbers.append(
            near(
                f"wall of {1e-3 * stiffness:g} kN/m, stick of {1e3 * stick:g} mm/s",
                settled,
                stick / gain,
                0.02 * stick / gain,
                "N",
            )
        )
    left.axhline(STICKS[1] / gain, **BOUND, label="K_HC u / K_F")
    left.set_xlim(6.0, 9.0)
    right.plot(*np.array(steady).T, "o", color=COLOURS[0], label="telerobot, settled")
    u = np.linspace(0.0, 14.0, 8)
    right.plot(u, 1e-3 * u / gain, **BOUND, label="K_HC u / K_F")
    label(left, "time [s]", "force on the wall [N]", "stick 30 mm/s, then 7.5 mm/s")
    label(right, "stick K_HC u [mm/s]", "force on the wall [N]")
    left.legend()
    right.legend()
    return Shown(numbers, svg(figure))


def release() -> Shown:
    """Show a stick that leads an automatic motion aside, and is released."""
    told = load_script("nudge")
    nudged = run("pa10", told)
    alone = run("pa10", told.model_copy(update={"step": told.step[:1]}))
    figure, (left, right) = panels(1, 2, 3.0)
    for found, colour, name in (
        (alone, "0.6", "target alone"),
        (nudged, COLOURS[0], "with the stick"),
    ):
        place = np.array([truth.pose_mrf[:3] for truth in found.truths])
        left.plot(place[:, 0], place[:, 1], color=colour, label=name)
        target = np.array(found.states[-1].target_mrf or np.full(6, np.nan))[:3]
        right.semilogy(found.times, 1e3 * np.linalg.norm(place - target, axis=1), color=colour)
    left.plot(*target[:2], **PRINTED | {"marker": "x", "ms": 7}, label="target")
    label(left, "x [m]", "y [m]", "from above")
    label(right, "time [s]", "distance from the target [mm]")
    right.axvspan(1.0, 2.5, color="#e9ecef")
    left.axis("equal")
    above(figure, left)
    n = min(len(nudged.truths), len(alone.truths))
    ways = [np.array([truth.pose_mrf[:3] for truth in r.truths[:n]]) for r in (nudged, alone)]
    aside = float(np.linalg.norm(ways[0] - ways[1], axis=1).max())
    left_m, left_rad = nudged.summary["tool_error_m"], nudged.summary["tool_error_rad"]
    return Shown(
        [
            at_least("led aside by the stick", aside, "modified", 0.04, "m"),
            at_most("from the target at the end", left_m, "“still reached”", 1e-3, "m"),
            at_most("attitude at the end", left_rad, "“still reached”", 2e-3, "rad"),
        ],
        svg(figure),
    )  # fmt: skip


# --- Section 2.4: a view, by its pose and by its picture ------------------------------------------


LAWS: Final = {"pose": "by the pose", "image": "by the picture"}
BOARD: Final = {"tag": 9, "size": 0.08, "T_board_tag": {"xyz": (0.14, -0.02, 0.0)}}
"""A second tag beside the first, told 10 mm from where it is."""
COVERED: Final[Any] = [
    {"at_s": 0.2, "cmd/posture": {"posture": "ready"}},
    {"at_s": 2.2, "operator/store_view": {"camera": "wrist"}},
    {"at_s": 2.5, "cmd/position": {"xyz": [-0.12, 0.08, 0.03], "rpy": [0.0, 0.1, -0.2],
     "relative_to": "mrf", "expressed_in": "base", "speed": 0.15}},
    {"at_s": 4.8, "cmd/cancel": {}},
    {"at_s": 4.9, "rig/fault": {"kind": "cover", "target": "panel"}},
    {"at_s": 5.2, "operator/switch": {"source": "vision", "on": True}},
]  # fmt: skip
"""A view of both tags is stored, and looked for while the first is covered."""


class Led(NamedTuple):
    """The way back to a stored view, from when vision is switched on."""

    t: Array
    """(t,) [s]"""
    error: Array
    """How far the true Lens is from the stored view, and corners are, rms (t, 3) [m, rad, px]."""
    corners: Array
    """Where the corners of the camera's tag truly are in its picture (t, 4, 2) [px]."""
    stored: Array
    """Where they were when the view was stored (4, 2) [px]."""


def led_back(cell: Cell, law: str, script: Script) -> Led:
    """Return what the wrist's camera leads to by a law, `pose` or `image`."""
    cameras = cell.config.cameras
    cell = altered(cell, {f"cameras.{i}.law": law for i in range(len(cameras))})
    found = run(cell, script)
    eye = next(camera for camera in cameras if camera.name == "wrist")
    model = board_of(eye)[eye.tag]
    (on_s,) = (s.at_s for s in script.step if s.message and s.message.topic is SWITCH)
    (stored,) = (e["t_s"] for e in found.summary["events"] if e["name"] == "view_stored")
    late = [truth for truth, t in zip(found.truths, found.times, strict=True) if t >= on_s]
    before = min(found.truths, key=lambda truth: abs(truth.time_s - stored))
    error, corners = [], []
    for truth in (before, *late):
        T, off = found.view.view(truth), found.view.error(truth)
        assert T is not None
        assert off is not None
        error.append((*off, found.view.error_px(truth)))
        corners.append(pictured(model @ T.R.T + T.p) * eye.focal)
    t = np.array([truth.time_s for truth in late]) - found.start_s - on_s
    return Led(t, np.array(error[1:]), np.array(corners[1:]), corners[0])


def beside() -> Cell:
    """Return a cell whose panel has a second tag, 10 mm from where the camera is told."""
    cell = load_cell("pa10_vision")
    assert cell.config.rig is not None
    (panel,) = (tag for tag in cell.config.rig.tags if tag.name == "panel")
    assert panel.T_world_tag is not None
    there = panel.T_world_tag.model_copy(update={"xyz": (1.16, -0.13, 0.46)})
    second = panel.model_copy(
        update={"name": "beside", "tag": 9, "size": 0.08, "T_world_tag": there}
    )
    return altered(cell, {"rig.tags": (*cell.config.rig.tags, second), "cameras.0.board": (BOARD,)})


def views() -> Shown:
    """Show corners in the picture and errors on the way back to a view, by either law."""
    told, cell, other = load_script("vision_servo"), load_cell("pa10_vision"), beside()
    covered = Script.model_validate({"duration_s": 13.0, "step": COVERED})
    figure, axes = panels(1, 3, 2.9)
    numbers: list[Number] = []
    for ax, colour, (law, name) in zip(axes, COLOURS, LAWS.items(), strict=False):
        found, misled = led_back(cell, law, told), led_back(other, law, covered)
        for corner in range(4):
            ax.plot(*found.corners[:, corner].T, color=colour, lw=1.0)
        ax.plot(*found.stored.T, **PRINTED, label="the stored picture")
        ax.axis("equal")
        ax.invert_yaxis()
        label(ax, "across [px]", "down [px]" if law == "pose" else "", name)
        axes[2].semilogy(found.t, 1e3 * found.error[:, 0], color=colour, label=name)
        axes[2].semilogy(
            misled.t, 1e3 * misled.error[:, 0], color=colour, ls=(0, (2, 1.5)), lw=1.0,
            label=f"{name}, board told badly",
        )  # fmt: skip
        end = found.error[-50:].max(axis=0)
        far = misled.error[-100:, 0]
        numbers += [
            at_least(f"{name}: from the view at first", float(found.error[0, 0]), "–", 0.3, "m"),
            at_most(f"{name}: at the end", float(end[0]), "0", 1.5e-3, "m"),
            at_most(f"{name}: attitude at the end", float(end[1]), "0", 2.5e-3, "rad"),
            at_most(f"{name}: corners at the end", float(end[2]), "0", 0.1, "px"),
            at_least(f"{name}, board told badly: at the end", float(far.min()), "0", 0.02, "m")
            if law == "pose"
            else at_most(
                f"{name}, board told badly: at the end", float(far.max()), "0", 2.5e-3, "m"
            ),
        ]
    label(axes[2], "time [s]", "Lens from the stored view [mm]")
    axes[0].legend()
    above(figure, axes[2])
    return Shown(numbers, svg(figure))


# --- Section 3: shares of a payload ---------------------------------------------------------------


def grasp_maps(p: Array) -> Array:
    """Return G (k, 6, 6) = [I 0; p̂ I] of grasps at p (k, 3), by numpy's cross products."""
    G = np.tile(np.eye(6), (len(p), 1, 1))
    G[:, 3:, :3] = np.cross(p[:, None], np.eye(3)).transpose(0, 2, 1)
    return G


def least_squares(G: Array, weights: Array, wrench: Array) -> Array:
    """Solve the optimality conditions as one dense system: 2 W h + Gᵀλ = 0, Σ G h = w."""
    k = 6 * len(G)
    across = np.concatenate(list(G), axis=1)
    conditions = np.block([[np.diag(weights.ravel()), across.T], [across, np.zeros((6, 6))]])
    found = np.linalg.lstsq(conditions, np.concatenate([np.zeros(k), wrench]), rcond=None)[0]
    shares: Array = found[:k].reshape(-1, 6)
    return shares


def shares() -> Shown:
    """Show how a payload is shared by the arms' weights."""
    along, lifted = np.array([0, 30.0, 0, 0, 0, 0]), np.array([0, 0, 50.0, 10.0, 0, 0])
    ratios, worst = np.logspace(-1.0, 1.0, 41), 0.0
    figure, axes = panels(1, 2, 2.8)
    for ax, wrench, axis, name in (
        (axes[0], along, 1, "30 N along the line of the grasps"),
        (axes[1], lifted, 2, "50 N up, 10 N·m about the way ahead"),
    ):
        rows, dense = [], []
        for ratio in ratios:
            weights = np.array([[ratio] * 6, [1.0] * 6])
            rows.append(load_shares(BASES, weights, wrench)[:, axis])
            dense.append(least_squares(grasp_maps(BASES), weights, wrench)[:, axis])
        worst = max(worst, float(np.abs(np.array(rows) - dense).max()))
        for i in range(2):
            ax.semilogx(ratios, np.array(rows)[:, i], color=COLOURS[i], label=f"arm {i + 1}")
            ax.plot(
                ratios[::4], np.array(dense)[::4, i], **PRINTED,
                label="dense least squares" if i else None,
            )  # fmt: skip
        label(ax, "W₁ / W₂ [1]", "share [N]", name)
    above(figure, axes[0])
    found = load_shares(BASES, np.array([[2.0] * 6, [1.0] * 6]), along)
    total = np.einsum("kij,kj->i", grasp_maps(BASES), load_shares(BASES, np.ones((2, 6)), lifted))
    unmet = float(np.abs(total - lifted).max())
    return Shown(
        [
            at_most("shares off a dense solution of the conditions", worst, "0", 1e-9, "N"),
            near("W₁ / W₂ = 2, 30 N along: arm 1", float(found[0, 1]), 10.0, 1e-9, "N"),
            near("arm 2", float(found[1, 1]), 20.0, 1e-9, "N"),
            at_most("Σ G h less the payload's wrench", unmet, "0", 1e-9, "N, N·m"),
        ],
        svg(figure),
    )


def beam() -> Shown:
    """Show two arms that put a beam's pegs into two nodes."""
    found = run("pa10_pair", "two_nodes")
    beams = [truth.beam for truth in found.truths if truth.beam is not None]
    depth = np.array([b.peg_depth for b in beams])
    push = np.array([np.linalg.norm(b.push) for b in beams])
    inner = np.array([b.internal_force for b in beams])
    figure, (left, right) = panels(1, 2, 2.9)
    for i, name in enumerate(("left node", "right node")):
        left.plot(found.times, 1e3 * depth[:, i], color=COLOURS[i], label=name)
    left.axhline(0.0, **BOUND)
    right.plot(found.times, push, color=COLOURS[2], label="push on the nodes")
    right.plot(found.times, inner, color=COLOURS[3], label="internal force")
    label(left, "time [s]", "depth of the peg [mm]")
    label(right, "time [s]", "force [N]")
    left.legend()
    right.legend()
    deep, rest = float(depth[-1].min()), float(inner[-100:].mean())
    return Shown(
        [
            at_least("depth of the lesser peg at the end", deep, "inserted", 0.02, "m"),
            at_most("push on the nodes, greatest", float(push.max()), "“sufficient”", 40.0, "N"),
            at_most("internal force, greatest", float(inner.max()), "“minimized”", 10.0, "N"),
            at_most("internal force, last second", rest, "“minimized”", 0.5, "N"),
        ],
        svg(figure),
    )  # fmt: skip


WILLIAMS = Paper(
    "Control Architecture for Telerobotic Systems",
    "Williams, Fifth National Conference on Applied Mechanisms and Robotics, 1997",
    {
        "rate_sum": Exhibit(
            "Fig. 1, section 2.6",
            "All sources at once, on all axes",
            "Rates of joystick, position, vision and force are added on all Cartesian axes.",
            "",
            "Rates of the four sources of a run, their sum, and the twist that is made; from 6 to "
            "9 s the stick pushes the tool onto a plate, with both other targets standing.",
            'make papers ARGS="--only rate_sum"; telerobot simulate pa10_all all_sources',
            rate_sum,
        ),
        "frames": Exhibit(
            "Fig. 2, eqs. 1, 3 and 5",
            "Frames that are redefined in motion and in contact",
            "MRF and CRF are the user's, and change during tasks; rates and wrenches are brought "
            "from one frame to another by rigid-body transforms.",
            "The sub- and superscripts of eq. 1 are damaged in our copy: P is the MRF's origin as "
            "seen from the Wrist, and the same R turns both rows. Rotations by 3-2-1 Euler rates, "
            "section 2.3, equal the rotation vector to first order only: the server uses the "
            "rotation vector.",
            "MRF and CRF are redefined at the dashed instants: on the way, while a stick turns the "
            "tool, and while it presses on a wall.",
            'make papers ARGS="--only frames"; telerobot simulate pa10 frames_here',
            frames,
        ),
        "attitude": Exhibit(
            "Section 2.3, eq. 4",
            "The error of attitude",
            "Three 3-2-1 Euler angles of the error are taken as the angles and as their rates.",
            "They equal the rotation vector to first order only. In the axes of the MRF the target "
            "is reached, with detours; the axes are not printed, and in those of the target one "
            "start in five never arrives. The server takes the rotation vector: the shortest way.",
            "Angle from the target over time, of 24 random starts, at K = 1 /s.",
            'make papers ARGS="--only attitude"',
            attitude,
        ),
        "views": Exhibit(
            "Section 2.4, Fig. 3c",
            "A view by its pose, and by its picture",
            "The arm is moved from what a camera sees to what an image stored in memory shows; the "
            "error is that of two homogeneous transforms, with Lens, Target and V in the places of "
            "MRF, CRF and DES.",
            "An image is stored, and a pose is compared: what the model of the target says wrongly "
            "is in the pose. Where a board's second tag is 10 mm from where it was told, and the "
            "first is covered, the pose leads centimetres away. The server compares the poses, or "
            '(`law = "image"`) the corners in both pictures. K_V is said to have K_P\'s units, of '
            "which the rotational are none: both are 1/s.",
            "Rendered pictures, truth of the physics. Left: the four corners of the tag on their "
            "way back to the stored picture, from 0.32 m and 31° off. Right: the Lens; dashed "
            "with a board that is told badly.",
            'make papers ARGS="--only views"; telerobot simulate pa10_vision vision_servo',
            views,
        ),
        "force": Exhibit(
            "Sections 2.5 and 2.6",
            "A rate that becomes a force",
            "Rate control and force–moment accommodation on all axes: free motion turns into "
            "pushing by itself. At rest K_HC u = K_F F.",
            "“The gains are tuned heuristically”: sampled with a delay of d periods T, a wall of "
            "stiffness k is stable where K_F k T < 2 sin(π / (4d + 2)). `telerobot check` judges a "
            "cell's gains by that.",
            "Left: three walls, one stick. Right: three sticks, and the line K_HC u / K_F.",
            'make papers ARGS="--only force"; telerobot simulate pa10 wall_push',
            force,
        ),
        "release": Exhibit(
            "Section 2.7",
            "The stick is released",
            "An operator leads an automatic motion away from danger; when the stick is released, "
            "the original target is still reached.",
            "",
            "The same target with and without a stick, which is held in the grey interval.",
            'make papers ARGS="--only release"; telerobot simulate pa10 nudge',
            release,
        ),
        "shares": Exhibit(
            "Section 3",
            "Shares of a common payload",
            "Arms share a load by the least of a quadratic cost of their wrenches.",
            "The cost and its solution are not printed: ours is Σ hᵢᵀ Wᵢ hᵢ with Σ Gᵢ hᵢ = w.",
            "Shares of two arms, 1 m apart, over the quotient of their weights.",
            'make papers ARGS="--only shares"',
            shares,
        ),
        "beam": Exhibit(
            "Section 4",
            "A beam into two nodes",
            "Two arms insert a beam into two nodes at once, force–moment accommodation on.",
            "No numbers are printed. Both nodes of ours stand 2 mm farther ahead and 1 mm farther "
            "aside than they are meant to, and one of them 2 mm lower.",
            "Depth of both pegs, push on the nodes and internal force, in the physics.",
            'make papers ARGS="--only beam"; telerobot simulate pa10_pair two_nodes',
            beam,
        ),
    },
)
