"""A kernel's bus beside the loopback bus: own frames, silent drops, bus-off, down and up."""

import select
import socket
import struct

import can
import pytest
from telerobot.config.schema.bus import BusSection
from telerobot.drivers.bus import open_bus
from telerobot.drivers.device import Cause, DeviceError
from telerobot.drivers.fieldbus import Fieldbus
from telerobot.drivers.rig.nodes.wire import Wire

pytestmark = [pytest.mark.hil, pytest.mark.alone]  # the interface goes down in one of them

KERNEL = BusSection(interface="socketcan", channel="vcan0")
FLOOD = 5000
FOREIGN, ANSWER = 0x555, 0x190
BUS_OFF = 0x20000040  # linux/can/error.h


def frame(can_id, data=b""):
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


def heard(bus):
    """Return whether a frame comes to a bus."""
    return bool(select.select([bus.fileno()], [], [], 1.0)[0])


@pytest.fixture
def other():
    with can.Bus(interface="socketcan", channel="vcan0") as bus:
        yield bus


@pytest.fixture
def fieldbus():
    made = Fieldbus(open_bus(KERNEL))
    yield made
    made.close()


def test_our_own_frames_are_no_second_master_and_those_of_others_here_are(fieldbus, other):
    fieldbus.sync()
    fieldbus.heartbeat()
    assert other.recv(1.0).arbitration_id == 0x080
    fieldbus.pause(0.05)
    assert fieldbus.trouble is None
    other.send(frame(0x080))
    fieldbus.pause(0.2)
    assert fieldbus.trouble.cause is Cause.SECOND_MASTER


def test_a_bus_that_would_echo_our_frames_is_refused():
    echoing = KERNEL.model_copy(update={"options": {"receive_own_messages": True}})
    with pytest.raises(DeviceError, match="receive_own_messages"):
        open_bus(echoing)


@pytest.mark.parametrize("known", [False, True], ids=["hearing all", "hearing what is known"])
def test_a_flood_of_foreign_frames_drops_answers_without_a_word_unless_it_is_kept_out(
    fieldbus, other, known
):
    answers = []
    fieldbus.listen(ANSWER, lambda data, _stamp: answers.append(data))
    if known:
        fieldbus.hear_only_known()
    for _ in range(FLOOD):
        other.send(frame(FOREIGN, bytes(8)))
    other.send(frame(ANSWER, b"here"))
    fieldbus.pause(0.3)
    while fieldbus.receive(0.0):
        pass
    assert answers == ([b"here"] if known else [])
    assert fieldbus.trouble is None


def test_what_is_listened_to_later_is_heard_and_masters_are_still_noticed(fieldbus, other):
    fieldbus.hear_only_known()
    answers = []
    fieldbus.listen(ANSWER, lambda data, _stamp: answers.append(data))
    other.send(frame(ANSWER, b"here"))
    fieldbus.pause(0.1)
    assert answers == [b"here"]
    other.send(frame(0x000, b"\x01\x00"))
    fieldbus.pause(0.1)
    assert fieldbus.trouble.cause is Cause.SECOND_MASTER


def test_a_controller_that_goes_off_the_bus_is_trouble(fieldbus):
    fieldbus.hear_only_known()
    with socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as raw:
        raw.bind(("vcan0",))
        raw.send(struct.pack("=IB3x8s", BUS_OFF, 8, bytes(8)))
    fieldbus.pause(0.1)
    assert fieldbus.trouble.cause is Cause.BUS_ERROR
    assert "off the bus" in fieldbus.trouble.detail


def test_an_interface_that_goes_down_is_trouble_and_works_when_it_is_up_again(
    fieldbus, other, interface
):
    wire = Wire("bus", other)
    fieldbus.sync()
    assert heard(other)
    assert wire.stamp is not None
    wire.take()
    interface("down")
    fieldbus.sync()
    fieldbus.pause(0.05)
    assert fieldbus.trouble.cause is Cause.BUS_ERROR
    assert "Network is down" in fieldbus.trouble.detail
    wire.send(ANSWER, b"")
    assert (wire.lost, wire.stamp) == (1, None)
    interface("up")
    fieldbus.clear_trouble()
    count = fieldbus.sync_count
    fieldbus.sync()
    fieldbus.pause(0.05)
    assert fieldbus.trouble is None
    assert fieldbus.sync_count == count + 1
    assert heard(other)
    assert wire.stamp is not None
    answers = []
    fieldbus.listen(ANSWER, lambda data, _stamp: answers.append(data))
    wire.send(ANSWER, b"up")
    fieldbus.pause(0.1)
    assert answers == [b"up"]
