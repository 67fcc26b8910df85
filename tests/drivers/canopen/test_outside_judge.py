"""canopen's own CiA 402 master, `BaseNode402`, on the simulated drive; and how setpoints act."""

import struct
from collections.abc import Iterator
from itertools import pairwise

import can
import canopen
import pytest
from canopen.profiles.p402 import BaseNode402
from telerobot.config.load import load_cell
from telerobot.drivers.rig.nodes.canopen import EDS
from telerobot.protocols.canopen import can301
from telerobot.protocols.canopen.can301 import CommunicationObject as Com
from telerobot.protocols.canopen.cia402 import Object, Status
from telerobot.protocols.messages.rig import RigFault

from ..rig.on_a_bus import OnABus

JOINT = "e1"
PERIOD_S = 0.01
CSP = "CYCLIC SYNCHRONOUS POSITION"


class Outside(canopen.Network):
    """canopen's network as it is, but for its thread: physics time passes when it sends."""

    def __init__(self, bench: OnABus) -> None:
        super().__init__()
        self._bench, self.dt = bench, bench.rig.dt

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        frame = can.Message(arbitration_id=can_id, data=bytes(data), is_extended_id=False)
        self._bench.bus.send(frame)
        self.listen()

    def listen(self, steps: int = 2) -> None:
        """Let physics steps pass, and hand over what was heard."""
        for _ in range(steps):
            self._bench.rig.poll()
            self._bench.rig.step()
        while (message := self._bench.bus.recv(0)) is not None:
            self.notify(message.arbitration_id, bytearray(message.data), self._bench.rig.time_s)


class PassingTime:
    """Stands where canopen waits for its thread to tell of a PDO: physics time passes, too."""

    def __init__(self, network: Outside, rpdo: canopen.pdo.PdoMap | None) -> None:
        self._network, self._rpdo = network, rpdo
        self._told = False

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...

    def notify_all(self) -> None:
        self._told = True

    def wait(self, timeout: float) -> None:
        self._told = False
        for step in range(round(timeout / self._network.dt)):
            if self._rpdo is not None and step % round(PERIOD_S / self._network.dt) == 0:
                self._network.send_message(can301.SYNC_ID, b"")
                self._rpdo.transmit()
            self._network.listen(1)
            if self._told:
                return


class Judge:
    """`BaseNode402` of one joint, with the drive's default PDOs or with synchronous ones."""

    def __init__(self, *, synchronous: bool = False) -> None:
        self.bench = OnABus(load_cell("pa10"))
        self.network = Outside(self.bench)
        self.id = self.bench.node(JOINT)
        self.node = BaseNode402(self.id, str(EDS))
        self.network.add_node(self.node)
        self.node.nmt.state = "PRE-OPERATIONAL"
        for pdo in (self.node.rpdo[1], self.node.tpdo[1]) if synchronous else ():
            pdo.read()
            pdo.trans_type = 1
            pdo.save()
        for pdo in self.node.tpdo.values():
            pdo.receive_condition = PassingTime(
                self.network, self.node.rpdo[1] if synchronous else None
            )
        self.node.setup_402_state_machine()
        self.node.nmt.state = "OPERATIONAL"
        self.drive = self.bench.rig.drives[JOINT]

    def cycle(self, periods: int) -> None:
        for _ in range(periods):
            self.network.send_message(can301.SYNC_ID, b"")
            self.network.listen(round(PERIOD_S / self.bench.rig.dt) - 2)

    def enable(self) -> None:
        self.node.op_mode = CSP
        self.node.state = "OPERATION ENABLED"

    @property
    def counts(self) -> int:
        return int(self.node.sdo[Object.POSITION_ACTUAL].raw)


@pytest.fixture
def judge() -> Iterator[Judge]:
    made = Judge()
    yield made
    made.bench.close()


@pytest.mark.parametrize("synchronous", [False, True])
def test_its_state_machine_goes_everywhere_and_back(synchronous: bool) -> None:
    judge = Judge(synchronous=synchronous)
    node = judge.node
    judge.enable()
    assert node.state == "OPERATION ENABLED"
    for state in ("SWITCHED ON", "OPERATION ENABLED", "READY TO SWITCH ON", "SWITCH ON DISABLED"):
        node.state = state
        assert node.state == state
    judge.bench.close()


def test_its_modes_are_those_that_the_drive_says(judge: Judge) -> None:
    node = judge.node
    for mode in (CSP, "CYCLIC SYNCHRONOUS VELOCITY", "CYCLIC SYNCHRONOUS TORQUE"):
        assert node.is_op_mode_supported(mode)
        node.op_mode = mode
        assert node.op_mode == mode
    assert not node.is_op_mode_supported("HOMING")


def test_it_resets_a_fault(judge: Judge) -> None:
    node = judge.node
    judge.enable()
    judge.bench.rig.inject(RigFault(kind="fault", target=JOINT))
    judge.network.listen()
    assert node.is_faulted()
    judge.bench.rig.inject(RigFault(kind="fault", target=JOINT, on=False))
    node.TIMEOUT_RESET_FAULT = 0.0  # it waits for an end that only comes with its next controlword
    node.reset_from_fault()
    assert node.state == "OPERATION ENABLED"


def test_it_reads_by_block_what_it_reads_in_segments(judge: Judge) -> None:
    name = judge.node.sdo[0x1008]
    with name.open("rb", block_transfer=True) as stream:
        assert stream.read() == name.raw.encode() == b"simulated servo drive"


@pytest.mark.parametrize(
    ("index", "value"),
    [
        (Object.MODE_OF_OPERATION, 99), (Object.MODE_OF_OPERATION, 1),
        (Object.QUICK_STOP_OPTION, 99), (Object.QUICK_STOP_DECELERATION, 0),
        (Object.ABORT_CONNECTION_OPTION, 4), (Object.MAX_TORQUE, 0xFFFF),
    ],
)  # fmt: skip
def test_a_value_out_of_range_is_refused_and_nothing_changes(
    judge: Judge, index: int, value: int
) -> None:
    before = judge.node.sdo[index].raw
    with pytest.raises(canopen.SdoAbortedError) as aborted:
        judge.node.sdo[index].raw = value
    assert aborted.value.code == 0x06090030
    assert judge.node.sdo[index].raw == before


def test_a_value_out_of_range_that_comes_by_pdo_is_not_taken(judge: Judge) -> None:
    judge.node.op_mode = CSP
    judge.network.send_message(0x300 + judge.id, struct.pack("<Hb", 0, 99))  # RPDO2: 6040h, 6060h
    assert judge.node.op_mode == CSP
    judge.network.send_message(0x300 + judge.id, struct.pack("<Hb", 0, 9))
    assert judge.node.op_mode == "CYCLIC SYNCHRONOUS VELOCITY"


def test_a_target_by_sdo_acts_at_the_next_sync(judge: Judge) -> None:
    judge.enable()
    judge.cycle(3)
    here = judge.counts
    step = round(0.002 * judge.bench.drives[JOINT].counts_per_radian)
    judge.node.sdo[Object.TARGET_POSITION].raw = here + step
    judge.network.listen(30)
    assert abs(judge.counts - here) < 0.05 * step
    judge.cycle(4)
    assert judge.counts - here == pytest.approx(step, rel=0.2)


def test_a_target_from_before_it_was_enabled_moves_nothing(judge: Judge) -> None:
    here = judge.counts
    judge.node.sdo[Object.TARGET_POSITION].raw = here + 50_000
    judge.cycle(2)
    judge.enable()
    judge.node.controlword = 0x0F  # RPDO1, the controlword alone
    judge.cycle(10)
    assert abs(judge.counts - here) < 2_000  # 1 mrad, as the brake opens


@pytest.mark.parametrize("timeout_ms", [20, 60])
def test_the_following_error_counts_beyond_its_window_and_after_its_timeout(
    judge: Judge, timeout_ms: int
) -> None:
    judge.enable()
    judge.cycle(3)
    node, here = judge.node, judge.counts
    window = round(0.01 * judge.bench.drives[JOINT].counts_per_radian)
    node.sdo[Object.FOLLOWING_WINDOW].raw = window
    node.sdo[Object.FOLLOWING_TIMEOUT].raw = timeout_ms
    judge.bench.rig.inject(RigFault(kind="block", target=JOINT))
    node.sdo[Object.TARGET_POSITION].raw = here + window // 2
    judge.cycle(20)
    assert not judge.drive.objects[Object.STATUSWORD, 0] & Status.FOLLOWING_ERROR
    inside = node.sdo[Object.FOLLOWING_ERROR].raw
    assert 0.3 * window < inside < window
    node.sdo[Object.TARGET_POSITION].raw = here + 3 * window
    beyond = told = None
    for step in range(400):
        if step % 10 == 0:
            judge.bench.bus.send(can.Message(arbitration_id=0x80, is_extended_id=False))
        judge.bench.rig.poll()
        judge.bench.rig.step()
        error = abs(judge.drive.objects[Object.FOLLOWING_ERROR, 0])
        if beyond is None and error > window:
            beyond = judge.bench.rig.time_s
        if judge.drive.objects[Object.STATUSWORD, 0] & Status.FOLLOWING_ERROR:
            told = judge.bench.rig.time_s
            break
    assert beyond is not None
    assert told is not None
    assert told - beyond == pytest.approx(1e-3 * timeout_ms, abs=2.5 * judge.bench.rig.dt)


def test_a_tpdo_of_type_255_keeps_its_inhibit_time_and_its_event_timer(judge: Judge) -> None:
    """TPDO2 with 6064h of a joint that moves all the time; then of one that stands."""
    node, first, mapping = judge.node, Com.TPDO_COMMUNICATION + 1, Com.TPDO_MAPPING + 1
    node.op_mode = "CYCLIC SYNCHRONOUS VELOCITY"
    node.state = "OPERATION ENABLED"
    second = 0x690
    node.sdo[first][1].raw = can301.PDO_INVALID
    node.sdo[first][2].raw = 255
    node.sdo[first][3].raw = 200  # 20 ms
    node.sdo[first][5].raw = 50
    node.sdo[mapping][0].raw = 0
    node.sdo[mapping][1].raw = can301.mapping_entry(Object.POSITION_ACTUAL, 0, 32)
    node.sdo[mapping][0].raw = 1
    node.sdo[first][1].raw = second
    times: list[float] = []
    judge.network.subscribe(second, lambda _id, _data, stamp: times.append(stamp))
    node.sdo[Object.TARGET_VELOCITY].raw = round(-0.1 * judge.bench.drives[JOINT].counts_per_radian)
    judge.cycle(5)
    times.clear()
    for _ in range(200):
        judge.network.listen(1)
    gaps = [b - a for a, b in pairwise(times)]
    assert gaps == pytest.approx([0.02] * len(gaps), abs=1.1 * judge.bench.rig.dt)
    assert len(gaps) >= 8
    node.state = "SWITCH ON DISABLED"
    judge.cycle(20)
    times.clear()
    for _ in range(300):
        judge.network.listen(1)
    assert len(times) >= 5
