"""Another master set a drive up and left before the daemon starts: the arm works as ever."""

import struct

import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.drivers.bus import InProcessBus
from telerobot.protocols.canopen.can301 import NMT_ID, SYNC_ID, NmtCommand, sdo_request_id
from telerobot.protocols.canopen.cia402 import Controlword, Object, OperationMode
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import STICK

NODE, JOINT = 4, "e1"
OTHER = 0x7E
"""The other master's node id: heartbeats come from 700h + that."""


class OtherMaster:
    """Speaks to the drives of a simulation whose daemon has not started yet."""

    def __init__(self, simulation):
        self.simulation, self.bus = simulation, InProcessBus(simulation.buses.hubs[0])

    def send(self, can_id, data=b""):
        self.bus.put(can_id, bytes(data))
        self.simulation.rig.poll()

    def write(self, index, subindex, layout, value):
        head = {1: 0x2F, 2: 0x2B, 4: 0x23}[struct.calcsize(layout)]
        data = struct.pack("<BHB", head, index, subindex) + struct.pack(layout, value)
        self.send(sdo_request_id(NODE), data.ljust(8, b"\0"))

    def enable(self, mode=OperationMode.CSP):
        self.write(Object.MODE_OF_OPERATION, 0, "<b", mode)
        words = (0, Controlword.SHUTDOWN, Controlword.SWITCH_ON, Controlword.ENABLE_OPERATION)
        for word in words:
            self.write(Object.CONTROLWORD, 0, "<H", word)
            self.simulation.rig.advance(0.05)

    def leave(self):
        """Go; nobody has heard what was said before the daemon came."""
        self.bus.shutdown()
        for member in tuple(self.simulation.buses.hubs[0].members):
            while member.recv(0) is not None:
                pass


def mapped_otherwise(m):
    m.write(0x1400, 1, "<I", 0x80000200 + NODE)
    m.write(0x1600, 0, "<B", 0)
    m.write(0x1600, 1, "<I", 0x60400010)
    m.write(0x1600, 0, "<B", 1)
    m.write(0x1400, 2, "<B", 255)
    m.write(0x1801, 2, "<B", 1)
    m.write(0x1801, 1, "<I", 0x280 + NODE)


def watching_another(m):
    m.write(0x1016, 1, "<I", OTHER << 16 | 100)
    m.write(0x1017, 0, "<H", 10)
    m.send(0x700 + OTHER, b"\x05")
    m.simulation.rig.advance(0.3)


def stays_in_quick_stop(m):
    m.write(Object.QUICK_STOP_OPTION, 0, "<h", 6)
    m.enable()
    m.write(Object.CONTROLWORD, 0, "<H", Controlword.QUICK_STOP)
    m.simulation.rig.advance(0.1)


def synced_by_it(m):
    m.send(NMT_ID, (NmtCommand.START, 0))
    for _ in range(10):
        m.send(SYNC_ID)
        m.simulation.rig.advance(0.01)


def wrong_bounds(m):
    m.write(Object.POSITION_LIMIT, 1, "<i", -10)
    m.write(Object.POSITION_LIMIT, 2, "<i", 10)
    m.write(Object.FOLLOWING_WINDOW, 0, "<I", 0)
    m.write(Object.SETPOINT_TIMEOUT, 0, "<H", 1)


def offsets(m):
    m.write(Object.VELOCITY_OFFSET, 0, "<i", 20_000)
    m.write(Object.TORQUE_OFFSET, 0, "<h", 300)


LEFT = {
    "mapped otherwise": mapped_otherwise,
    "in quick stop": stays_in_quick_stop,
    "under power in CSV": lambda m: m.enable(OperationMode.CSV),
    "under power, synced": lambda m: (m.enable(), synced_by_it(m)),
    "stopped": lambda m: m.send(NMT_ID, (NmtCommand.STOP, 0)),
    "wrong bounds": wrong_bounds,
    "listening to another SYNC": lambda m: m.write(0x1005, 0, "<I", 0x81),
    "in LSS configuration": lambda m: m.send(0x7E5, (4, 1, 0, 0, 0, 0, 0, 0)),
}


def played(cell, left, *steps):
    """Return the simulation that starts after the other master, and its last modes and states."""
    script = Script.model_validate({"duration_s": 0.9, "step": list(steps)})
    simulation = Simulation(cell, script)
    other = OtherMaster(simulation)
    left(other)
    other.leave()
    seen, way = [], []
    simulation.on_tick = lambda s: seen.append(
        (str(s.cycle.mode), {d.state.name.lower() for d in s.rig.drives.values()})
    )
    simulation.on_physics = lambda s: way.append(s.rig.world.q.copy())
    result = simulation.run()
    return simulation, result, seen, np.array(way)


@pytest.mark.parametrize("left", LEFT.values(), ids=LEFT.keys())
def test_a_drive_that_another_master_left_is_driven_as_ever(pa10, left):
    simulation, result, seen, _ = played(pa10, left, {"at_s": 0.2, "cmd/joystick": STICK})
    assert [e.detail for e in simulation.events if e.severity in ("warning", "error")] == []
    assert seen[-1] == ("enabled", {"operation_enabled"})
    assert max(abs(dq) for dq in result.truths[-1].dq) > 0.01


@pytest.mark.parametrize("mode", ["csv", "cst"])
def test_what_another_master_adds_to_setpoints_moves_nothing(pa10, mode):
    """Drives add 60B1h and 60B2h to what they are sent, and keep them over a reset."""
    cell = altered(pa10, {"mechanism.operation_mode": mode})
    _, result, seen, way = played(cell, offsets)
    assert result.ok, result.summary
    assert seen[-1] == ("enabled", {"operation_enabled"})
    assert np.abs(way - way[0]).max() < 1e-3


def broken(m):
    m.enable()
    m.simulation.rig.drives[JOINT].break_down(True)
    m.simulation.rig.drives[JOINT].break_down(False)


@pytest.mark.parametrize("left", [broken, watching_another])
def test_a_drive_that_was_left_in_fault_is_named(pa10, left):
    simulation, _, seen, _ = played(pa10, left)
    assert seen[-1][0] == "fault"
    (error,) = [e for e in simulation.events if e.severity == "error"]
    assert (error.name, error.values["device"]) == ("fault", JOINT)
