"""The rig at the pace of a clock, told by a clock that the test moves."""

from collections.abc import Callable
from itertools import pairwise

import can
import numpy as np
import pytest
from telerobot.config.load import Cell
from telerobot.drivers.rig.realtime import Pace, run_realtime
from telerobot.protocols.canopen import can301, cia402
from telerobot.protocols.canopen.can301 import NmtState
from telerobot.protocols.canopen.cia402 import OperationMode
from telerobot.protocols.messages.rig import RigFault, RigTruth

from .conftest import PACK, Master


class Clock:
    """Stands still unless it is slept on, or moved."""

    def __init__(self) -> None:
        self.time_s = 100.0

    def now(self) -> float:
        return self.time_s

    def sleep(self, seconds: float) -> None:
        self.time_s += seconds


def waiting(sleep: Callable[[float], None]) -> Callable[[object, float], None]:
    """Wait for frames as one who is not woken up by any."""
    return lambda _rig, seconds: sleep(seconds)


class Listener:
    """Collects truths; has faults to inject."""

    def __init__(self, *faults: RigFault) -> None:
        self.waiting = list(faults)
        self.heard, self.truths = True, list[RigTruth]()

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


def _frame(can_id: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


def run(master: Master, clock: Clock, seconds: float, judge: Listener | None = None) -> Pace:
    return run_realtime(
        master.rig,
        after(clock, seconds),
        judge,
        clock=clock.now,
        sleep=clock.sleep,
        wait=waiting(clock.sleep),
    )


def test_physics_time_keeps_to_the_clock(master: Master) -> None:
    pace = run(master, Clock(), 0.5)
    assert abs(master.rig.time_s - 0.5) < 2e-3
    assert pace.skipped == 0


@pytest.mark.parametrize("period_s", [0.01, 0.001])
def test_after_a_frame_it_sleeps_for_a_tenth_of_a_period_at_most(
    master: Master, period_s: float
) -> None:
    """Or a SYNC that comes soon is answered too late for its tick."""
    clock, slept = Clock(), list[float]()
    master.rig.period_s = period_s
    sync(master)

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        clock.sleep(seconds)

    run_realtime(
        master.rig,
        after(clock, 0.02),
        None,
        clock=clock.now,
        sleep=sleep,
        wait=waiting(clock.sleep),
    )
    assert 0.0 < max(slept) <= 0.1 * period_s


def test_lost_time_is_skipped_and_counted(master: Master) -> None:
    clock = Clock()
    run(master, clock, 0.1)
    before = master.rig.time_s
    steps = iter(range(10_000))

    def stall_once(seconds: float) -> None:
        clock.time_s += 0.3 if next(steps) == 10 else seconds

    pace = run_realtime(
        master.rig,
        after(clock, 0.5),
        None,
        clock=clock.now,
        sleep=stall_once,
        wait=waiting(stall_once),
    )
    assert 290 <= pace.skipped <= 300
    assert 0.19 < master.rig.time_s - before < 0.21


def test_a_stall_between_two_syncs_is_made_up(master: Master) -> None:
    """Or the arm would seem to stop, and its drives to push it."""
    clock = Clock()
    steps = iter(range(10_000))

    def stall_once(seconds: float) -> None:
        clock.time_s += 0.009 if next(steps) == 10 else seconds

    pace = run_realtime(
        master.rig,
        after(clock, 0.1),
        None,
        clock=clock.now,
        sleep=stall_once,
        wait=waiting(stall_once),
    )
    assert pace.skipped == 0
    assert abs(master.rig.time_s - 0.1) < 2e-3


def test_the_rig_sleeps_until_a_node_has_something_to_send_and_sends_it_then(
    master: Master,
) -> None:
    """Waking up costs more than a physics step."""
    clock, slept = Clock(), list[float]()

    def wait(seconds: float) -> None:
        slept.append(seconds)
        master.bus.hub.time_s = clock.time_s = clock.time_s + seconds

    beat_ms = 32
    master.write("s1", can301.CommunicationObject.PRODUCER_HEARTBEAT, 0, "<H", beat_ms)
    begun_s = clock.time_s
    run_realtime(
        master.rig,
        after(clock, 1.0),
        clock=clock.now,
        sleep=clock.sleep,
        wait=waiting(wait),
        stamping=clock.now,
    )
    beats = []
    while (message := master.bus.recv(0)) is not None:
        assert message.arbitration_id == can301.heartbeat_id(master.node("s1"))
        beats.append(message.timestamp - begun_s)
    np.testing.assert_allclose(np.diff(beats), beat_ms * 1e-3, atol=1.01 * master.rig.dt)
    assert len(beats) == 31
    assert len(slept) < 250


class Bus:
    """Sends SYNC, heartbeat and setpoints at instants of its own while the rig sleeps or stalls."""

    def __init__(self, master: Master, clock: Clock, at_s: list[float]) -> None:
        self._master, self._clock, self._at_s = master, clock, list(at_s)
        self.stall_s: dict[float, float] = {}
        """By when it begins, how long the rig sleeps more than it means to."""

    def sleep(self, seconds: float) -> None:
        for begin_s in [b for b in self.stall_s if b <= self._clock.time_s]:
            seconds += self.stall_s.pop(begin_s)
        until_s = self._clock.time_s + seconds
        while self._at_s and self._at_s[0] <= until_s:
            self._master.bus.hub.time_s = self._at_s.pop(0)
            self._cycle()
        self._clock.time_s = until_s

    def _cycle(self) -> None:
        master = self._master
        sync(master)
        master.bus.send(_frame(can301.heartbeat_id(127), bytes((NmtState.OPERATIONAL,))))
        for joint, target in master.targets.items():
            data = PACK[master.mode](master.words[joint], target)
            master.bus.send(_frame(can301.rpdo1_id(master.node(joint)), data))

    def run(self, until_s: float) -> Pace:
        clock = self._clock
        return run_realtime(
            self._master.rig,
            lambda: clock.time_s >= until_s,
            clock=clock.now,
            sleep=self.sleep,
            wait=waiting(self.sleep),
            stamping=clock.now,
        )


UNEVEN_S = [0.01, 0.0208, 0.0299, 0.0403, 0.05, 0.0637, 0.0644, 0.08, 0.0901, 0.1]


@pytest.mark.parametrize(
    "stalls", [{}, {0.022: 0.016}, {0.0301: 0.009, 0.055: 0.019}, {0.03: 0.04}]
)
def test_syncs_keep_their_spacing_in_physics_time_however_late_they_are_seen(
    master: Master, stalls: dict[float, float]
) -> None:
    clock = Clock()
    at_s = [clock.time_s + s for s in UNEVEN_S]
    bus = Bus(master, clock, at_s)
    bus.stall_s = {clock.time_s + begin_s: long_s for begin_s, long_s in stalls.items()}
    pace = bus.run(clock.time_s + 0.12)
    assert pace.skipped == 0
    found = [b - a for a, b in pairwise(master.rig.sync_stamps)]
    np.testing.assert_allclose(found, np.diff(at_s), atol=1e-9)


def test_a_sample_is_of_the_instant_of_its_sync(cell: Cell) -> None:
    """A millisecond of physics is a tenth of a period: an arm at 0.2 rad/s seems to jerk by it."""
    master = Master(cell)
    master.mode = OperationMode.CSV
    master.enable(lambda m: m.targets.update(dict.fromkeys(m.drives, 0)))
    speed = 0.2
    drive = master.drives["s1"]
    master.targets["s1"] = round(speed * drive.direction * drive.counts_per_radian)
    master.cycle(50)
    clock = Clock()
    jitter = np.random.default_rng(3).uniform(-2e-3, 2e-3, 40)
    at_s = [clock.time_s + 0.01 * k + float(late) for k, late in enumerate(jitter, 1)]
    bus = Bus(master, clock, at_s)
    bus.stall_s = {clock.time_s + 0.1: 0.012, clock.time_s + 0.2: 0.003}
    master.frames.clear()
    bus.run(at_s[-1] + 0.003)
    master.listen()
    wanted = can301.tpdo1_id(drive.node)
    samples = [cia402.unpack_feedback(data).position for _, i, data in master.frames if i == wanted]
    angles = np.array(samples) * drive.direction / drive.counts_per_radian
    off = angles - np.polyval(np.polyfit(at_s, angles, 1), at_s)
    assert np.abs(off).max() < 2e-5
    master.close()


def test_no_heartbeat_in_a_nodes_name_ends_the_rig(master: Master) -> None:
    """Not one of its nodes', nor any other: what it says is counted, and told."""
    clock, told = Clock(), list[str]()
    for can_id in (*range(can301.heartbeat_id(0), can301.heartbeat_id(128)), 0x701, 0x703):
        for data in (b"", b"\x00", b"\x05", bytes(8)):
            master.bus.send(_frame(can_id, data))
    pace = run_realtime(
        master.rig,
        after(clock, 0.2),
        clock=clock.now,
        sleep=clock.sleep,
        wait=waiting(clock.sleep),
        tell=told.append,
    )
    assert abs(master.rig.time_s - (clock.time_s - 100.0)) < 2e-3
    assert pace.foreign == len(told) == 4 * (len(master.drives) + 2)
    assert told[-1] == "another node 3 is on bus: does a second rig run?"


def test_a_judge_is_told_the_truth_every_ten_milliseconds_and_may_inject(master: Master) -> None:
    clock = Clock()
    judge = Listener(RigFault(kind="silence", target="e1"), RigFault(kind="drop", target="nobody"))
    pace = run(master, clock, 1.0, judge)
    assert 99 <= len(judge.truths) <= 101
    assert master.rig.drives["e1"].link.silent
    assert pace.refused == 1


def test_a_truth_that_nobody_hears_is_not_found_and_a_late_judge_gets_the_next(
    master: Master, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, judge, found = Clock(), Listener(), [0]
    truth = master.rig.truth

    def counted() -> RigTruth:
        found[0] += 1
        return truth()

    monkeypatch.setattr(master.rig, "truth", counted)
    judge.heard = False
    run(master, clock, 0.5, judge)
    assert found == [0]
    judge.heard = True
    run(master, clock, 0.02, judge)
    assert judge.truths
