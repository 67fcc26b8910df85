"""A rig on an in-process bus, and a master that speaks to it in raw frames."""

import struct
from collections.abc import Callable, Iterator

import can
import pytest
from telerobot.config.load import Cell, load_cell
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.rig.rig import Rig
from telerobot.protocols.canopen import can301, cia402
from telerobot.protocols.canopen.can301 import CommunicationObject as Com
from telerobot.protocols.canopen.can301 import EmcyCode, NmtCommand, NmtState
from telerobot.protocols.canopen.cia402 import Controlword, DriveState, Object, OperationMode

PERIOD_S = 0.01
PACK = {mode: layout.pack for mode, layout in cia402.COMMAND.items()}


class Master:
    """Sends and records frames; configures and enables all drives as a control server would."""

    def __init__(self, cell: Cell) -> None:
        hub = Hub()
        self.cell = cell
        self.bus = InProcessBus(hub)
        self.frames: list[tuple[float, int, bytes]] = []
        self._rig_bus = InProcessBus(hub)
        self.rig = Rig(cell, self._rig_bus)
        self.drives = {d.joint: d for d in cell.config.mechanism.drives}
        self.targets: dict[str, int] = {}
        self.words = dict.fromkeys(self.drives, 0)
        self.beating = True
        self.mode = OperationMode.CSP
        self.silent: set[str] = set()
        self.listen()

    def close(self) -> None:
        self.bus.shutdown()
        self._rig_bus.shutdown()

    def send(self, can_id: int, data: bytes = b"") -> None:
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        self.rig.poll()
        self.listen()

    def listen(self) -> None:
        while (message := self.bus.recv(0)) is not None:
            self.frames.append((self.rig.time_s, message.arbitration_id, bytes(message.data)))

    def newest(self, can_id: int) -> bytes:
        return next(data for _, i, data in reversed(self.frames) if i == can_id)

    def count(self, can_id: int) -> int:
        return sum(i == can_id for _, i, _ in self.frames)

    # --- services -------------------------------------------------------------------------------

    def nmt(self, command: NmtCommand, node: int = 0) -> None:
        self.send(can301.NMT_ID, bytes((command, node)))

    def write(self, joint: str, index: int, sub: int, layout: str, value: int) -> bytes:
        """Write over SDO; return the answer's 8 bytes."""
        data = struct.pack(layout, value)
        head = struct.pack("<BHB", 0x23 | (4 - len(data)) << 2, index, sub)
        self.send(can301.sdo_request_id(self.node(joint)), head + data.ljust(4, b"\0"))
        return self.newest(can301.sdo_reply_id(self.node(joint)))

    def read(self, joint: str, index: int, sub: int, layout: str) -> int:
        """Read over SDO, expedited."""
        node = self.node(joint)
        self.send(can301.sdo_request_id(node), struct.pack("<BHB4x", 0x40, index, sub))
        answer = self.newest(can301.sdo_reply_id(node))
        assert answer[0] & 0xE2 == 0x42, answer.hex()
        (value,) = struct.unpack_from(layout, answer, 4)
        return int(value)

    def node(self, joint: str) -> int:
        return self.drives[joint].node

    def configure(self) -> None:
        timing = self.cell.config.timing
        for joint, drive in self.drives.items():
            beat = can301.consumer_heartbeat(127, round(timing.heartbeat_timeout_s * 1000))
            self.write(joint, Com.CONSUMER_HEARTBEAT, 1, "<I", beat)
            self.write(joint, Com.PRODUCER_HEARTBEAT, 0, "<H", 50)
            self.write(joint, Object.SETPOINT_TIMEOUT, 0, "<H", 80)
            window = round(drive.window * drive.counts_per_radian)
            self.write(joint, Object.FOLLOWING_WINDOW, 0, "<I", window)
            ramp = round(drive.quick_stop_deceleration * drive.counts_per_radian)
            self.write(joint, Object.QUICK_STOP_DECELERATION, 0, "<I", ramp)
            for base, first, mapping, entries in (
                (
                    0x200,
                    Com.RPDO_COMMUNICATION,
                    Com.RPDO_MAPPING,
                    cia402.COMMAND_MAPPING[self.mode],
                ),
                (0x180, Com.TPDO_COMMUNICATION, Com.TPDO_MAPPING, cia402.FEEDBACK_MAPPING),
            ):
                for number in range(4):
                    off = can301.PDO_INVALID | base + 0x100 * number + drive.node
                    self.write(joint, first + number, 1, "<I", off)
                self.write(joint, first, 2, "<B", 1)
                self.write(joint, mapping, 0, "<B", 0)
                for place, entry in enumerate(entries, 1):
                    self.write(joint, mapping, place, "<I", entry)
                self.write(joint, mapping, 0, "<B", len(entries))
                self.write(joint, first, 1, "<I", base + drive.node)
            self.write(joint, Object.MODE_OF_OPERATION, 0, "<b", self.mode)
        self.nmt(NmtCommand.START)

    # --- cyclic ---------------------------------------------------------------------------------

    def cycle(self, periods: int = 1) -> None:
        """SYNC, heartbeat, RPDOs of all drives that have a target, then one period of physics."""
        for _ in range(periods):
            self.send(can301.SYNC_ID)
            if self.beating:
                self.send(can301.heartbeat_id(127), bytes((NmtState.OPERATIONAL,)))
            for joint, target in self.targets.items():
                if joint not in self.silent:
                    data = PACK[self.mode](self.words[joint], target)
                    self.send(can301.rpdo1_id(self.node(joint)), data)
            self.rig.advance(PERIOD_S)
            self.listen()

    def feedback(self, joint: str) -> cia402.Feedback:
        return cia402.unpack_feedback(self.newest(can301.tpdo1_id(self.node(joint))))

    def state(self, joint: str) -> DriveState:
        return cia402.decode_state(self.feedback(joint).statusword)

    def position(self, joint: str) -> float:
        drive = self.drives[joint]
        counts = self.feedback(joint).position
        return drive.zero_rad + drive.direction * counts / drive.counts_per_radian

    def aim(self, joint: str, angle: float) -> None:
        drive = self.drives[joint]
        counts = drive.direction * (angle - drive.zero_rad) * drive.counts_per_radian
        self.targets[joint] = round(counts)

    def command(self, word: Controlword, *joints: str) -> None:
        for joint in joints or self.drives:
            self.words[joint] = word

    def seed(self) -> None:
        """Aim every drive that is not enabled at where it is."""
        for joint in self.drives:
            if self.state(joint) is not DriveState.OPERATION_ENABLED:
                self.targets[joint] = self.feedback(joint).position

    def enable(self, aim: Callable[["Master"], None] | None = None) -> None:
        """Configure, start and enable all drives; `aim` sets the targets, own position without."""
        self.configure()
        self.cycle(2)
        for word in (Controlword.SHUTDOWN, Controlword.SWITCH_ON, Controlword.ENABLE_OPERATION):
            self.command(word)
            for _ in range(6):
                (aim or Master.seed)(self)
                self.cycle()

    def emergencies(self, joint: str) -> list[EmcyCode | int]:
        wanted = can301.emcy_id(self.node(joint))
        return [can301.decode_emcy(data).code for _, i, data in self.frames if i == wanted]


@pytest.fixture(scope="session")
def cell() -> Cell:
    return load_cell("pa10")


@pytest.fixture
def master(cell: Cell) -> Iterator[Master]:
    made = Master(cell)
    yield made
    made.close()


@pytest.fixture
def enabled(master: Master) -> Master:
    master.enable()
    return master
