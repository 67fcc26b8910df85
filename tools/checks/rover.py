"""Checks of a base on wheels: wheels, sweep, and what its scanner sees."""

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from ...config.load import Cell
from ...config.schema.mechanism import DifferentialBaseSection
from ...config.schema.surroundings import ContourReflexSection, ScannerSection
from ...config.urdf.robot import axle_of
from ...config.urdf.shapes import Tube
from ...server.control.forest import Forest
from ...server.control.proximity.capsules import Capsules
from ...server.control.scene import Flags
from ...server.control.spatial import Array, Pose
from ...server.control.wheels import DifferentialDrive
from ...server.perception.scanning.contour import INSIDE, LEAST_HITS
from ...server.perception.scanning.placing import Knots, MeasuredInstant, ScannerGeometry
from ...server.perception.scanning.reflex import (
    STAND_OFF,
    UNDECIDED_FRONT,
    CriticalPoints,
    arm_joints,
)
from ...server.perception.scanning.scanning import CONTOUR_EVERY, reach_of
from ...server.units.unit import MOST
from .findings import Finding, Severity, graded

# --- Check of the arm in its own scans: margin, housings, and the plane around it -----------------
LEAST, WISHED = 2.0, 3.0
"""Standard deviations of distances that the margin covers: at least, and to be quiet [1]."""


def own_rays(cell: Cell) -> Iterator[Finding]:
    """Judge the own-ray margin, the links' radius and the plane; nothing without a contour."""
    scanner, contour = cell.config.scanner, cell.config.contour
    if scanner is None or contour is None:
        return
    capsules = Capsules(cell)
    radii = capsules.radius[capsules.moves[:, arm_joints(cell)].any(axis=1)]
    if radii.size:
        widest = float(radii.max())
        yield _margin(cell, scanner, contour, widest)
        yield Finding(
            "contour radius",
            Severity.ERROR if contour.link_radius < widest - 1e-6 else Severity.OK,
            f"link_radius {contour.link_radius:g} m, at least {widest:.3g}: the widest capsule of "
            "the arm",
            {"link_radius": contour.link_radius, "least": widest},
        )
    yield _plane(cell, contour)


def _margin(
    cell: Cell, scanner: ScannerSection, contour: ContourReflexSection, radius: float
) -> Finding:
    """Judge the margin between noise and the obstacles that a chosen posture keeps."""
    noise = INSIDE if cell.config.rig is None else cell.config.rig.scanner.noise
    margin, most = scanner.self_margin, reach_of(contour).choose - radius
    status = Severity.WARN if margin < WISHED * noise else Severity.OK
    if margin < LEAST * noise or margin > most:
        status = Severity.ERROR
    return Finding(
        "self margin",
        status,
        f"{margin:g} m, at least {LEAST * noise:.3g}, {LEAST:g} σ of the distances (better "
        f"{WISHED * noise:.3g}), and at most {most:.3g}, or what a folded arm passes counts as "
        "the arm",
        {"self_margin": margin, "least": LEAST * noise, "most": most},
    )


def _plane(cell: Cell, contour: ContourReflexSection) -> Finding:
    """Judge whether the arm, as it drives, is inside of the plane: beyond it nothing is known."""
    points = CriticalPoints(cell, contour.shoulder, contour.elbow, contour.foot)
    plane = contour.plane
    ready = np.array(cell.config.mechanism.postures["ready"])[points.arm]
    seen = points.of(ready[None])[0]
    high = float(seen[:, 2].max()) + contour.link_radius
    wide = 2.0 * max(
        float(np.abs(seen[:, 1]).max()) + contour.link_radius, 0.5 * contour.base_width
    )
    status = Severity.ERROR if high > plane.height or wide > plane.width else Severity.OK
    return Finding(
        "contour plane",
        status,
        f"{plane.height:g} m high and {plane.width:g} m wide; arm at `ready` and base take "
        f"{high:.3g} and {wide:.3g} of it",
        {"height": plane.height, "width": plane.width, "high": high, "wide": wide},
    )


# --- Check of the way ahead: which cells of the contour the scanner sees, how far and how near ----
DEPTH: Final = 0.05  # depths that are looked at are so far apart [m]
TILTS: Final = 31  # angles of the sweep that are looked at [1]
PIECES: Final = 40  # points of a ray that are held against the arm's capsules [1]
HIDDEN: Final = 0.25  # a larger part of the cells that the arm hides is worth a word [1]
WAIT: Final = UNDECIDED_FRONT + STAND_OFF
"""A base that waits stops so far before an obstacle, from the arm's foot [m]."""


class SeenCells(NamedTuple):
    """Cells (d, c) at some depths that any ray meets, and where its scanner is then."""

    depths: Array  # (d,) [m] ahead of the arm's foot
    cells: Array  # middles (c, 2) by y and z from the foot [m]
    seen: Flags  # (d, c)
    tilt: Array  # which angle of the sweep meets it (d, c), by number


def sight(cell: Cell) -> Iterator[Finding]:
    """Judge the view over the contour's cells; nothing without a contour.

    Raises `ConfigError` for a link or joint that the URDF does not have.
    """
    scanner, contour = cell.config.scanner, cell.config.contour
    if scanner is None or contour is None:
        return
    geometry = ScannerGeometry(cell)
    knots = _knots(cell, geometry)
    view = _view(scanner, contour, knots)
    yield _near(contour, view)
    yield _far(cell, scanner, contour)
    yield _hidden(contour, view, knots, geometry.reach - scanner.self_margin)


def _knots(cell: Cell, geometry: ScannerGeometry) -> Knots:
    """Return the scanner's poses along its sweep, and the capsules of the arm at `ready`."""
    mechanism = cell.config.mechanism
    q = np.array(mechanism.postures["ready"])
    tilts = [q]
    if mechanism.sweep is not None:
        at = [joint.name for joint in cell.robot.joints].index(mechanism.sweep.joint)
        tilts = [q.copy() for _ in range(TILTS)]
        for each, angle in zip(
            tilts, np.linspace(mechanism.sweep.low, mechanism.sweep.high, TILTS), strict=True
        ):
            each[at] = angle
    return geometry.knots(
        [MeasuredInstant(k, float(k), q, Pose.identity()) for k, q in enumerate(tilts)]
    )


def _view(scanner: ScannerSection, contour: ContourReflexSection, knots: Knots) -> SeenCells:
    """Return which cells the scan plane sweeps over, within the angles of its rays."""
    plane, foot = contour.plane, np.array(contour.foot)
    rows, columns = round(plane.height / plane.cell), round(plane.width / plane.cell)
    i, j = (index.ravel() for index in np.indices((rows, columns)))
    cells = np.stack([(j + 0.5) * plane.cell - 0.5 * plane.width, (i + 0.5) * plane.cell], axis=1)
    depths = np.arange(DEPTH, plane.ahead + 1e-9, DEPTH)
    seen = np.zeros((len(depths), len(cells)), dtype=bool)
    tilt = np.zeros(seen.shape)
    span = scanner.step * (scanner.rays - 1)
    for d, depth in enumerate(depths):
        points = np.column_stack([np.full(len(cells), depth), cells]) + foot
        local = (points - knots.p[:, None]) @ knots.R
        z = local[:, :, 2]
        met = np.abs(z) <= 0.5 * plane.cell
        if len(z) > 1:
            met[:-1] |= z[:-1] * z[1:] <= 0.0
        x, y = local[met, 0], local[met, 1]
        met[met] = np.mod(np.arctan2(x, -y) - scanner.first, 2.0 * np.pi) <= span
        seen[d], tilt[d] = met.any(axis=0), met.argmax(axis=0)
    return SeenCells(depths, cells, seen, tilt)


def _near(contour: ContourReflexSection, view: SeenCells) -> Finding:
    """Judge how near each cell is still seen: all of them where the base stops and waits."""
    seen = view.seen
    # From where on is a cell seen, up to where it is acted upon?
    blind = np.where(seen.all(axis=0), -1, len(seen) - 1 - np.argmin(seen[::-1], axis=0))
    worst = int(np.argmax(blind))
    y, z = view.cells[worst].tolist()
    nearest = DEPTH if blind[worst] < 0 else float(view.depths[blind[worst]]) + DEPTH
    values = {"nearest": nearest, "limit": WAIT, "y": y, "z": z}
    where = f"the cell at y {y:.3g}, z {z:.3g} m"
    if not seen[-1].all():
        dead = int((~seen[-1]).sum())
        text = (
            f"{dead} of {len(view.cells)} cells are not seen {contour.plane.ahead:g} m ahead, "
            "where the reflex begins: sweep, link and angles of the rays leave them out"
        )
        return Finding("sight near", Severity.ERROR, text, values | {"dead": dead})
    return Finding(
        "sight near",
        graded(nearest, WAIT, WAIT),
        f"all cells are seen from {contour.plane.ahead:g} m down to {nearest:.3g} m ahead of the "
        f"foot, {where} the first to be lost; at most {WAIT:g}, where a base waits",
        values | {"dead": 0},
    )


def _far(cell: Cell, scanner: ScannerSection, contour: ContourReflexSection) -> Finding:
    """Judge from how far a bridge is seen: its cells are full after two sweeps.

    As many hits as a cell needs, one of them inside: by the rays' angle, and the sweep's between
    two scans.
    """
    plane, axis = contour.plane, cell.config.mechanism.sweep
    inside = plane.cell - 2.0 * INSIDE
    if inside <= 0.0:
        return Finding(
            "sight far",
            Severity.ERROR,
            f"contour.plane.cell = {plane.cell:g} m: must be above {2.0 * INSIDE:g}: no hit of a "
            f"smaller one is {INSIDE:g} m inside of it, so nothing is ever seen",
            {"cell": plane.cell, "limit": 2.0 * INSIDE},
        )
    if axis is None:
        return Finding(
            "sight far",
            Severity.WARN,
            "no sweep: a cell fills only while the base brings it through the scan's plane",
        )
    between = 2.0 * (axis.high - axis.low) / axis.period_s / scanner.rate_hz
    passes = 4.0  # two sweeps, to and fro
    hits = passes / (scanner.step * between)  # of 1 m² at 1 m
    first = min(np.sqrt(hits / LEAST_HITS) * plane.cell, np.sqrt(hits) * inside)
    return Finding(
        "sight far",
        Severity.ERROR if first < plane.ahead else graded(plane.collect, float(first), np.inf),
        f"a bridge is seen from {first:.3g} m on, its cells full after two sweeps; at least "
        f"ahead = {plane.ahead:g}",
        {"first": float(first), "ahead": plane.ahead, "collect": plane.collect},
    )


def _hidden(contour: ContourReflexSection, view: SeenCells, knots: Knots, radii: Array) -> Finding:
    """Judge how many cells are behind the arm at `ready`, seen where a base waits."""
    d = int(np.flatnonzero(view.depths <= WAIT + 1e-9)[-1])
    points = np.column_stack([np.full(len(view.cells), view.depths[d]), view.cells])
    tilt = view.tilt[d].astype(int)
    start, toward = knots.p[tilt], points + np.array(contour.foot) - knots.p[tilt]
    share = (np.arange(PIECES) + 0.5) / PIECES
    rays = start[:, None] + share[:, None] * toward[:, None]
    hidden = np.zeros(len(points), dtype=bool)
    for c, radius in enumerate(radii.tolist()):
        tube = Tube(knots.ends[0, 2 * c], knots.ends[0, 2 * c + 1], radius)
        hidden |= tube.holds(rays.reshape(-1, 3)).reshape(rays.shape[:2]).any(axis=1)
    part = float(hidden.mean())
    return Finding(
        "sight hidden",
        graded(part, HIDDEN, 1.0),
        f"the arm at `ready` hides {int(hidden.sum())} of {len(hidden)} cells "
        f"{view.depths[d]:.3g} m ahead: they are bridged, or remembered",
        {"hidden": int(hidden.sum()), "cells": len(hidden)},
    )


# --- Check of the axis that sweeps a laser scanner, and of the scanner's own time -----------------
def sweep(cell: Cell) -> Iterator[Finding]:
    """Judge the sweep's speed, and the scanner that it carries; nothing without either.

    A slower sweep has not seen everything when the arm decides. A mirror passes each angle once in
    a scan; a scanner that is silent may lose one contour. An unknown link is told where the sight
    is.
    """
    axis, scanner = cell.config.mechanism.sweep, cell.config.scanner
    if axis is not None:
        drive = next(d for d in cell.config.mechanism.drives if d.joint == axis.joint)
        rate, most = 2.0 * (axis.high - axis.low) / axis.period_s, MOST * drive.max_velocity
        yield Finding(
            "sweep speed",
            graded(rate, most, most),
            f"{axis.low:g} to {axis.high:g} rad in half of {axis.period_s:g} s takes {rate:.3g} "
            f"rad/s of {axis.joint}, at most {most:.3g}: {MOST:.0%} of max_velocity",
            {"rate": rate, "limit": most},
        )
    if axis is not None and scanner is not None:
        model = Forest(cell).branches[0].model
        frame = model.frames[model.getFrameId(scanner.link)]
        on_it = model.getJointId(axis.joint) in model.supports[frame.parentJoint].tolist()
        yield Finding(
            "sweep scanner",
            Severity.OK if on_it else Severity.ERROR,
            f"{axis.joint} {'turns' if on_it else 'does not turn'} scanner.link = '{scanner.link}'",
            {"joint": axis.joint, "link": scanner.link},
        )
    if scanner is not None:
        span = scanner.step * (scanner.rays - 1)
        yield Finding(
            "scanner rays",
            graded(span, 2.0 * math.pi, 2.0 * math.pi),
            f"{scanner.rays} rays span {math.degrees(span):.4g}°, at most 360°",
            {"span": span, "limit": 2.0 * math.pi},
        )
        least = 2.0 * (CONTOUR_EVERY / scanner.rate_hz)
        yield Finding(
            "scanner silence",
            Severity.ERROR if scanner.silent_s < least else Severity.OK,
            f"silent_s {scanner.silent_s:g} s, at least {least:g}: two contours of "
            f"{CONTOUR_EVERY} scans at {scanner.rate_hz:g} Hz",
            {"silent_s": scanner.silent_s, "least": least},
        )


# --- Check of a base's wheels: their places in the URDF, and the speeds that driving takes --------
LIKE: Final = 0.01
"""Wheels on axles that are less apart, per radius, are on one [1]."""
NOTICE_OFF, MOST_OFF = 0.01, 0.05
"""A radius or track that is wrong by these shares spoils the odometry by as much [1]."""


def wheels(cell: Cell) -> Iterator[Finding]:
    """Judge the wheels of a base; nothing without one."""
    base, rolling = cell.config.mechanism.base, DifferentialDrive.from_cell(cell)
    if base is None or rolling is None:
        return
    yield _places(cell, base)
    if base.wheels.followers:
        yield _skid(cell, base)
    yield _wheel_speed(cell, base, rolling)


def _places(cell: Cell, base: DifferentialBaseSection) -> Finding:
    """Judge radius and track against the wheels' axles in the URDF, and Base midway between them.

    Base is as high above the floor as `T_world_base` says.
    """
    told, places = base.wheels, _axles(cell, base)
    x, y, _ = places.mean(axis=0).tolist()
    sides = np.concatenate(([1.0, -1.0], np.sign(places[2:, 1])))
    tracks = 2.0 * sides * (places[:, 1] - y)
    radii = places[:, 2] + cell.config.mechanism.T_world_base.xyz[2]
    track, radius = (
        float(values[np.argmax(np.abs(values - wished))])
        for values, wished in ((tracks, told.track), (radii, told.radius))
    )
    beside = max(abs(x), abs(y)) / told.track
    off = max(abs(track / told.track - 1.0), abs(radius / told.radius - 1.0), beside)
    return Finding(
        "base wheels",
        graded(off, NOTICE_OFF, MOST_OFF),
        f"axles {track:g} m apart from right to left and {radius:g} m high in the URDF, their "
        f"middle at x {x:g}, y {y:g} m of Base; track {told.track:g} and radius {told.radius:g} "
        f"in the cell: {off:.1%} off, at most {MOST_OFF:.0%}",
        {"urdf_track": track, "urdf_radius": radius, "off": off, "limit": MOST_OFF},
    )


def _axles(cell: Cell, base: DifferentialBaseSection) -> Array:
    """Return the places (k, 3) of the wheels' axles in Base [m]."""
    wheels = base.wheels
    names = (wheels.left, wheels.right, *wheels.followers)
    return np.array([axle_of(cell.robot, name) for name in names])


def _skid(cell: Cell, base: DifferentialBaseSection) -> Finding:
    """Judge the slip factor of wheels on several axles, which skid where the base turns.

    With Coulomb friction and equal loads it is 1 + (L / b)² for two axles L apart and a track b;
    no wheels on several axles turn a base that is no wider than its track.
    """
    told, ahead = base.wheels, _axles(cell, base)[:, 0]
    length = float(ahead.max() - ahead.min())
    guess = 1.0 + (length / told.track) ** 2
    skids = length > LIKE * told.radius
    status = Severity.WARN if skids and told.slip_factor == 1.0 else Severity.OK
    return Finding(
        "base skid",
        status,
        f"slip_factor {told.slip_factor:g}; axles {length:.3g} m apart on a track of "
        f"{told.track:g} m make about {guess:.3g} on an even floor: measure it, the heading is off "
        "by as much",
        {"slip_factor": told.slip_factor, "expected": guess},
    )


def _wheel_speed(cell: Cell, base: DifferentialBaseSection, rolling: DifferentialDrive) -> Finding:
    """Judge the wheels' speed bounds: straight on, and with all of the turning beside it."""
    drives = {drive.joint: drive.max_velocity for drive in cell.config.mechanism.drives}
    least = min(drives[base.wheels.left], drives[base.wheels.right])
    straight = float(rolling.wheels(base.speed, 0.0).max())
    alone = float(rolling.wheels(0.0, base.angular_speed).max())
    both = straight + alone
    status = Severity.ERROR if max(straight, alone) > least else graded(both, least, both)
    return Finding(
        "base speed",
        status,
        f"the faster wheel turns at {straight:.3g} rad/s straight on, {alone:.3g} on the spot, "
        f"{both:.3g} with both; max_velocity {least:g}",
        {"straight": straight, "on_the_spot": alone, "both": both, "max_velocity": least},
    )
