"""Compare what one drive holds with the cell's table of it, in the joint's units."""

from collections.abc import Iterator
from typing import Final

from ....config.load import Cell
from ....config.schema.mechanism import DriveSection
from ....protocols.canopen import cia402
from ....protocols.canopen.can301 import CommunicationObject as Com
from ....protocols.canopen.can301 import FrameError, emcy_name
from ....protocols.canopen.cia402 import SPAN, DriveState, Object, OperationMode
from ..findings import Finding, Severity
from .scan import FoundNode

LIMIT: Final = 1e-3
"""607Dh and the cell's limits are the same within this [rad]."""
TORQUE: Final = 0.01
"""6076h and `rated_torque` are the same within this part [1]."""
_UNBOUNDED: Final = SPAN - 2
_OFF: Final = (
    DriveState.NOT_READY, DriveState.SWITCH_ON_DISABLED, DriveState.READY_TO_SWITCH_ON,
)  # fmt: skip


def compare(cell: Cell, name: str, drive: DriveSection, found: FoundNode) -> Iterator[Finding]:
    """Judge a drive's state, mode, position, position limits and torques."""
    joint = next(j for j in cell.robot.joints if j.name == drive.joint)
    endless = drive.joint in cell.config.mechanism.wheels
    yield _state(name, found)
    yield _mode(name, found, OperationMode[cell.config.mechanism.mode_of(drive).upper()])
    if not endless:
        yield _position(name, drive, found, joint.lower, joint.upper)
        yield _limits(name, drive, found, joint.lower, joint.upper)
    yield _torque(name, drive, found)


def _radians(drive: DriveSection, counts: int) -> float:
    return drive.zero_rad + drive.direction * counts / drive.counts_per_radian


def _state(name: str, found: FoundNode) -> Finding:
    word, code = found.get(Object.STATUSWORD), found.get(Object.ERROR_CODE) or 0
    check = f"{name} state"
    if word is None:
        return Finding(check, Severity.ERROR, "6041h cannot be read: is it a CiA 402 drive?")
    try:
        state = cia402.decode_state(word)
    except FrameError as error:
        return Finding(check, Severity.ERROR, str(error), {"statusword": word})
    text = state.name.lower().replace("_", " ")
    status = Severity.OK
    if state.in_fault or code:
        status, text = Severity.WARN, f"{text}, 603Fh {code:04X}h: {emcy_name(code)}"
    elif state not in _OFF:
        status, text = Severity.ERROR, f"{text}: its power is on, and nobody here has asked for it"
    register = found.get(Com.ERROR_REGISTER) or 0
    return Finding(check, status, text, {"statusword": word, "code": code, "register": register})


def _mode(name: str, found: FoundNode, mode: OperationMode) -> Finding:
    supported = found.get(Object.SUPPORTED_MODES)
    check = f"{name} mode"
    if supported is None:
        return Finding(check, Severity.ERROR, "6502h cannot be read: no mode is known")
    has = cia402.supports_mode(supported, mode)
    text = f"{mode.name} {'is' if has else 'is not'} among its modes, 6502h {supported:#x}"
    status = Severity.OK if has else Severity.ERROR
    return Finding(check, status, text, {"supported": supported})


def _position(
    name: str, drive: DriveSection, found: FoundNode, lower: float, upper: float
) -> Finding:
    check = f"{name} position"
    counts = found.get(Object.POSITION_ACTUAL)
    if counts is None:
        return Finding(check, Severity.ERROR, "6064h cannot be read")
    angle = _radians(drive, counts)
    text = f"{angle:.4f} rad ({counts} counts), limits {lower:.4g} to {upper:.4g}"
    inside = lower - LIMIT <= angle <= upper + LIMIT
    if not inside:
        text += ": is counts_per_radian, direction or zero_rad wrong?"
    status = Severity.OK if inside else Severity.ERROR
    return Finding(check, status, text, {"counts": counts, "angle": angle})


def _limits(
    name: str, drive: DriveSection, found: FoundNode, lower: float, upper: float
) -> Finding:
    check = f"{name} 607Dh"
    low, high = (found.get(Object.POSITION_LIMIT, sub) for sub in (1, 2))
    if low is None or high is None:
        text = "cannot be read; the daemon writes it before it enables the drive"
        return Finding(check, Severity.ERROR, text)
    ends = sorted((_radians(drive, low), _radians(drive, high)))
    values = {"lower": ends[0], "upper": ends[1]}
    if low >= high or high - low >= _UNBOUNDED:
        text = f"holds no limits; the daemon will write {lower:.4g} to {upper:.4g} rad"
        return Finding(check, Severity.OK, text, values)
    off = max(abs(ends[0] - lower), abs(ends[1] - upper))
    text = f"{ends[0]:.4g} to {ends[1]:.4g} rad"
    if off <= LIMIT:
        return Finding(check, Severity.OK, text, values)
    text += (
        f", the cell says {lower:.4g} to {upper:.4g}: which of them is right, or is the "
        "joint's scale wrong? The daemon writes the cell's"
    )
    return Finding(check, Severity.ERROR, text, values)


def _torque(name: str, drive: DriveSection, found: FoundNode) -> Finding:
    check = f"{name} torque"
    rated, most = found.get(Object.RATED_TORQUE), found.get(Object.MAX_TORQUE)
    if not rated:
        text = "6076h cannot be read: what 6077h calls 1000 has to come from the data sheet"
        return Finding(check, Severity.WARN, text)
    torque = rated * 1e-3
    values = {"rated": torque, "max_per_mille": most}
    text = f"6076h {torque:g} N·m, the cell's rated_torque {drive.rated_torque:g} at the joint"
    status = Severity.OK
    if abs(torque - drive.rated_torque) > TORQUE * drive.rated_torque:
        status = Severity.WARN
        text += f": right behind a gear of {drive.rated_torque / torque:.4g}, and of no other"
    bound = None if most is None else most * 1e-3 * drive.rated_torque
    if bound is not None and bound < drive.max_torque * (1.0 - TORQUE):
        status = Severity.WARN
        text += f"; 6072h stops at {bound:.4g} N·m, below max_torque {drive.max_torque:g}"
    return Finding(check, status, text, values)
