"""From the objects of a simulated drive to the reference and the bounds of its loop."""

from typing import Final

from ....config.schema.mechanism import Drive
from ....protocols.canopen.cia402 import Object, OperationMode
from .drive_loops import DriveLoops
from .objects import ObjectStore

_UNLIMITED: Final = 0xFFFFFFFF


def follow(mode: int, objects: ObjectStore, loop: DriveLoops, joint: int, drive: Drive) -> bool:
    """Follow the newest setpoint of the mode; return whether the drive's limits cut it."""
    scale = drive.direction * drive.counts_per_radian
    if mode == OperationMode.CSP:
        counts = objects[Object.TARGET_POSITION, 0]
        low, high = objects[Object.POSITION_LIMIT, 1], objects[Object.POSITION_LIMIT, 2]
        kept = min(max(counts, low), high)
        value = objects[Object.INTERPOLATION_PERIOD, 1]
        period_s = value * 10.0 ** objects[Object.INTERPOLATION_PERIOD, 2]
        return loop.aim(joint, drive.zero_rad + kept / scale, period_s) or kept != counts
    if mode == OperationMode.CSV:
        counts = objects[Object.TARGET_VELOCITY, 0] + objects[Object.VELOCITY_OFFSET, 0]
        return loop.run(joint, counts / scale)
    share = (objects[Object.TARGET_TORQUE, 0] + objects[Object.TORQUE_OFFSET, 0]) * 1e-3
    return loop.pull(joint, share * drive.direction * drive.rated_torque)


def tune(mode: int, objects: ObjectStore, loop: DriveLoops, joint: int, drive: Drive) -> None:
    """Take over the following window of the mode, and the torque offset."""
    loop.window[joint] = window(mode, objects, drive)
    share = objects[Object.TORQUE_OFFSET, 0] * 1e-3
    loop.offset[joint] = share * drive.direction * drive.rated_torque


def window(mode: int, objects: ObjectStore, drive: Drive) -> float:
    """Return the following error that is too much [rad]; only a position setpoint has any."""
    counts = objects[Object.FOLLOWING_WINDOW, 0]
    if mode != OperationMode.CSP or counts == _UNLIMITED:
        return float("inf")
    return counts / drive.counts_per_radian


def deceleration(objects: ObjectStore, drive: Drive) -> float:
    """Return the quick stop's ramp [rad/s²]."""
    counts = objects[Object.QUICK_STOP_DECELERATION, 0]
    return float(max(1, counts) / drive.counts_per_radian)
