"""From the objects of a simulated drive to the reference and the bounds of its loop."""

from typing import Final

from .....config.schema.mechanism.mechanism import DriveSection
from .....protocols.canopen.cia402 import Object, OperationMode
from ..canopen.objects import ObjectStore
from ..drive_loops import DriveLoops

_UNLIMITED: Final = 0xFFFFFFFF


def follow(
    mode: int,
    objects: ObjectStore,
    loop: DriveLoops,
    joint: int,
    drive: DriveSection,
    *,
    streamed: bool = True,
) -> bool:
    """Follow the newest setpoint of the mode; return whether the drive's limits cut it.

    `streamed`: more are to come, one every period.
    """
    scale = drive.direction * drive.counts_per_radian
    if mode == OperationMode.CSP:
        counts = objects[Object.TARGET_POSITION, 0]
        low, high = objects[Object.POSITION_LIMIT, 1], objects[Object.POSITION_LIMIT, 2]
        kept = min(max(counts, low), high)
        value = objects[Object.INTERPOLATION_PERIOD, 1]
        period_s = value * 10.0 ** objects[Object.INTERPOLATION_PERIOD, 2]
        target = drive.zero_rad + kept / scale
        return loop.aim(joint, target, period_s, streamed=streamed) or kept != counts
    if mode == OperationMode.CSV:
        counts = objects[Object.TARGET_VELOCITY, 0] + objects[Object.VELOCITY_OFFSET, 0]
        return loop.run(joint, counts / scale)
    share = (objects[Object.TARGET_TORQUE, 0] + objects[Object.TORQUE_OFFSET, 0]) * 1e-3
    return loop.pull(joint, share * drive.direction * drive.rated_torque)


def tune(
    mode: int, objects: ObjectStore, loop: DriveLoops, joint: int, drive: DriveSection
) -> None:
    """Take over the following window of the mode, the torque offset and the bound of torque."""
    loop.window[joint] = window(mode, objects, drive)
    share = objects[Object.TORQUE_OFFSET, 0] * 1e-3
    loop.offset[joint] = share * drive.direction * drive.rated_torque
    bound = objects[Object.MAX_TORQUE, 0]
    reached = bound >= most_torque(drive)
    loop.max_torque[joint] = drive.max_torque if reached else bound * 1e-3 * drive.rated_torque


def most_torque(drive: DriveSection) -> int:
    """Return the most that 6072h may be [1/1000 of the rated torque]."""
    return round(drive.max_torque / drive.rated_torque * 1000)


def window(mode: int, objects: ObjectStore, drive: DriveSection) -> float:
    """Return the following error that is too much [rad]; only a position setpoint has any."""
    counts = objects[Object.FOLLOWING_WINDOW, 0]
    if mode != OperationMode.CSP or counts == _UNLIMITED:
        return float("inf")
    return counts / drive.counts_per_radian


def deceleration(objects: ObjectStore, drive: DriveSection) -> float:
    """Return the quick stop's ramp [rad/s²]."""
    counts = objects[Object.QUICK_STOP_DECELERATION, 0]
    return float(max(1, counts) / drive.counts_per_radian)
