"""Check of enabling where the joints stand, and of the drives' timeouts."""

from collections.abc import Iterator

from ...config.load import Cell
from ...drivers.canopen.servo_setup import SAG, Setpoint
from ...drivers.device import SWITCH_OFF_S
from ...protocols.canopen.cia402 import OperationMode
from .findings import Finding, Severity


def enabling(cell: Cell) -> Iterator[Finding]:
    """Judge the room of drives for a joint at its limit, and how long they take to let go."""
    drives = {d.joint: d for d in cell.config.mechanism.drives}
    for joint in cell.robot.joints:
        if joint.name in cell.config.mechanism.wheels:
            continue  # they have no limits
        drive = drives[joint.name]
        setpoint = Setpoint(drive, OperationMode.CSP)
        for angle in (joint.lower - drive.following_window, joint.upper + drive.following_window):
            try:
                setpoint.raw(angle)
            except ValueError as error:
                yield Finding(
                    f"{joint.name} room",
                    Severity.ERROR,
                    f"607Dh cannot reach a following window beyond the limit: {error}",
                    {"angle": angle, "counts_per_radian": drive.counts_per_radian},
                )
    tightest = min(drives.values(), key=lambda d: d.position_margin)
    margin, inside = tightest.position_margin, tightest.position_margin >= SAG
    judgement = "still inside its limit" if inside else "outside its limit, and only comes in"
    yield Finding(
        "enabling at a limit",
        Severity.OK if inside else Severity.WARN,
        f"position_margin of {tightest.joint} is {margin:g} rad: a joint that sags by {SAG:g} rad "
        f"when it is enabled is {judgement}",
        {"joint": tightest.joint, "position_margin": margin, "sag": SAG},
    )
    slowest = max(drives.values(), key=lambda d: d.max_velocity / d.quick_stop_deceleration)
    ramp_s = slowest.max_velocity / slowest.quick_stop_deceleration
    yield Finding(
        "switching off",
        Severity.OK if ramp_s < SWITCH_OFF_S else Severity.ERROR,
        f"{slowest.joint} takes {ramp_s:.2f} s to ramp down from full speed; a drive that is on "
        f"{SWITCH_OFF_S:.2f} s after it was told to switch off is a fault",
        {"joint": slowest.joint, "ramp_s": ramp_s, "patience_s": SWITCH_OFF_S},
    )
