"""Check of the axis that sweeps a laser scanner, and of the scanner's own time."""

import math
from collections.abc import Iterator

from ....config.load import Cell
from ....config.schema.mechanism import SweepSection
from ....config.schema.surroundings import ScannerSection
from ....server.control.proximity.capsules import Forest
from ....server.perception.scanning.scanning import CONTOUR_EVERY
from ....server.units.unit import MOST
from ..findings import Finding, Severity, graded


def sweep(cell: Cell) -> Iterator[Finding]:
    """Judge the sweep's speed, and the scanner that it carries; nothing without either."""
    mechanism, scanner = cell.config.mechanism, cell.config.scanner
    if mechanism.sweep is not None:
        yield _speed(cell, mechanism.sweep)
        if scanner is not None:
            yield _carried(cell, mechanism.sweep, scanner)
    if scanner is not None:
        yield _turn(scanner)
        yield _silence(scanner)


def _speed(cell: Cell, axis: SweepSection) -> Finding:
    """Judge the speed: a slower sweep has not seen everything when the arm decides."""
    drive = next(d for d in cell.config.mechanism.drives if d.joint == axis.joint)
    rate, most = 2.0 * (axis.high - axis.low) / axis.period_s, MOST * drive.max_velocity
    return Finding(
        "sweep speed",
        graded(rate, most, most),
        f"{axis.low:g} to {axis.high:g} rad in half of {axis.period_s:g} s takes {rate:.3g} rad/s "
        f"of {axis.joint}, at most {most:.3g}: {MOST:.0%} of max_velocity",
        {"rate": rate, "limit": most},
    )


def _carried(cell: Cell, axis: SweepSection, scanner: ScannerSection) -> Finding:
    """Judge whether the scanner is on the axis; an unknown link is told where the sight is."""
    model = Forest(cell).branches[0].model
    frame = model.frames[model.getFrameId(scanner.link)]
    on_it = model.getJointId(axis.joint) in model.supports[frame.parentJoint].tolist()
    return Finding(
        "sweep scanner",
        Severity.OK if on_it else Severity.ERROR,
        f"{axis.joint} {'turns' if on_it else 'does not turn'} scanner.link = '{scanner.link}'",
        {"joint": axis.joint, "link": scanner.link},
    )


def _turn(scanner: ScannerSection) -> Finding:
    """Judge the rays' span: a mirror passes each angle once in a scan."""
    span = scanner.step * (scanner.rays - 1)
    return Finding(
        "scanner rays",
        graded(span, 2.0 * math.pi, 2.0 * math.pi),
        f"{scanner.rays} rays span {math.degrees(span):.4g}°, at most 360°",
        {"span": span, "limit": 2.0 * math.pi},
    )


def _silence(scanner: ScannerSection) -> Finding:
    """Judge the time after which a scanner counts as silent: one contour may be lost."""
    contour_s = CONTOUR_EVERY / scanner.rate_hz
    status = Severity.ERROR if scanner.silent_s < 2.0 * contour_s else Severity.OK
    return Finding(
        "scanner silence",
        status,
        f"silent_s {scanner.silent_s:g} s, at least {2.0 * contour_s:g}: two contours of "
        f"{CONTOUR_EVERY} scans at {scanner.rate_hz:g} Hz",
        {"silent_s": scanner.silent_s, "least": 2.0 * contour_s},
    )
