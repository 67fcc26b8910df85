"""Check of the drives' bounds against the robot's, and of their resolution."""

import math
from collections.abc import Iterator

import numpy as np

from ...config.load import Cell
from ...config.schema.mechanism import DifferentialBaseSection, DriveSection
from ...config.urdf.robot import UrdfJoint
from ...drivers.device import MOST_MISSED_SYNCS
from ...protocols.canopen.cia402 import HALF, SPAN
from ...server.control.mechanism.model import Mechanism
from .findings import Finding, Severity, graded

QUANTISATION_NOTICE = 0.25
"""Part of the jerk bound that the encoder's steps may look like before it is worth a word [1]."""
TORQUE_PER_MILLE_MAX = 32767
"""Greatest value of 6077h, in thousandths of the rated torque [1]."""
LONG_STOP_S = 0.5
"""A stop from full speed that takes longer is worth a word [s]."""
ENDLESS_STOP_S = 2.0
"""One that takes longer than this is none [s]."""


def drives(cell: Cell) -> Iterator[Finding]:
    """Judge every drive against its joint in the URDF, against its encoder and its own ramp."""
    by_joint = {d.joint: d for d in cell.config.mechanism.drives}
    ready = np.array(cell.config.mechanism.postures["ready"])
    weight = np.abs(Mechanism.from_cell(cell).gravity(ready)[0])
    for i, joint in enumerate(cell.robot.joints):
        drive = by_joint[joint.name]
        yield _speed(drive, joint)
        yield _torque(drive, joint, float(weight[i]))
        yield _encoder(drive, cell.config.timing.period_s)
        yield _stop(drive)
        if joint.name in cell.config.mechanism.wheels and cell.config.mechanism.base is not None:
            yield _wraps(drive, cell.config.mechanism.base, cell.config.timing.period_s)


def _speed(drive: DriveSection, joint: UrdfJoint) -> Finding:
    return Finding(
        f"{joint.name} speed",
        graded(drive.max_velocity, joint.velocity, joint.velocity),
        f"{drive.max_velocity:g} rad/s, URDF {joint.velocity:g}",
        {"max_velocity": drive.max_velocity, "urdf": joint.velocity},
    )


def _torque(drive: DriveSection, joint: UrdfJoint, weight: float) -> Finding:
    per_mille = 1000.0 * drive.max_torque / drive.rated_torque
    status = graded(drive.max_torque, joint.effort, joint.effort)
    text = f"{drive.max_torque:g} N·m, URDF {joint.effort:g}"
    if status is Severity.ERROR and joint.effort < weight:
        status = Severity.WARN
        text += f", which would not hold the {weight:.3g} N·m of `ready`"
    if per_mille > TORQUE_PER_MILLE_MAX:
        status = Severity.ERROR
        text += f"; {per_mille:.0f} thousandths of the rated torque do not fit into 6077h"
    return Finding(
        f"{joint.name} torque",
        status,
        text,
        {"max_torque": drive.max_torque, "urdf": joint.effort, "per_mille": per_mille},
    )


def _encoder(drive: DriveSection, period_s: float) -> Finding:
    apparent = 4.0 / (drive.counts_per_radian * period_s**3)
    share = apparent / drive.max_jerk
    return Finding(
        f"{drive.joint} encoder",
        graded(share, QUANTISATION_NOTICE, 1.0),
        f"4 steps / T³ look like a jerk of {apparent:.3g} rad/s³, {share:.1%} of the bound "
        f"{drive.max_jerk:g}",
        {"apparent_jerk": apparent, "max_jerk": drive.max_jerk},
    )


def _stop(drive: DriveSection) -> Finding:
    """Judge how long a stop from full speed takes: on the drive's own ramp, and verified."""
    V, A, J = drive.max_velocity, drive.max_acceleration, drive.max_jerk
    ramp_s = V / drive.quick_stop_deceleration
    verified_s = V / A + A / J if V * J > A**2 else 2.0 * math.sqrt(V / J)
    longest_s = max(ramp_s, verified_s)
    text = (
        f"quick stop {ramp_s:.3g} s at {drive.quick_stop_deceleration:g} rad/s², "
        f"verified stop {verified_s:.3g} s"
    )
    status = graded(longest_s, LONG_STOP_S, ENDLESS_STOP_S)
    if longest_s > LONG_STOP_S:
        text += f": a stop from {V:g} rad/s may take at most {ENDLESS_STOP_S:g} s"
    elif drive.quick_stop_deceleration < A:
        status = Severity.WARN
        text += ": the ramp takes longer than the bound A would"
    return Finding(
        f"{drive.joint} stops",
        status,
        text,
        {
            "quick_stop_deceleration": drive.quick_stop_deceleration,
            "max_acceleration": A,
            "quick_stop_s": ramp_s,
            "verified_stop_s": verified_s,
        },
    )


def _wraps(drive: DriveSection, base: DifferentialBaseSection, period_s: float) -> Finding:
    """Judge the counts of a wheel, which wrap: between two answers it goes the shorter way.

    A drive may miss some SYNCs before it is lost.
    """
    turned = drive.max_velocity * (MOST_MISSED_SYNCS + 1) * period_s
    counts = turned * drive.counts_per_radian
    around = base.wheels.radius * SPAN / drive.counts_per_radian
    fastest = drive.max_velocity * drive.counts_per_radian
    share = max(counts, fastest) / HALF
    return Finding(
        f"{drive.joint} counts",
        graded(share, 0.5, 1.0),
        f"wrap after {around:.4g} m; {fastest:.3g} counts/s at full speed, at most {HALF - 1} fit "
        "into 60FFh",
        {"wrap_m": around, "counts_per_second": fastest, "most": HALF - 1},
    )
