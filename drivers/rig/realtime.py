"""The rig at the pace of the wall clock, for a daemon in another process.

Physics follows the bus: what a frame finds is the state of the instant at which it was sent,
however late this process comes to see it, so that samples and setpoints keep their spacing in
physics time. Between frames it sleeps until a node has something to send, and makes the steps up to
then at once: waking up costs more than a step. More time that was lost is skipped and counted,
never made up in a burst.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import can

from ...config.load import Cell
from ...config.schema.bus import CanOpenNodeSection
from ...protocols.canopen import can301
from ...protocols.messages.perception import RigMotion
from ...protocols.messages.rig import RigFault, RigTruth
from ..bus import Frame
from ..device import DeviceError
from ..fieldbus import POLL_S
from .rig import Rig

TRUTH_PERIOD_S = 0.01
LATE_PERIODS = 2
"""Lateness of so many SYNC periods is made up when no frame waits, more is skipped [1]."""
MOST_ASLEEP_S = 0.005
"""Faults and the order to end are looked for at least so often [s]."""
GATHER_PART = 0.1
"""Frames that follow one another are waited for so long at most [SYNC periods]."""
MOST_PERIODS = 5
"""No more is made up for a SYNC; a frame that seems older has just come [SYNC periods]."""


LISTEN_PERIODS = 2
"""Another rig is listened for so long before this one starts [heartbeat periods]."""


def refuse_second(cell: Cell, buses: Sequence[can.BusABC]) -> None:
    """Raise `DeviceError` where a node of the cell speaks already: this rig would make it two.

    Only before it starts: later, a frame in a node's name may be anybody's, and ends nothing.
    """
    places = [config.name for config in cell.config.fieldbuses]
    speaks = {
        (entry.bus, base(entry.section.node)): entry.section.node
        for entry in cell.devices
        if isinstance(entry.section, CanOpenNodeSection)
        for base in (can301.heartbeat_id, can301.tpdo1_id)
    }
    end_s = time.monotonic() + LISTEN_PERIODS * cell.config.timing.heartbeat_period_s
    while time.monotonic() < end_s:
        for name, bus in zip(places, buses, strict=True):
            while (message := bus.recv(0)) is not None:
                node = speaks.get((name, message.arbitration_id))
                if node is not None:
                    raise DeviceError(f"node {node} speaks on {name}: another rig, or an arm?")
        time.sleep(POLL_S)


class FaultSource(Protocol):
    """Who injects faults and is told the truth; `RigSession` is one."""

    def faults(self) -> Iterable[RigFault | RigMotion]:
        """Return the faults and motions that came in."""
        ...

    @property
    def heard(self) -> bool:
        """Whether the truth is wanted now."""
        ...

    def publish(self, truth: RigTruth) -> None:
        """Take the truth."""
        ...


@dataclass
class Pace:
    """Result of `run_realtime`: steps made, steps of wall time skipped, faults refused, and frames
    of others in the name of the rig's own nodes."""

    steps: int = 0
    skipped: int = 0
    refused: int = 0
    foreign: int = 0


def run_realtime(
    rig: Rig,
    stop: Callable[[], bool],
    judge: FaultSource | None = None,
    *,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
    wait: Callable[[Rig, float], None] = Rig.wait,
    stamping: Callable[[], float] = time.time,
    tell: Callable[[str], None] | None = None,
) -> Pace:
    """Run the rig until `stop()`, one physics step per `rig.dt` of `clock` [s].

    `wait` blocks until a frame may have come, for so long at most [s]; after frames others follow,
    for which it `sleep`s a physics step, or less where the next SYNC comes soon.
    `stamping` is the clock of the stamps of the bus [s]; stamps of another one are no use.
    `tell` is told, in one line, why a fault was not injected, and of a node that somebody else
    sends for, which ends nothing: whoever is fooled by it is to notice.
    """
    pace = Pace()

    def gather(_rig: Rig, seconds: float) -> None:
        sleep(min(seconds, rig.dt, GATHER_PART * rig.period_s))

    deadline = wake_s = clock()
    next_truth_s = rig.time_s
    while True:
        asleep = wait
        while (heard := rig.receive()) is not None:
            wire, frame = heard
            asleep = gather
            sent_s = clock() - _age(frame, rig, stamping)
            deadline = _catch_up(rig, pace, deadline, sent_s)
            rig.handle(wire, frame, min(max(sent_s - deadline, -rig.dt), rig.dt))
            if wire.stranger is not None:
                pace.foreign += 1
                if tell is not None:
                    tell(f"another node {wire.stranger} is on {wire.name}: does a second rig run?")
                wire.stranger = None
        now_s = clock()
        late = now_s - max(wake_s, deadline)
        if late > LATE_PERIODS * rig.period_s:
            missed = int(late / rig.dt)
            pace.skipped += missed
            deadline += missed * rig.dt
        if judge is not None:
            for fault in judge.faults():
                _inject(rig, fault, pace, tell)
        while deadline <= now_s:
            rig.step()
            pace.steps += 1
            deadline += rig.dt
            if judge is not None and rig.time_s >= next_truth_s and judge.heard:
                judge.publish(rig.truth())
                next_truth_s = rig.time_s + TRUTH_PERIOD_S - rig.dt / 2
        wake_s = deadline + min(max(rig.due_s - rig.time_s, 0.0), MOST_ASLEEP_S)
        if stop():
            return pace
        asleep(rig, max(0.0, wake_s - clock()))


def _age(frame: Frame, rig: Rig, stamping: Callable[[], float]) -> float:
    """Return how long a frame has waited [s], 0 when its stamp does not tell."""
    age = stamping() - frame[2]
    return age if 0.0 < age <= MOST_PERIODS * rig.period_s else 0.0


def _catch_up(rig: Rig, pace: Pace, deadline: float, until_s: float) -> float:
    """Step until `until_s` on the clock is less than a step away; return the new deadline."""
    if until_s - deadline > MOST_PERIODS * rig.period_s:
        return deadline
    while until_s - deadline >= rig.dt:
        rig.step()
        pace.steps += 1
        deadline += rig.dt
    return deadline


def _inject(
    rig: Rig, fault: RigFault | RigMotion, pace: Pace, tell: Callable[[str], None] | None
) -> None:
    try:
        rig.inject(fault)
    except ValueError as error:
        pace.refused += 1
        if tell is not None:
            tell(f"fault refused: {error}")
