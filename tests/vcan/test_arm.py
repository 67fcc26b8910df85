"""An arm on a kernel's CAN bus: rig and daemon as processes, one plant for all tests."""

import importlib.util
import os
import socket
import struct
from pathlib import Path

import can
import pytest
from telerobot.config.load import load_cell

pytestmark = [pytest.mark.hil, pytest.mark.alone]

BURST, BURSTS = 1500, 20
UP = [0.0, 0.0, 0.03, 0.0, 0.0, 0.0]


@pytest.fixture(scope="module")
def plant():
    """A PA-10 on vcan0."""
    if not Path("/sys/class/net/vcan0").exists():
        pytest.skip("no vcan0 here: make vcan runs these tests in user-mode Linux")
    path = Path(__file__).resolve().parents[1] / "hil" / "conftest.py"
    spec = importlib.util.spec_from_file_location("plant_on_vcan", path)
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(os.environ, "TELEROBOT_CAN", "vcan")
        spec.loader.exec_module(module)
        with module.Plant(load_cell("pa10")) as plant:
            plant.operator("ann")
            plant.wait_wall(lambda: plant.operators[0].state.mode == "ready", "not ready")
            plant.operators[0].acquire()
            yield plant


@pytest.fixture
def operator(plant):
    """An operator who has the arm enabled, on the interface that it should be on."""
    ann = plant.operators[0]
    assert plant.cell.config.bus.interface == "socketcan"
    plant.run_for(0.2)  # nobody read anything since the test before
    if not ann.holds_lease:
        ann.acquire()
    if ann.state.mode == "fault":
        ann.reset()
    if ann.state.mode != "enabled":
        ann.enable()
    print(plant.told())
    ann.events.clear()
    return ann


def speed(plant):
    return max(map(abs, plant.truth.dq))


def faults(operator):
    return [(e.values["cause"], e.detail) for e in operator.events if e.name == "fault"]


def test_an_arm_is_moved_over_it_and_hears_no_second_master(plant, operator):
    before = plant.truth.pose_mrf[2]
    operator.joystick(UP, expressed_in="base")
    plant.until(lambda: plant.truth.pose_mrf[2] > before + 0.02, 5.0, "the arm does not rise")
    assert faults(operator) == []
    operator.joystick([0.0] * 6)
    plant.until(lambda: speed(plant) < 2e-3, 2.0, "the arm goes on")


def test_a_flood_of_foreign_frames_stops_nothing(plant, operator):
    before = plant.truth.pose_mrf[2]
    operator.joystick([-x for x in UP], expressed_in="base")
    junk = struct.pack("=IB3x8s", 0x7A5, 8, bytes(8))
    with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
        raw.bind(("vcan0",))
        for _ in range(BURSTS):
            for _ in range(BURST // 10):
                raw.send(junk)
            plant.turn()
    plant.until(lambda: plant.truth.pose_mrf[2] < before - 0.01, 5.0, "the arm does not sink")
    assert faults(operator) == []
    operator.joystick([0.0] * 6)
    plant.until(lambda: speed(plant) < 2e-3, 2.0, "the arm goes on")


def test_an_interface_that_goes_down_in_motion_stops_the_arm_until_it_is_up_again(
    plant, operator, interface
):
    operator.joystick(UP, expressed_in="base")
    plant.until(lambda: speed(plant) > 0.01, 5.0, "the arm does not move")
    interface("down")
    plant.until(lambda: operator.state.mode == "fault", 3.0, "no fault")
    plant.until(lambda: speed(plant) < 2e-3, 2.0, "the arm goes on")
    assert faults(operator)[0][0] == "bus_error"
    plant.until(lambda: "operation_enabled" not in plant.truth.drives, 3.0, "still energised")
    interface("up")
    plant.run_for(0.3)
    operator.reset()
    operator.enable()
    operator.joystick([-x for x in UP], expressed_in="base")
    plant.until(lambda: speed(plant) > 0.01, 5.0, "the arm does not move again")


def test_a_controller_that_goes_off_the_bus_stops_the_arm(plant, operator):
    operator.joystick([-x for x in UP], expressed_in="base")
    plant.until(lambda: speed(plant) > 0.01, 5.0, "the arm does not move")
    with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
        raw.bind(("vcan0",))
        raw.send(struct.pack("=IB3x8s", 0x20000040, 8, bytes(8)))
    plant.until(lambda: operator.state.mode == "fault", 3.0, "no fault")
    assert faults(operator)[0] == ("bus_error", faults(operator)[0][1])
    assert "off the bus" in faults(operator)[0][1]
    plant.until(lambda: speed(plant) < 2e-3, 2.0, "the arm goes on")


def test_others_tools_see_its_frames(plant, operator):
    with can.Bus(interface="socketcan", channel="vcan0") as bus:
        seen = {bus.recv(1.0).arbitration_id for _ in range(60)}
    assert {0x080, 0x181, 0x201} <= seen
    plant.turn()
