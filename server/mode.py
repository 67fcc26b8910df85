"""The daemon's modes, and the one pure function that changes them.

BOOT → READY → ENABLED ⇄ (STOPPING →) HOLD → READY,   FAULT from anywhere, left by reset
"""

from enum import StrEnum
from typing import NamedTuple


class Mode(StrEnum):
    """Mode of the daemon."""

    BOOT = "boot"
    """Devices are being configured; drives are off."""
    READY = "ready"
    """Drives are off and healthy, joints are read."""
    ENABLED = "enabled"
    """Sources and goals move the arm."""
    STOPPING = "stopping"
    """The verified stop runs out."""
    HOLD = "hold"
    """Drives are on and stand still."""
    FAULT = "fault"
    """Drives were quick-stopped."""

    def __init__(self, name: str) -> None:
        self.energised = name in ("enabled", "stopping", "hold")
        """Drives are meant to be in Operation enabled."""


class PendingAction(StrEnum):
    """An action that an operator has asked for and that is under way."""

    NONE = "none"
    ENABLE = "enable"
    DISABLE = "disable"
    RESET = "reset"


class ModeInputs(NamedTuple):
    """Inputs of a mode change, at one tick."""

    action: PendingAction
    hold: bool
    """An operator asks for HOLD now."""
    resume: bool
    """An operator asks to go on now."""
    open: bool
    """All devices are configured and heard."""
    healthy: bool
    """No cause for a quick stop is present."""
    drives_enabled: bool
    drives_off: bool
    may_move: bool
    """The lease is alive, no protective stop, essential sensors fresh, the loop in time."""
    at_rest: bool


def next_mode(mode: Mode, s: ModeInputs) -> Mode:
    """Return the mode after one tick in situation `s`."""
    if mode is Mode.FAULT:
        reset = s.action is PendingAction.RESET and s.open and s.healthy and s.drives_off
        return Mode.READY if reset else Mode.FAULT
    if not s.healthy:
        return Mode.FAULT
    match mode:
        case Mode.BOOT:
            return Mode.READY if s.open else Mode.BOOT
        case Mode.READY:
            go = s.action is PendingAction.ENABLE and s.drives_enabled and s.may_move
            return Mode.ENABLED if go else Mode.READY
        case Mode.ENABLED:
            stay = s.may_move and not s.hold and s.action is not PendingAction.DISABLE
            return Mode.ENABLED if stay else Mode.STOPPING
        case Mode.STOPPING:
            return Mode.HOLD if s.at_rest else Mode.STOPPING
        case Mode.HOLD:
            if s.action is PendingAction.DISABLE:
                return Mode.READY
            return Mode.ENABLED if s.resume and s.may_move and not s.hold else Mode.HOLD
