"""The CAN master: SYNC, dispatch, SDO without a thread, and what it notices."""

import random
import threading
import tracemalloc
from typing import Any

import can
import pytest
from canopen.sdo.exceptions import SdoCommunicationError
from telerobot.drivers.bus import Frame, Hub, InProcessBus, LoopbackBus
from telerobot.drivers.device import Cause
from telerobot.drivers.fieldbus import Fieldbus
from telerobot.protocols.canopen import can301, cia402


def frame(can_id: int, data: bytes = b"", **kind: bool) -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False, **kind)


def test_sync_and_heartbeat_are_sent_and_counted(cell: Any) -> None:
    seen: list[tuple[int, bytes]] = []
    cell.fieldbus.taps.append(lambda can_id, data: seen.append((can_id, data)))
    cell.fieldbus.sync()
    cell.fieldbus.heartbeat()
    assert seen == [(0x080, b""), (0x77F, b"\x05")]
    assert cell.fieldbus.sync_count == 1


def test_frames_go_to_the_decoder_of_their_identifier(cell: Any) -> None:
    got: list[tuple[bytes, float, float]] = []
    bus = cell.fieldbus
    bus.listen(0x190, lambda data, stamp: got.append((data, stamp, bus.now)))
    cell.hub.time_s = 0.5
    cell.played.send(0x190, b"\x01")
    cell.played.send(0x191, b"\x02")
    assert bus.receive(0.75) == 2
    assert got == [(b"\x01", 0.5, 0.75)]


def test_a_frame_that_nobody_stamped_came_when_it_was_taken_in(cell: Any) -> None:
    """Some interfaces leave 0, and whoever takes differences over stamps would never get one."""
    got: list[float] = []
    cell.fieldbus.listen(0x190, lambda _data, stamp: got.append(stamp))
    cell.hub.time_s = 0.0
    for now_s in (0.75, 0.76):
        cell.played.send(0x190, b"\x01")
        cell.fieldbus.receive(now_s)
    assert got == [0.75, 0.76]


@pytest.mark.parametrize("kind", ["is_remote_frame", "is_error_frame"])
def test_only_data_frames_reach_a_decoder(cell: Any, kind: str) -> None:
    got: list[bytes] = []
    cell.fieldbus.listen(0x190, lambda data, _stamp: got.append(data))
    cell.played.bus.send(frame(0x190, **{kind: True}))
    cell.fieldbus.receive(0.0)
    assert got == []
    assert cell.fieldbus.trouble is None


@pytest.mark.parametrize(
    ("can_id", "data"),
    [(0x185, bytes(5)), (0x085, bytes(3)), (0x705, b"")],
    ids=["PDO", "EMCY", "heartbeat"],
)
def test_a_frame_of_a_wrong_length_is_counted_not_raised(
    cell: Any, can_id: int, data: bytes
) -> None:
    cell.played.send(can_id, data)
    cell.fieldbus.receive(0.0)
    assert cell.fieldbus.malformed == 1
    assert not cell.servo.read().ready


@pytest.mark.parametrize("can_id", [0x000, 0x080, 0x77F, 0x205, 0x605])
def test_a_second_master_is_noticed_until_cleared(cell: Any, can_id: int) -> None:
    stranger = InProcessBus(cell.hub)
    stranger.send(frame(can_id, bytes(8)))
    cell.fieldbus.receive(0.0)
    trouble = cell.fieldbus.trouble
    assert trouble is not None
    assert trouble.cause is Cause.SECOND_MASTER
    assert trouble.values["can_id"] == can_id
    cell.fieldbus.clear_trouble()
    assert cell.fieldbus.trouble is None
    stranger.shutdown()


def test_our_own_frames_are_no_second_master(cell: Any) -> None:
    cell.enable()
    assert cell.fieldbus.trouble is None


class BrokenBus(InProcessBus):
    def put(self, can_id: int, data: bytes) -> None:
        raise can.CanOperationError("cable cut")

    def take(self, timeout: float | None = 0.0) -> Frame | None:
        raise can.CanOperationError("cable cut")

    def shutdown(self) -> None:
        super().shutdown()
        raise can.CanOperationError("cable cut")


def test_a_broken_bus_is_trouble_and_not_an_exception() -> None:
    fieldbus = Fieldbus(BrokenBus(Hub()))
    fieldbus.sync()
    assert fieldbus.sync_count == 0
    assert fieldbus.trouble is not None
    assert fieldbus.trouble.cause is Cause.BUS_ERROR
    assert "cable cut" in fieldbus.trouble.detail
    fieldbus.clear_trouble()
    assert fieldbus.receive(0.0) == 0
    assert fieldbus.trouble is not None
    fieldbus.close()


def test_bus_off_is_trouble(cell: Any) -> None:
    cell.played.bus.send(frame(0x40, is_error_frame=True))
    cell.fieldbus.receive(0.0)
    assert cell.fieldbus.trouble.cause is Cause.BUS_ERROR


def test_an_sdo_is_answered_without_a_thread(cell: Any) -> None:
    node = cell.fieldbus.network[5]
    node.sdo.download(0x6065, 0, (600).to_bytes(4, "little"))
    assert node.sdo.upload(0x6065, 0) == (600).to_bytes(4, "little")


def test_an_sdo_without_an_answer_fails(cell: Any) -> None:
    cell.played.answers_sdo = False
    with pytest.raises(SdoCommunicationError):
        cell.fieldbus.network[5].sdo.upload(0x6502, 0)


def test_an_answer_that_needs_the_others_to_run_is_waited_for(cell: Any) -> None:
    cell.played.bus.accept = cell.played.bus.keep

    def run_the_node() -> None:
        for frame in cell.played.bus.take():
            cell.played.on_frame(frame)

    cell.hub.pump = run_the_node
    data = cell.fieldbus.network[5].sdo.upload(0x6502, 0)
    assert cia402.supports_mode(int.from_bytes(data, "little"), cia402.OperationMode.CSP)


def test_other_frames_are_dispatched_while_an_sdo_waits(cell: Any) -> None:
    got: list[bytes] = []
    cell.fieldbus.listen(0x190, lambda data, _stamp: got.append(data))
    cell.played.send(0x190, b"\x07")
    cell.fieldbus.network[5].sdo.upload(0x6502, 0)
    assert got == [b"\x07"]


def test_heartbeats_tell_states_and_what_names_none_is_counted() -> None:
    hub, told = Hub(), []
    fieldbus, other = Fieldbus(InProcessBus(hub)), InProcessBus(hub)
    fieldbus.add_node(5, None, told.append)
    for data in (b"\x00", b"\x7f", b"\x05", b"", b"\x03", b"\x85"):
        other.put(0x705, data)
    other.put(0x706, b"\x05")  # a node that nobody knows
    fieldbus.receive(0.0)
    assert told == [can301.NmtState.BOOT_UP, can301.NmtState.PRE_OPERATIONAL, 5]
    assert fieldbus.malformed == 3


def test_sdo_and_wait_work_over_udp() -> None:
    dice = random.SystemRandom()
    address = f"239.74.{dice.randrange(256)}.{dice.randrange(1, 255)}", dice.randrange(20000, 60000)
    far = LoopbackBus(*address)
    fieldbus = Fieldbus(LoopbackBus(*address))
    node = fieldbus.add_node(5, None, lambda _state: None)

    def answer() -> None:
        request = far.recv(5.0)
        assert request is not None
        far.send(frame(can301.sdo_reply_id(5), b"\x43" + bytes(request.data[1:4]) + b"\x2a\0\0\0"))

    helper = threading.Thread(target=answer)
    helper.start()
    assert node.sdo.upload(0x1000, 0) == b"\x2a\0\0\0"
    helper.join()
    got: list[bytes] = []
    fieldbus.listen(0x185, lambda data, _stamp: got.append(data))
    far.send(frame(0x185, b"\x01"))
    while not got:
        assert fieldbus.wait(5.0)
        fieldbus.receive(0.0)
    assert got == [b"\x01"]
    fieldbus.close()
    far.shutdown()


def test_waiting_in_process_keeps_the_frame_for_receive(cell: Any) -> None:
    got: list[bytes] = []
    cell.fieldbus.listen(0x190, lambda data, _stamp: got.append(data))
    assert not cell.fieldbus.wait(1.0)
    cell.played.send(0x190, b"\x01")
    assert cell.fieldbus.wait(1.0)
    assert cell.fieldbus.wait(1.0)
    assert got == []
    assert cell.fieldbus.receive(0.0) == 1
    assert got == [b"\x01"]


def test_a_condition_is_waited_for_and_given_up(cell: Any) -> None:
    got: list[bytes] = []
    cell.fieldbus.listen(0x190, lambda data, _stamp: got.append(data))
    cell.played.send(0x190, b"\x01")
    assert cell.fieldbus.wait_until(lambda: bool(got), 1.0)

    def flood() -> None:
        cell.hub.time_s += 0.25
        cell.played.send(0x191, b"")

    cell.hub.pump = flood
    assert not cell.fieldbus.wait_until(lambda: len(got) > 1, 1.0)
    assert cell.hub.time_s == 1.0


def test_a_flood_does_not_hold_the_tick_for_ever(cell: Any) -> None:
    for _ in range(1500):
        cell.played.send(0x191, b"")
    assert cell.fieldbus.receive(0.0) == 1000
    assert cell.fieldbus.receive(0.0) == 500


def test_frames_that_nobody_asked_for_leave_nothing_behind() -> None:
    """Of every identifier that is not the master's own: SDO and LSS replies, emergencies …"""
    hub = Hub()
    fieldbus, stranger = Fieldbus(InProcessBus(hub)), InProcessBus(hub)
    fieldbus.add_node(5, None, lambda _state: None)
    own = {0x000, 0x080, 0x77F, 0x205, 0x605}
    frames = [
        frame(can_id, bytes((0x43, 0, 0x10, 0, 1, 2, 3, 4)))
        for can_id in range(0x800)
        if can_id not in own
    ]

    def flood() -> None:
        for message in frames:
            stranger.send(message)
            fieldbus.receive(0.0)

    flood()
    tracemalloc.start()
    flood()
    before, _ = tracemalloc.get_traced_memory()
    for _ in range(10):
        flood()
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert fieldbus.trouble is None
    assert after - before < len(frames), "bytes, after ten more rounds"
    stranger.shutdown()
    fieldbus.close()


def test_a_reply_that_came_unasked_is_not_taken_for_the_next_one(cell: Any) -> None:
    cell.played.send(can301.sdo_reply_id(5), b"\x43\x02\x65\x00\xff\xff\xff\xff")
    cell.fieldbus.receive(0.0)
    data = cell.fieldbus.network[5].sdo.upload(0x6502, 0)
    assert data != b"\xff" * 4


def test_a_reply_that_is_too_short_is_none(cell: Any) -> None:
    """Over any bus a frame may have fewer bytes than its protocol says."""
    cell.played.answers_sdo = False
    ask = cell.played.bus.accept

    def answer_shortly(frame: Frame) -> None:
        ask(frame)
        if frame[0] == can301.sdo_request_id(5):
            for length in range(8):
                cell.played.send(can301.sdo_reply_id(5), bytes(length))

    cell.played.bus.accept = answer_shortly
    with pytest.raises(SdoCommunicationError):
        cell.fieldbus.network[5].sdo.upload(0x6502, 0)
    assert cell.fieldbus.malformed >= 8


# --- answers to SYNC ----------------------------------------------------------------------------


def answers(cell: Any, *data: bytes) -> list[bytes]:
    """Return which frames of a node are taken, sent one after the other."""
    taken: list[bytes] = []
    cell.fieldbus.listen(0x190, lambda told, _stamp: taken.append(told))
    for told in data:
        cell.played.send(0x190, told)
    cell.fieldbus.receive(0.0)
    return taken


def test_a_second_answer_to_one_sync_is_not_taken_and_told(cell: Any) -> None:
    cell.fieldbus.expect_answers(0x190)
    cell.fieldbus.sync()
    assert answers(cell, b"\x01", b"\x02") == [b"\x01"]
    trouble = cell.fieldbus.trouble
    assert (trouble.cause, trouble.values) == (Cause.FOREIGN_PDO, {"can_id": 0x190})
    cell.fieldbus.clear_trouble()
    cell.fieldbus.sync()
    assert answers(cell, b"\x03") == [b"\x03"]
    assert cell.fieldbus.trouble is None
    assert answers(cell, b"\x04") == []
    assert cell.fieldbus.trouble is not None, "before the next SYNC, too"


def test_a_frame_that_the_bus_delivers_twice_is_no_second_sender(cell: Any) -> None:
    """CAN repeats a frame whose last bit but one was disturbed: who had it has it twice."""
    cell.fieldbus.expect_answers(0x190)
    cell.fieldbus.sync()
    assert answers(cell, b"\x01", b"\x01") == [b"\x01"]
    assert cell.fieldbus.trouble is None


@pytest.mark.parametrize("late", [1, 2, 3])
def test_late_answers_are_taken_with_the_one_in_turn(cell: Any, late: int) -> None:
    cell.fieldbus.expect_answers(0x190)
    for _ in range(late + 1):
        cell.fieldbus.sync()
    told = [bytes((k,)) for k in range(late + 1)]
    assert answers(cell, *told) == told
    assert cell.fieldbus.trouble is None
    assert answers(cell, b"\x7f") == []
    assert cell.fieldbus.trouble.cause is Cause.FOREIGN_PDO


def test_answers_that_were_lost_long_ago_are_not_taken_now(cell: Any) -> None:
    cell.fieldbus.expect_answers(0x190)
    for _ in range(100):
        cell.fieldbus.sync()
    assert answers(cell, b"\x01", b"\x02", b"\x03", b"\x04", b"\x05") == [
        bytes((k,)) for k in range(1, 5)
    ]
    assert cell.fieldbus.trouble.cause is Cause.FOREIGN_PDO


def test_a_node_that_is_not_configured_yet_may_say_what_it_likes(cell: Any) -> None:
    """By default a drive tells of each change, and not when it is asked."""
    assert answers(cell, b"\x01", b"\x02") == [b"\x01", b"\x02"]
    cell.fieldbus.expect_answers(0x190)
    cell.fieldbus.expect_no_answers(0x190)
    assert answers(cell, b"\x03", b"\x04") == [b"\x03", b"\x04"]
    assert cell.fieldbus.trouble is None
