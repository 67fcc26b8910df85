"""A cell bus in virtual time, with one CiA 402 drive and one force/torque sensor played on it."""

import struct
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import can
import numpy as np
import pytest
from telerobot.config.schema.cell import TimingSection
from telerobot.config.schema.mechanism import DriveSection, ForceTorqueSection
from telerobot.drivers.bus import Frame, Hub, InProcessBus
from telerobot.drivers.canopen.servo import ServoDrive
from telerobot.drivers.fieldbus import Fieldbus
from telerobot.drivers.force_torque import RobotousSensor
from telerobot.protocols.canopen import can301, cia402, robotous
from telerobot.protocols.canopen.can301 import NmtState
from telerobot.protocols.canopen.cia402 import DriveState, Object, OperationMode, Status

PERIOD_S = 0.01
NODE = 5
UNPACK: dict[OperationMode, Callable[[bytes], Any]] = {
    mode: layout.unpack for mode, layout in cia402.COMMAND.items()
}


class PlayedDrive:
    """A drive as a test wants it: obeys NMT, SDO and PDOs; each refusal and silence is settable."""

    def __init__(self, hub: Hub) -> None:
        self.bus = InProcessBus(hub, self.on_frame)
        self.objects: dict[tuple[int, int], bytes] = {
            (Object.SUPPORTED_MODES, 0): struct.pack("<I", 7 << 7)
        }
        self.written: list[tuple[int, int]] = []
        self.refuse: dict[tuple[int, int], int] = {}
        self.boots = True
        self.answers_sdo = True
        self.answers_sync = True
        self.beats = True
        self.nmt = NmtState.PRE_OPERATIONAL
        self.state = DriveState.SWITCH_ON_DISABLED
        self.status = int(Status.VOLTAGE_ENABLED)
        self.position = 4000
        self.torque = 0
        self.unpack: Callable[[bytes], Any] = UNPACK[OperationMode.CSP]
        self.received: list[Any] = []
        self.pending: Any = None
        self.controlword = 0

    def send(self, can_id: int, data: bytes) -> None:
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def emcy(self, code: int) -> None:
        self.send(can301.emcy_id(NODE), can301.encode_emcy(code, 1))

    def heartbeat(self) -> None:
        if self.beats:
            self.send(can301.heartbeat_id(NODE), bytes((self.nmt,)))

    def boot(self) -> None:
        self.nmt = NmtState.PRE_OPERATIONAL
        self.send(can301.heartbeat_id(NODE), bytes((NmtState.BOOT_UP,)))

    def on_frame(self, frame: Frame) -> None:
        can_id, data, _ = frame
        if can_id == can301.NMT_ID and data[1] == NODE:
            self.on_nmt(data[0])
        elif can_id == can301.sdo_request_id(NODE) and self.answers_sdo:
            self.on_sdo(data)
        elif can_id == can301.rpdo1_id(NODE) and self.nmt is NmtState.OPERATIONAL:
            self.pending = self.unpack(data)
            self.received.append(self.pending)
        elif can_id == can301.SYNC_ID and self.nmt is NmtState.OPERATIONAL:
            self.on_sync()

    def on_nmt(self, command: int) -> None:
        if command == can301.NmtCommand.START:
            self.nmt = NmtState.OPERATIONAL
        elif command == can301.NmtCommand.PRE_OPERATIONAL:
            self.nmt = NmtState.PRE_OPERATIONAL
        elif command == can301.NmtCommand.RESET_COMMUNICATION and self.boots:
            self.boot()

    def on_sdo(self, request: bytes) -> None:
        command, index, subindex = struct.unpack("<BHB", request[:4])
        if command >> 5 not in (1, 2):  # an abort, or nothing that it knows
            return
        key = (index, subindex)
        head = struct.pack("<HB", index, subindex)
        code = self.refuse.get(key)
        if code is None and command >> 5 == 2 and key not in self.objects:
            code = 0x06020000
        if code is not None:
            reply = b"\x80" + head + struct.pack("<I", code)
        elif command >> 5 == 1:
            self.objects[key] = request[4 : 8 - (command >> 2 & 3)]
            self.written.append(key)
            if index == Object.MODE_OF_OPERATION:
                self.objects[(Object.MODE_DISPLAY, 0)] = self.objects[key]
            reply = b"\x60" + head + bytes(4)
        else:
            value = self.objects[key]
            reply = bytes((0x43 | (4 - len(value)) << 2,)) + head + value.ljust(4, b"\0")
        self.send(can301.sdo_reply_id(NODE), reply)

    def on_sync(self) -> None:
        if self.pending is not None:
            word, target = self.pending
            self.state = cia402.apply_controlword(self.state, self.controlword, word)
            self.controlword = word
            following = self.unpack is UNPACK[OperationMode.CSP]
            if self.state is DriveState.OPERATION_ENABLED and following:
                self.position = target
        if self.answers_sync:
            self.answer()

    def answer(self) -> None:
        word = cia402.STATE_BITS[self.state] | self.status
        data = cia402.FEEDBACK.pack(word, self.position, self.torque)
        self.send(can301.tpdo1_id(NODE), data)


class PlayedSensor:
    """A Robotous sensor that sends one sample when told to start, then when a test says so."""

    def __init__(self, hub: Hub, config: ForceTorqueSection) -> None:
        self.hub, self.config = hub, config
        self.bus = InProcessBus(hub, self.on_frame)
        self.commands: list[tuple[robotous.SensorCommand, int]] = []
        self.starts = True
        self.sample = robotous.Sample((1.0, 2.0, 3.0), (0.1, 0.2, 0.3), 0, 0)

    def on_frame(self, frame: Frame) -> None:
        if frame[0] == self.config.command_id:
            command = robotous.parse_command(frame[1])
            self.commands.append(command)
            if command[0] is robotous.SensorCommand.START and self.starts:
                self.send()

    def send(self, *, first: bool = True, second: bool = True, gap_s: float = 0.0) -> None:
        halves = robotous.encode_sample(self.sample)
        if first:
            self.put(0, halves[0])
        self.hub.time_s += gap_s
        if second:
            self.put(1, halves[1])

    def put(self, half: int, data: bytes) -> None:
        can_id = self.config.reply_ids[half]
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


class OneDrive:
    """A servo drive, with what the group of it alone reads and writes."""

    def __init__(self, drive: ServoDrive, fieldbus: Fieldbus, unpack: Callable[[bytes], Any]):
        self.it, self.all, self._unpack = drive, ServoDrive.together([drive]), unpack
        self._sent: list[Any] = []
        fieldbus.taps.append(self._on_sent)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.it, name)

    def _on_sent(self, can_id: int, data: bytes) -> None:
        if can_id == can301.rpdo1_id(NODE):
            self._sent.append(self._unpack(data))

    @property
    def answered(self) -> bool:
        return self.all.answered()[0]

    def read(self) -> Any:
        """Return what the drive last told."""
        told = self.all.read()
        return SimpleNamespace(
            ready=told.heard,
            age_syncs=told.age_syncs[0],
            position_rad=float(told.q[0]) if told.heard else None,
            torque_nm=float(told.tau[0]),
            state=told.states[0],
            obeyed=told.obeyed,
            trouble=told.troubles[0],
        )

    def write(self, command: float) -> Any:
        """Write a setpoint; return what then was on the bus."""
        self._sent.clear()
        self.all.write(np.array([command]))
        if not self._sent:
            return None
        (word, raw) = self._sent[0]
        return SimpleNamespace(controlword=word, raw=raw, command=self.it.setpoint.command(raw))


class Cell:
    """Bus, drive and sensor, from both sides, and a period to step."""

    def __init__(
        self, direction: int = 1, mode: OperationMode = OperationMode.CSP, **sensor: Any
    ) -> None:
        self.hub = Hub()
        self.timing = TimingSection()
        self.drive = DriveSection(
            joint="j1",
            node=NODE,
            counts_per_radian=10_000,
            direction=direction,
            zero_rad=0.25,
            rated_torque=50,
            max_torque=100,
            max_velocity=1,
            max_acceleration=5,
            max_jerk=50,
            following_window=0.06,
        )
        self.ft = ForceTorqueSection(**sensor)
        self.fieldbus = Fieldbus(InProcessBus(self.hub), clock=lambda: self.hub.time_s)
        servo = ServoDrive(self.fieldbus, self.drive, self.timing, lower=-2.0, upper=3.0, mode=mode)
        self.servo = OneDrive(servo, self.fieldbus, UNPACK[mode])
        self.sensor = RobotousSensor(self.fieldbus, self.ft)
        self.played = PlayedDrive(self.hub)
        self.played.unpack = UNPACK[mode]
        self.played_sensor = PlayedSensor(self.hub, self.ft)

    def step(self, position: float | None = None) -> tuple[Any, Any]:
        """Do one period as the daemon does: SYNC, receive, read, write."""
        self.hub.time_s += PERIOD_S
        self.played.heartbeat()
        self.fieldbus.sync()
        self.fieldbus.receive(self.hub.time_s)
        reading = self.servo.read()
        wanted = reading.position_rad if position is None else position
        return reading, self.servo.write(0.0 if wanted is None else wanted)

    def enable(self) -> None:
        """Open the drive and bring it to Operation enabled."""
        self.servo.open()
        self.servo.request_enable()
        for _ in range(8):
            reading, _sent = self.step()
        assert reading.state is DriveState.OPERATION_ENABLED
        assert reading.trouble is None


@pytest.fixture
def make_cell() -> Iterator[Callable[..., Cell]]:
    made: list[Cell] = []

    def make(direction: int = 1, mode: OperationMode = OperationMode.CSP, **sensor: Any) -> Cell:
        made.append(Cell(direction, mode, **sensor))
        return made[-1]

    yield make
    for cell in made:
        cell.fieldbus.close()
        cell.played.bus.shutdown()
        cell.played_sensor.bus.shutdown()


@pytest.fixture
def cell(make_cell: Callable[..., Cell]) -> Cell:
    return make_cell()
