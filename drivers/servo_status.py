"""Status of a servo drive, its last setpoint, and which statuswords are wrong."""

from typing import Final, NamedTuple, Self

from ..protocols.canopen import can301
from ..protocols.canopen.can301 import EmcyCode
from ..protocols.canopen.cia402 import DriveState, Status
from .device import Cause, Trouble

MOST_MISSED_SYNCS: Final = 3
"""More SYNCs than this without an answer mean that the drive is lost."""
RESET_SYNCS: Final = 25
"""A fault reset that has not worked after this many SYNCs is given up."""
OBEYED_SYNCS: Final = 3
"""A drive's setpoint takes effect at the next SYNC; the one after samples it, and that answer may
be counted as one to the SYNC after it: only from here on a statusword is about it."""
SWITCH_OFF_S: Final = 1.0
"""A drive that is still on, or in its quick stop, so long after it was told to switch off does not
do it by itself: closing a brake and a quick stop's ramp take less [s]."""


class ServoReading(NamedTuple):
    """Last status of the drive. Until its first TPDO there is none: `ready` is false."""

    ready: bool
    fresh: bool
    """It answered the newest SYNC."""
    age_syncs: int
    """SYNCs sent since the one that it last answered."""
    sampled_s: float | None
    """When it sampled, at the SYNC that it answered [s], on `Fieldbus.clock`; None: not
    known. Stamps of the bus have another clock."""
    position_rad: float | None
    torque_nm: float | None
    velocity_rad_s: float | None
    """None: TPDO1 has no room for it."""
    state: DriveState | None
    """None also when the statusword means no state."""
    obeyed: bool
    """The state was sampled after what the drive was last told to do took effect."""
    statusword: int
    trouble: Trouble | None

    @classmethod
    def of_none(cls, age_syncs: int, trouble: Trouble | None) -> Self:
        """Return the reading of a drive that has not answered yet."""
        return cls(False, False, age_syncs, None, None, None, None, None, False, 0, trouble)


class Sent(NamedTuple):
    """Setpoint that `write` really sent; None while the drive's position is not known."""

    controlword: int
    raw: int | None
    """The setpoint as it went out, in the drive's own unit."""
    command: float | None
    """The same in the joint's: rad, rad/s or N·m."""


def wrong_emergency(code: int) -> tuple[Cause, str, dict[str, str | int]]:
    """Return cause, words and values of an emergency message."""
    followed = code == EmcyCode.FOLLOWING_ERROR
    name = can301.emcy_name(code)
    cause = Cause.FOLLOWING_ERROR if followed else Cause.EMERGENCY
    return cause, f"emergency {code:#06x}: {name}", {"code": code, "name": name}


def wrong_status(
    word: int, state: DriveState | None, *, meant: bool, overdue: bool
) -> tuple[Cause, str] | None:
    """Return what is wrong with a statusword that means `state`, or None.

    `meant`: the drive is to be in *Operation enabled*, and was. `overdue`: it should long be off.
    """
    if state is None:
        return Cause.STATE_LOST, f"statusword {word:#06x} means no state"
    if word & Status.FOLLOWING_ERROR and (meant or state.in_fault):
        return Cause.FOLLOWING_ERROR, "following error beyond 6065h"
    if state.in_fault:
        return Cause.DRIVE_FAULT, state.name.lower()
    if meant and not word & Status.VOLTAGE_ENABLED:
        return Cause.POWER_LOST, "no voltage on the power stage"
    if meant and state is not DriveState.OPERATION_ENABLED:
        return Cause.STATE_LOST, f"left operation_enabled for {state.name.lower()} unasked"
    if overdue and state is DriveState.OPERATION_ENABLED:
        return Cause.STATE_LOST, "stays in operation_enabled, told to switch off"
    return None
