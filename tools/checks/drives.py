"""Are the drives' bounds within the robot's, and fine enough for what is asked of them?"""

from collections.abc import Iterator

from ...config.load import Cell
from ...config.mechanism import Drive
from ...config.urdf import UrdfJoint
from ..findings import Finding, Status, graded

QUANTISATION_NOTICE = 0.25
"""Part of the jerk bound that the encoder's steps may look like before it is worth a word [1]."""
TORQUE_PER_MILLE_MAX = 32767
"""Greatest value of 6077h, in thousandths of the rated torque [1]."""


def drives(cell: Cell) -> Iterator[Finding]:
    """Judge every drive against its joint in the URDF, against its encoder and its own ramp."""
    by_joint = {d.joint: d for d in cell.config.mechanism.drives}
    for joint in cell.robot.joints:
        drive = by_joint[joint.name]
        yield _speed(drive, joint)
        yield _torque(drive, joint)
        yield _encoder(drive, cell.config.timing.period_s)
        yield _ramp(drive)


def _speed(drive: Drive, joint: UrdfJoint) -> Finding:
    return Finding(
        f"{joint.name} speed",
        graded(drive.max_velocity, joint.velocity, joint.velocity),
        f"{drive.max_velocity:g} rad/s, URDF {joint.velocity:g}",
        {"max_velocity": drive.max_velocity, "urdf": joint.velocity},
    )


def _torque(drive: Drive, joint: UrdfJoint) -> Finding:
    per_mille = 1000.0 * drive.max_torque / drive.rated_torque
    status = graded(drive.max_torque, joint.effort, joint.effort)
    text = f"{drive.max_torque:g} N·m, URDF {joint.effort:g}"
    if per_mille > TORQUE_PER_MILLE_MAX:
        status = Status.ERROR
        text += f"; {per_mille:.0f} thousandths of the rated torque do not fit into 6077h"
    return Finding(
        f"{joint.name} torque",
        status,
        text,
        {"max_torque": drive.max_torque, "urdf": joint.effort, "per_mille": per_mille},
    )


def _encoder(drive: Drive, period_s: float) -> Finding:
    apparent = 4.0 / (drive.counts_per_radian * period_s**3)
    share = apparent / drive.max_jerk
    return Finding(
        f"{drive.joint} encoder",
        graded(share, QUANTISATION_NOTICE, 1.0),
        f"4 steps / T³ look like a jerk of {apparent:.3g} rad/s³, {share:.1%} of the bound "
        f"{drive.max_jerk:g}",
        {"apparent_jerk": apparent, "max_jerk": drive.max_jerk},
    )


def _ramp(drive: Drive) -> Finding:
    weak = drive.quick_stop_deceleration < drive.max_acceleration
    text = f"{drive.quick_stop_deceleration:g} rad/s², bound A {drive.max_acceleration:g}"
    return Finding(
        f"{drive.joint} quick stop",
        Status.WARN if weak else Status.OK,
        text + (": takes longer than the verified stop" if weak else ""),
        {
            "quick_stop_deceleration": drive.quick_stop_deceleration,
            "max_acceleration": drive.max_acceleration,
        },
    )
