"""Check of the arm in its own scans: margin, housings, and the plane around it."""

from collections.abc import Iterator

import numpy as np

from ....config.load import Cell
from ....config.schema.surroundings import ContourReflexSection, ScannerSection
from ....server.control.proximity.capsules import Capsules
from ....server.control.spatial import Array
from ....server.perception.scanning.contour import INSIDE
from ....server.perception.scanning.reflex import CriticalPoints, arm_joints
from ....server.perception.scanning.scanning import reach_of
from ..findings import Finding, Severity

LEAST, WISHED = 2.0, 3.0
"""Standard deviations of distances that the margin covers: at least, and to be quiet [1]."""


def own_rays(cell: Cell) -> Iterator[Finding]:
    """Judge the own-ray margin, the links' radius and the plane; nothing without a contour."""
    scanner, contour = cell.config.scanner, cell.config.contour
    if scanner is None or contour is None:
        return
    radii = _radii(cell)
    if radii.size:
        yield _margin(cell, scanner, contour, float(radii.max()))
        yield _radius(contour, float(radii.max()))
    yield _plane(cell, contour)


def _radii(cell: Cell) -> Array:
    """Return the radii of the capsules that joints of the arm move [m]."""
    capsules = Capsules(cell)
    return capsules.radius[capsules.moves[:, arm_joints(cell)].any(axis=1)]


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


def _radius(contour: ContourReflexSection, radius: float) -> Finding:
    return Finding(
        "contour radius",
        Severity.ERROR if contour.link_radius < radius - 1e-6 else Severity.OK,
        f"link_radius {contour.link_radius:g} m, at least {radius:.3g}: the widest capsule of the "
        "arm",
        {"link_radius": contour.link_radius, "least": radius},
    )


def _plane(cell: Cell, contour: ContourReflexSection) -> Finding:
    """Judge whether the arm, as it drives, is inside of the plane: beyond it nothing is known."""
    points, plane = (
        CriticalPoints(cell, contour.shoulder, contour.elbow, contour.foot),
        contour.plane,
    )
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
