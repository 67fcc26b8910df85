"""Checks of the mechanism: its postures, how it starts, and the tunnel that it goes in."""

from collections.abc import Iterator

import numpy as np

from ...config.consistency import REQUIRED_POSTURES
from ...config.drives import joint_bounds
from ...config.load import Cell, ConfigError
from ...drivers.rig.physics.scene import build_model
from ...server.control.axes import HeldAxes, holding
from ...server.control.backbone.insertion import FITS, Backbone
from ...server.control.mechanism.model import Mechanism
from ...server.control.proximity.capsules import Capsules
from ...server.control.spatial import Pose
from ..scripts.script import load_script
from .cell import nearest
from .findings import Finding, Severity, graded


# --- Check of postures: distance from singularities at the start ----------------------------------
def postures(cell: Cell) -> Iterator[Finding]:
    """Judge the least singular value at `start` and `ready`; joint limits were held on loading."""
    config = cell.config.mechanism
    mechanism = Mechanism.from_cell(cell)
    tool = Pose.from_xyz_rpy(config.T_wrist_mrf.xyz, config.T_wrist_mrf.rpy)
    resolve = cell.config.resolve
    held = holding(resolve.free_axes)
    weight = np.array([1.0] * 3 + [resolve.characteristic_length] * 3)
    for name in REQUIRED_POSTURES:
        k = mechanism.kinematics(np.array(config.postures[name]), tool)
        J, rank = k.J, mechanism.rank
        if held is not None:
            axes = HeldAxes.of(held, k.T_world_mrf.R, mechanism.held_ranks(held == 1.0, tool))
            J, rank = axes.rows(J), axes.rank
        # Axes that the arm reaches nowhere, as a planar one, are no singularities.
        each = np.linalg.svd(J * weight[:, None], compute_uv=False)
        sigma = float(each[min(rank, len(each)) - 1])
        status, judgement = Severity.OK, "away from"
        if sigma < resolve.floor:
            status, judgement = Severity.ERROR, "in"
        elif sigma < resolve.singular_region:
            status, judgement = Severity.WARN, "near"
        yield Finding(
            f"posture {name}",
            status,
            f"{judgement} a singularity: least singular value {sigma:.3g} m, damping begins below "
            f"{resolve.singular_region:g}, motion into it ends at {resolve.floor:g}",
            {"sigma_min": sigma, "singular_region": resolve.singular_region},
        )


# --- Check that a cell starts: its script, its physics, its shape, and room between its links -----
def starting(cell: Cell) -> Iterator[Finding]:
    """Judge what `simulate`, `demo` and `serve` begin with; each error as they would tell it."""
    try:
        script = load_script(cell.default_script)
        text = f"{cell.default_script.name}, {script.duration_s:g} s"
        yield Finding("script", Severity.OK, text, {"duration_s": script.duration_s})
    except ConfigError as error:
        yield from _told("script", error)
    if cell.config.rig is not None:
        try:
            model, _ = build_model(cell)
            yield Finding(
                "physics", Severity.OK, f"{model.nbody} bodies, {model.nv} degrees of freedom",
                {"bodies": int(model.nbody), "freedoms": int(model.nv)},
            )  # fmt: skip
        except ConfigError as error:
            yield from _told("physics", error)
    if not cell.config.keeps_clear:
        for part in cell.parts:
            links = part.robot.mesh_links()
            if links and part.config.rig is not None:
                yield Finding(
                    f"{part.prefix}shape",
                    Severity.WARN,
                    f"meshes are not read: {', '.join(links)} touch nothing in the rig, and no "
                    f"clearance is kept; `telerobot init {part.robot.urdf}` finds capsules",
                    {"links": len(links)},
                )
        return
    try:
        capsules = Capsules(cell)
    except ConfigError as error:
        yield from _told("shape", error)
        return
    yield from _own_gaps(cell, capsules)


def _own_gaps(cell: Cell, capsules: Capsules) -> Iterator[Finding]:
    """Judge the distance of each arm's links at `start` and `ready`."""
    avoidance = cell.config.avoidance
    for name in REQUIRED_POSTURES:
        gap, pair = nearest(cell, capsules, name, 1.0)
        if not pair:
            continue
        status = Severity.OK
        if gap < avoidance.self_clearance:
            status = Severity.ERROR if gap < 0.0 and avoidance.enabled else Severity.WARN
        yield Finding(
            f"links at {name}",
            status,
            f"{pair[0]} and {pair[1]} are {gap:.3g} m apart; {avoidance.self_clearance:g} m are "
            "promised",
            {"gap": gap, "clearance": avoidance.self_clearance},
        )


def _told(check: str, error: ConfigError) -> Iterator[Finding]:
    for message in error.messages:
        yield Finding(check, Severity.ERROR, message)


# --- Check of an arm in tunnels: whether its joints follow the curve, at every depth and at speed
FULL = 0.9  # part of a bound whose use is worth a word [1]
CALM = 0.7  # loops that use more than this of what they take swing for long [1]
LOOK = 8  # every so many fits are looked at [1]


def tunnel(cell: Cell) -> Iterator[Finding]:
    """Judge range, walls, speed and start of a cell with a backbone; nothing without.

    Raises `ConfigError` for a curve that no joints of this arm follow.
    """
    backbone = Backbone.from_cell(cell)
    if backbone is None:
        return
    section, names = backbone.section, [joint.name for joint in cell.robot.joints]
    low, high = joint_bounds(cell.robot.joints, cell.config.mechanism.drives)
    used, i, j = backbone.turns(np.array(low), np.array(high))
    angle, s1 = float(backbone.fits[i, j]), float(backbone.lengths[i])
    yield Finding(
        "tunnel range",
        graded(used, FULL, 1.0),
        f"{names[j]} at {angle:.3f} rad with a free length of {s1:.3f} m, within {low[j]:g} to "
        f"{high[j]:g}",
        {"joint": names[j], "angle": angle, "free_length": s1},
    )
    off, i = backbone.farthest_off()
    yield Finding(
        "tunnel walls",
        graded(off, FULL * backbone.room, backbone.room),
        f"links {1e3 * off:.1f} mm off the centre line with a free length of "
        f"{backbone.lengths[i]:.3f} m; half width {section.half_width:g} less link_radius and "
        f"clearance leave {1e3 * backbone.room:.1f} mm",
        {"off": off, "room": backbone.room, "free_length": float(backbone.lengths[i])},
    )
    V = np.array([drive.max_velocity for drive in cell.config.mechanism.drives])
    taken = np.abs(backbone.slopes) * section.speed / V
    i, j = (int(x) for x in np.unravel_index(int(taken.argmax()), taken.shape))
    most = section.speed / float(taken[i, j])
    fast = taken[i, j] > 1.0
    yield Finding(
        "tunnel speed",
        Severity.WARN if fast else Severity.OK,
        f"{section.speed:g} m/s takes {taken[i, j]:.0%} of {names[j]}'s speed with a free length "
        f"of {backbone.lengths[i]:.3f} m"
        + (f": it slows down there; {most:.3f} m/s is kept" if fast else ""),
        {"speed": section.speed, "kept": most},
    )
    yield from _start(cell, backbone)
    if cell.config.rig is not None:
        yield from _gains(cell, backbone)


def _start(cell: Cell, backbone: Backbone) -> Iterator[Finding]:
    """Judge whether start and ready are postures of the curve."""
    for name in ("start", "ready"):
        q = np.array(cell.config.mechanism.postures[name])
        found = backbone.located(q)
        if found is None:
            yield Finding(
                f"tunnel {name}",
                Severity.ERROR,
                f"no posture of the curve: a link is more than {1e3 * FITS:g} mm off it at every "
                "free length; the arm can be jogged only",
            )
            continue
        off = abs(found.s1 - backbone.section.start)
        status = graded(off, 0.005, 0.05) if name == "start" else Severity.OK
        yield Finding(
            f"tunnel {name}",
            status,
            f"free length {found.s1:.4f} m, start = {backbone.section.start:g}",
            {"free_length": found.s1},
        )


def _gains(cell: Cell, backbone: Backbone) -> Iterator[Finding]:
    """Judge the integral of simulated drives, of all joints together: K_i < K_p K_d / M.

    As matrices: one joint's motion excites all others of a chain, whose inertias outboard are
    nearly the same.
    """
    rig, n = cell.config.rig, len(cell.robot.joints)
    if rig is None:
        return
    drive, mechanism = rig.drive, Mechanism.from_cell(cell)
    values = (drive.stiffness, drive.damping, drive.integral, drive.armature)
    stiffness, damping, integral, armature = (np.resize(np.array(v), n) for v in values)
    scale = np.sqrt(integral / (stiffness * damping))
    used, s1 = 0.0, 0.0
    for length, q in zip(backbone.lengths[::LOOK], backbone.fits[::LOOK], strict=True):
        M = np.triu(mechanism.mass_matrix(q))
        M = M + np.triu(M, 1).T + np.diag(armature)
        share = float(np.linalg.eigvalsh(scale[:, None] * M * scale)[-1])
        if share > used:
            used, s1 = share, float(length)
    yield Finding(
        "tunnel gains",
        graded(used, CALM, 1.0),
        f"rig.drive.integral is {used:.0%} of what the loops of all joints together take, with a "
        f"free length of {s1:.3f} m",
        {"used": used, "free_length": s1},
    )
