"""All rules tried on one drive, one after the other.

The drive stands, with its power off; nothing is asked to move. Rules that need power are tried only
when the caller says so. After each rule the drive gets everything back that was written.
"""

from collections.abc import Callable, Iterator
from typing import Final

from ....drivers.device import DeviceError
from ....drivers.fieldbus import Fieldbus
from ....protocols.canopen.can301 import FrameError
from ....protocols.canopen.cia402 import DriveState
from .communication import COMMUNICATION
from .power_off import POWER_OFF
from .power_on import POWER_ON
from .rule import Rule, RuleOutcome, RuleVerdict
from .tried_drive import AbsentError, BrokenError, TriedDrive

QUIET_S: Final = 0.5
"""A control server is heard within so long [s]."""
_POWER_IS_OFF: Final = (
    DriveState.NOT_READY, DriveState.SWITCH_ON_DISABLED, DriveState.READY_TO_SWITCH_ON,
)  # fmt: skip


def rules(*, power: bool) -> tuple[Rule, ...]:
    """Return the rules that are tried, with those that need power or without."""
    return (*COMMUNICATION, *POWER_OFF, *(POWER_ON if power else ()))


def try_drive(fieldbus: Fieldbus, node: int, *, power: bool) -> Iterator[RuleVerdict]:
    """Try every rule on one node.

    Raises `DeviceError` where another master is heard, the node does not answer, or is on.
    """
    subject = TriedDrive(fieldbus, node)
    subject.until(lambda: fieldbus.trouble is not None, QUIET_S)
    if fieldbus.trouble is not None:
        raise DeviceError(f"{fieldbus.name}: {fieldbus.trouble.detail}: a control server is on it")
    try:
        state = subject.state
    except (BrokenError, FrameError) as error:
        raise DeviceError(f"node {node}: {error}") from error
    if state not in _POWER_IS_OFF:
        raise DeviceError(f"node {node}: is in {state.name}: rules are tried on one that is off")
    subject.restart()
    for rule in rules(power=power):
        yield _tried(rule, subject)


def _tried(rule: Rule, subject: TriedDrive) -> RuleVerdict:
    try:
        outcome, detail = _outcome(rule.judge, subject)
    finally:
        subject.put_back()
    return RuleVerdict(rule, outcome, detail)


def _outcome(judge: Callable[[TriedDrive], None], subject: TriedDrive) -> tuple[RuleOutcome, str]:
    try:
        judge(subject)
    except AbsentError as error:
        return RuleOutcome.ABSENT, str(error)
    except (BrokenError, DeviceError, FrameError) as error:
        return RuleOutcome.BROKEN, str(error)
    return RuleOutcome.KEPT, ""
