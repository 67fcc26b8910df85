"""Check of the way ahead: which cells of the contour the scanner sees, how far and how near."""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from ....config.load import Cell
from ....config.schema.surroundings import ContourReflexSection, ScannerSection
from ....server.control.scene import Flags
from ....server.control.spatial import Array, Pose
from ....server.perception.scanning.contour import INSIDE, LEAST_HITS
from ....server.perception.scanning.placing import Knots, MeasuredInstant, ScannerGeometry
from ....server.perception.scanning.reflex import STAND_OFF, UNDECIDED_FRONT
from ..findings import Finding, Severity, graded

DEPTH: Final = 0.05
"""Depths that are looked at are so far apart [m]."""
TILTS: Final = 31
"""Angles of the sweep that are looked at [1]."""
PIECES: Final = 40
"""Points of a ray that are held against the arm's capsules [1]."""
HIDDEN: Final = 0.25
"""A larger part of the cells that the arm hides is worth a word [1]."""
WAIT: Final = UNDECIDED_FRONT + STAND_OFF
"""A base that waits stops so far before an obstacle, from the arm's foot [m]."""


class SeenCells(NamedTuple):
    """Cells (d, c) at some depths that any ray meets, and where its scanner is then."""

    depths: Array
    """(d,) [m] ahead of the arm's foot."""
    cells: Array
    """Middles (c, 2) by y and z from the foot [m]."""
    seen: Flags
    """(d, c)."""
    tilt: Array
    """Which angle of the sweep meets it (d, c), by number."""


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
    for c, radius in enumerate(radii):
        a, b = knots.ends[0, 2 * c], knots.ends[0, 2 * c + 1]
        length = max(float((b - a) @ (b - a)), 1e-12)
        t = np.clip((rays - a) @ (b - a) / length, 0.0, 1.0)
        off = np.linalg.norm(rays - a - t[..., None] * (b - a), axis=2)
        hidden |= off.min(axis=1) < radius
    part = float(hidden.mean())
    return Finding(
        "sight hidden",
        graded(part, HIDDEN, 1.0),
        f"the arm at `ready` hides {int(hidden.sum())} of {len(hidden)} cells "
        f"{view.depths[d]:.3g} m ahead: they are bridged, or remembered",
        {"hidden": int(hidden.sum()), "cells": len(hidden)},
    )
