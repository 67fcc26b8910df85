"""The rig at the pace of the wall clock, for a daemon in another process.

Physics follows the bus. When this process was late and several SYNCs wait, up to one SYNC period
of physics passes between two of them, so that setpoints keep their spacing in physics time; and so
does what was lost between two SYNCs, or an arm would seem to stop and jump. Time that was lost
otherwise is skipped and counted, never made up in a burst.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

from ...protocols.can301 import SYNC_ID
from ...protocols.moving import RigMotion
from ...protocols.rig import RigFault, RigTruth
from .rig import Rig

TRUTH_PERIOD_S = 0.01


class Judge(Protocol):
    """Who injects faults and is told the truth; `RigSession` is one."""

    def faults(self) -> Iterable[RigFault | RigMotion]:
        """Return the faults and motions that came in."""
        ...

    def publish(self, truth: RigTruth) -> None:
        """Take the truth."""
        ...


@dataclass
class Pace:
    """What `run_realtime` did: steps made, steps of wall time skipped, faults refused."""

    steps: int = 0
    skipped: int = 0
    refused: int = 0


def run_realtime(
    rig: Rig,
    stop: Callable[[], bool],
    judge: Judge | None = None,
    *,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
    on_refused: Callable[[str], None] | None = None,
) -> Pace:
    """Run the rig until `stop()`, one physics step per `rig.dt` of `clock` [s].

    `on_refused` is told, in one line, why a fault was not injected. Raises `RigError` when another
    rig is on the bus.
    """
    pace = Pace()
    deadline = clock()
    next_truth_s = rig.time_s
    while not stop():
        deadline = _handle_backlog(rig, pace, deadline, clock)
        if judge is not None:
            for fault in judge.faults():
                _inject(rig, fault, pace, on_refused)
        rig.step()
        pace.steps += 1
        if judge is not None and rig.time_s >= next_truth_s:
            judge.publish(rig.truth())
            next_truth_s = rig.time_s + TRUTH_PERIOD_S - rig.dt / 2
        deadline += rig.dt
        late = clock() - deadline
        if late < 0:
            sleep(-late)
        elif late > rig.period_s:
            missed = int(late / rig.dt)
            pace.skipped += missed
            deadline += missed * rig.dt
    return pace


def _handle_backlog(rig: Rig, pace: Pace, deadline: float, clock: Callable[[], float]) -> float:
    """Handle all frames that wait; return the deadline after the steps that this took."""
    while (message := rig.receive()) is not None:
        if message.arbitration_id == SYNC_ID and rig.sync_stamps:
            due = rig.sync_stamps[-1] + rig.period_s - rig.dt / 2
            while rig.time_s < due and clock() - deadline >= rig.dt:
                rig.step()
                pace.steps += 1
                deadline += rig.dt
        rig.handle(message)
    return deadline


def _inject(
    rig: Rig, fault: RigFault | RigMotion, pace: Pace, on_refused: Callable[[str], None] | None
) -> None:
    try:
        rig.inject(fault)
    except ValueError as error:
        pace.refused += 1
        if on_refused is not None:
            on_refused(str(error))
