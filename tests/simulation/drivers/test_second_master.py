"""Another CANopen master takes a drive and lets go of it: reset and enable work again."""

import struct

import pytest
from telerobot.drivers.bus import InProcessBus
from telerobot.protocols.canopen.can301 import NMT_ID, SYNC_ID, NmtCommand, sdo_request_id
from telerobot.protocols.canopen.cia402 import Controlword, Object, OperationMode
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import STICK

NODE = 4
ON = "operation_enabled"


class OtherMaster:
    """A second master on the bus of a simulation."""

    def __init__(self, simulation):
        self.simulation = simulation
        self.bus = InProcessBus(simulation.buses.hubs[0])
        simulation.on_tick = self.run
        self.plan = []

    def at(self, script_s, can_id, data):
        self.plan.append((script_s, can_id, bytes(data)))

    def write(self, script_s, index, subindex, layout, value):
        size = struct.calcsize(layout)
        head = struct.pack("<BHB", {1: 0x2F, 2: 0x2B, 4: 0x23}[size], index, subindex)
        data = head + struct.pack(layout, value).ljust(4, b"\0")
        self.at(script_s, sdo_request_id(NODE), data)

    def run(self, simulation):
        now_s = simulation.clock.time_s - simulation.player.start_s
        while simulation.player.start_s and self.plan and now_s >= self.plan[0][0]:
            _, can_id, data = self.plan.pop(0)
            self.send(can_id, data)

    def send(self, can_id, data):
        self.bus.put(can_id, data)


def simulation_of(cell, *steps, seconds):
    script = Script.model_validate({"duration_s": seconds, "step": list(steps)})
    return Simulation(cell, script)


def assert_driven_again(simulation, refused):
    """The arm is enabled, by what its drives are, and moves as it is told."""
    seen = []
    then = simulation.on_tick

    def look(s):
        seen.append((str(s.cycle.mode), {d.state.name.lower() for d in s.rig.drives.values()}))
        if then is not None:
            then(s)

    simulation.on_tick = look
    result = simulation.run()
    assert len(result.summary["refused"]) == refused, result.summary["refused"]
    assert seen[-1] == ("enabled", {ON})
    assert max(abs(dq) for dq in result.truths[-1].dq) > 0.01
    assert result.summary["limit_violations"] == 0


AGAIN = (
    {"at_s": 1.5, "operator/mode": {"action": "reset"}},
    {"at_s": 2.2, "operator/mode": {"action": "enable"}},
    {"at_s": 2.6, "cmd/joystick": STICK},
)


@pytest.mark.parametrize("first", ["enabled", "ready"])
def test_a_drive_that_was_taken_set_up_otherwise_and_left_under_power_is_driven_again(pa10, first):
    off = [{"at_s": 0.2, "operator/mode": {"action": "disable"}}] if first == "ready" else []
    simulation = simulation_of(pa10, *off, *AGAIN, seconds=3.2)
    other = OtherMaster(simulation)
    other.at(0.5, NMT_ID, (NmtCommand.PRE_OPERATIONAL, NODE))
    other.write(0.55, Object.QUICK_STOP_OPTION, 0, "<h", 6)
    other.write(0.6, Object.MODE_OF_OPERATION, 0, "<b", OperationMode.CSV)
    for i, word in enumerate(
        (0, Controlword.SHUTDOWN, Controlword.SWITCH_ON, Controlword.ENABLE_OPERATION)
    ):
        other.write(0.65 + 0.05 * i, Object.CONTROLWORD, 0, "<H", word)
    assert_driven_again(simulation, refused=0)


def test_a_reset_that_the_other_master_speaks_into_fails_at_once_and_the_next_one_works(pa10):
    """Not after three seconds, for which any other reset is refused."""
    again = [{**step, "at_s": step["at_s"] + 0.6} for step in AGAIN]
    simulation = simulation_of(pa10, AGAIN[0], *again, seconds=3.8)
    other = OtherMaster(simulation)
    other.at(0.5, SYNC_ID, ())
    spoken = []

    def interrupt(frame):
        asked = frame[0] == sdo_request_id(7) and not spoken
        if asked and simulation.clock.time_s > simulation.player.start_s + 1.4 > 1.5:
            spoken.append(frame)
            other.send(SYNC_ID, b"")

    InProcessBus(simulation.buses.hubs[0], interrupt)
    assert_driven_again(simulation, refused=1)
    assert spoken


def test_a_reset_is_answered_by_what_drives_said_after_it(pa10):
    """The statuswords that were there before are those of drives that another master may have."""
    simulation = simulation_of(pa10, AGAIN[0], seconds=2.0)
    OtherMaster(simulation).at(0.5, SYNC_ID, ())
    simulation.run()
    (fault,) = [e for e in simulation.events if e.name == "fault"]
    (reset,) = [e for e in simulation.events if e.name == "mode" and e.values["mode"] == "ready"][
        1:
    ]
    assert reset.tick > fault.tick
    at = simulation.player.start_s + AGAIN[0]["at_s"]
    ticks = [s for s in simulation.states if at - 1e-6 <= s.time_s and s.tick < reset.tick]
    assert len(ticks) >= 3
    assert {s.mode for s in ticks} == {"fault"}
