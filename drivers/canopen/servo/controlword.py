"""Next controlword (6040h) of a servo drive, by its state and by what is wanted of it."""

from ....protocols.canopen import cia402
from ....protocols.canopen.cia402 import Controlword, DriveState


def next_word(
    state: DriveState | None,
    target: DriveState,
    *,
    stopped: bool,
    overdue: bool,
    reset: bool | None,
) -> int:
    """Return the controlword on the way from `state` (None: not known) to `target`.

    A drive that is `stopped` gets a quick stop. `reset` of a fault: None without one, False while
    bit 7 is still low, True for its rising edge. A quick stop that stays (605Ah of 5 to 8) ends
    once switching off is `overdue`.
    """
    if stopped:
        return Controlword.QUICK_STOP
    if state is None:
        return Controlword.DISABLE_VOLTAGE
    if reset is not None and state.in_fault:
        return Controlword.FAULT_RESET if reset else Controlword.DISABLE_VOLTAGE
    if state is DriveState.QUICK_STOP_ACTIVE and overdue:
        return Controlword.DISABLE_VOLTAGE
    return cia402.next_controlword(state, target)
