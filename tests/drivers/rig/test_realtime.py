"""The rig at the pace of a clock, told by a clock that the test moves."""

from collections.abc import Callable
from itertools import pairwise

import can
from telerobot.drivers.rig.realtime import Pace, run_realtime
from telerobot.protocols import can301
from telerobot.protocols.rig import RigFault, RigTruth

from .conftest import Master


class Clock:
    """Stands still unless it is slept on, or moved."""

    def __init__(self) -> None:
        self.time_s = 100.0

    def now(self) -> float:
        return self.time_s

    def sleep(self, seconds: float) -> None:
        self.time_s += seconds


class Listener:
    """Collects truths; has faults to inject."""

    def __init__(self, *faults: RigFault) -> None:
        self.waiting = list(faults)
        self.truths: list[RigTruth] = []

    def faults(self) -> list[RigFault]:
        waiting, self.waiting = self.waiting, []
        return waiting

    def publish(self, truth: RigTruth) -> None:
        self.truths.append(truth)


def after(clock: Clock, seconds: float) -> Callable[[], bool]:
    end = clock.time_s + seconds - 1e-6
    return lambda: clock.time_s >= end


def sync(master: Master) -> None:
    """Leave a SYNC on the bus for the rig to find."""
    master.bus.send(_frame(can301.SYNC_ID))


def _frame(can_id: int) -> can.Message:
    return can.Message(arbitration_id=can_id, data=b"", is_extended_id=False)


def run(master: Master, clock: Clock, seconds: float, judge: Listener | None = None) -> Pace:
    return run_realtime(
        master.rig, after(clock, seconds), judge, clock=clock.now, sleep=clock.sleep
    )


def test_physics_time_keeps_to_the_clock(master: Master) -> None:
    pace = run(master, Clock(), 0.5)
    assert abs(master.rig.time_s - 0.5) < 2e-3
    assert pace.skipped == 0


def test_lost_time_is_skipped_and_counted(master: Master) -> None:
    clock = Clock()
    run(master, clock, 0.1)
    before = master.rig.time_s
    steps = iter(range(10_000))

    def stall_once(seconds: float) -> None:
        clock.time_s += 0.3 if next(steps) == 10 else seconds

    pace = run_realtime(master.rig, after(clock, 0.5), None, clock=clock.now, sleep=stall_once)
    assert 295 <= pace.skipped <= 300
    assert 0.19 < master.rig.time_s - before < 0.21


def test_a_stall_between_two_syncs_is_made_up(master: Master) -> None:
    """Or the arm would seem to stop, and its drives to push it."""
    clock = Clock()
    steps = iter(range(10_000))

    def stall_once(seconds: float) -> None:
        clock.time_s += 0.009 if next(steps) == 10 else seconds

    pace = run_realtime(master.rig, after(clock, 0.1), None, clock=clock.now, sleep=stall_once)
    assert pace.skipped == 0
    assert abs(master.rig.time_s - 0.1) < 2e-3


def test_syncs_in_the_backlog_keep_their_spacing_in_physics_time(master: Master) -> None:
    clock = Clock()
    run(master, clock, 0.05)
    sync(master)
    run(master, clock, 0.002)
    stamps = iter(range(10_000))

    def stall_once(seconds: float) -> None:
        if next(stamps) == 3:
            clock.time_s += 0.045
            for _ in range(4):
                sync(master)
        else:
            clock.time_s += seconds

    run_realtime(master.rig, after(clock, 0.1), None, clock=clock.now, sleep=stall_once)
    spacing = [b - a for a, b in pairwise(master.rig.sync_stamps)]
    assert [round(s, 6) for s in spacing] == [0.01] * 4


def test_a_judge_is_told_the_truth_every_ten_milliseconds_and_may_inject(master: Master) -> None:
    clock = Clock()
    judge = Listener(RigFault(kind="silence", target="e1"), RigFault(kind="drop", target="nobody"))
    pace = run(master, clock, 1.0, judge)
    assert 99 <= len(judge.truths) <= 101
    assert master.rig.drives["e1"].link.silent
    assert pace.refused == 1
