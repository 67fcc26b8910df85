"""The two buses that need no hardware, and how a cell's bus is opened."""

import random
import select
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from typing import Any

import can
import msgpack
import pytest
from can.interfaces.socketcan import SocketcanBus
from can.interfaces.socketcan.socketcan import build_can_frame, dissect_can_frame
from telerobot.config.schema.bus import BusSection
from telerobot.drivers import bus as buses
from telerobot.drivers.bus import (
    Hub,
    InProcessBus,
    LoopbackBus,
    can_interfaces,
    frame_of,
    open_bus,
    put_by_kernel,
    putting,
    take_from_kernel,
    taking,
)
from telerobot.drivers.device import DeviceError

IP_MULTICAST_ALL = 49


def frame(can_id: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


@pytest.fixture
def address() -> tuple[str, int]:
    dice = random.SystemRandom()
    return f"239.74.{dice.randrange(256)}.{dice.randrange(1, 255)}", dice.randrange(20_000, 60_000)


@pytest.fixture
def pair(address: tuple[str, int]) -> Iterator[tuple[LoopbackBus, LoopbackBus]]:
    a, b = LoopbackBus(*address), LoopbackBus(*address)
    yield a, b
    a.shutdown()
    b.shutdown()


def test_a_frame_arrives_at_the_other_side(pair: tuple[LoopbackBus, LoopbackBus]) -> None:
    a, b = pair
    a.send(frame(0x205, b"\x01\x02"))
    got = b.recv(2.0)
    assert got is not None
    assert (got.arbitration_id, bytes(got.data)) == (0x205, b"\x01\x02")
    assert not got.is_extended_id


def test_a_sender_does_not_hear_itself_but_hears_an_equal_frame_of_another(
    pair: tuple[LoopbackBus, LoopbackBus],
) -> None:
    a, b = pair
    a.send(frame(0x100, b"same"))
    assert b.recv(2.0) is not None
    b.send(frame(0x100, b"same"))
    b.send(frame(0x101))
    heard = [a.recv(2.0), a.recv(2.0)]
    assert [m.arbitration_id for m in heard if m] == [0x100, 0x101]
    assert a.recv(0) is None


def test_an_own_echo_does_not_hide_what_waits_behind_it(
    pair: tuple[LoopbackBus, LoopbackBus],
) -> None:
    a, b = pair
    a.send(frame(0x80))
    assert b.recv(2.0) is not None
    b.send(frame(0x181))
    assert b.recv(0) is None
    got = a.recv(0)
    assert got is not None
    assert got.arbitration_id == 0x181


def test_an_own_echo_wakes_nobody_up(pair: tuple[LoopbackBus, LoopbackBus]) -> None:
    a, b = pair
    a.send(frame(0x80))
    assert b.recv(2.0) is not None
    assert select.select([a], [], [], 0.0)[0] == []
    b.send(frame(0x181))
    assert select.select([a], [], [], 2.0)[0] == [a]


def test_where_the_kernel_filters_nothing_own_echoes_are_dropped_all_the_same(
    address: tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_receiver: socket.socket, _port: int) -> None:
        raise OSError("Protocol not available")

    monkeypatch.setattr(buses, "_drop_from", refuse)
    a, b = LoopbackBus(*address), LoopbackBus(*address)
    a.send(frame(0x80))
    assert b.recv(2.0) is not None
    assert select.select([a], [], [], 2.0)[0] == [a]  # its own
    assert a.recv(0) is None
    b.send(frame(0x181))
    heard = a.recv(2.0)
    assert heard is not None
    assert heard.arbitration_id == 0x181
    a.shutdown()
    b.shutdown()


def test_frames_of_every_kind_come_as_they_were_sent(
    pair: tuple[LoopbackBus, LoopbackBus],
) -> None:
    a, b = pair
    kinds: list[dict[str, object]] = [
        {"is_extended_id": False, "data": bytes(range(8))},
        {"is_extended_id": True, "data": b""},
        {"is_extended_id": False, "is_remote_frame": True, "dlc": 8},
        {"is_extended_id": False, "is_error_frame": True, "data": bytes(8)},
    ]
    for kind in kinds:
        sent = can.Message(arbitration_id=0x123, check=True, **kind)  # type: ignore[arg-type]
        a.send(sent)
        heard = b.recv(2.0)
        assert heard is not None
        assert heard.equals(sent, timestamp_delta=None)


@pytest.mark.parametrize("can_id", [0x000, 0x07F, 0x080, 0x0FF, 0x100, 0x205, 0x7FF])
@pytest.mark.parametrize("data", [b"", b"\x01\x02\x03\x04\x05\x06", bytes(8)])
def test_the_quick_way_carries_the_same_datagrams(
    pair: tuple[LoopbackBus, LoopbackBus], can_id: int, data: bytes
) -> None:
    a, b = pair
    for _ in range(2):  # the first one of an identifier is looked into, later ones are known
        a.send(frame(can_id, data))
        datagram = b.receiver.recv(100)
        a.put(can_id, data)
        assert b.receiver.recv(100) == datagram
        a.put(can_id, data)
        heard = b.recv(2.0)
        assert heard is not None
        assert heard.equals(frame(can_id, data), timestamp_delta=None)
        a.put(can_id, data)
        (taken,) = b.take(2.0)
        assert taken[:2] == (can_id, data)
        assert taken[2] > 1e9
    assert b.take() == []


def test_the_quick_way_marks_what_is_no_standard_data_frame(
    pair: tuple[LoopbackBus, LoopbackBus],
) -> None:
    a, b = pair
    kinds = {1 << 31: "is_extended_id", 1 << 30: "is_remote_frame", 1 << 29: "is_error_frame"}
    a.put(0x123, bytes(8))
    assert len(b.take(2.0)) == 1
    for flag, kind in kinds.items():
        of: dict[str, Any] = {"is_extended_id": False, kind: True}
        of |= {"dlc": 8} if kind == "is_remote_frame" else {"data": bytes(8)}
        sent = can.Message(arbitration_id=0x123, **of)
        a.send(sent)
        (taken,) = b.take(2.0)
        assert taken[:2] == (0x123 | flag, bytes(8)) == frame_of(sent)[:2]


def test_stamps_are_the_kernels_and_follow_the_order_of_sending(
    pair: tuple[LoopbackBus, LoopbackBus],
) -> None:
    a, b = pair
    for i in range(5):
        a.send(frame(0x100 + i))
    stamps = [m.timestamp for m in (b.recv(2.0) for _ in range(5)) if m]
    assert len(stamps) == 5
    assert stamps == sorted(stamps)
    assert stamps[0] > 1e9


MALFORMED = {
    "garbage": b"\xc1\xff",
    "no map": msgpack.packb(5),
    "unknown keys": msgpack.packb({"hello": 1}),
    "id too large": msgpack.packb({"arbitration_id": 1 << 40, "dlc": 0}),
    "id no number": msgpack.packb({"arbitration_id": 1.5, "dlc": 0, "is_extended_id": False}),
    "CAN FD": msgpack.packb({"arbitration_id": 1, "is_fd": True, "dlc": 0}),
    "too long": msgpack.packb({"arbitration_id": 1, "dlc": 9, "data": bytes(9)}),
}


@pytest.mark.parametrize("datagram", MALFORMED.values(), ids=MALFORMED.keys())
def test_a_malformed_datagram_is_counted_and_ignored(
    pair: tuple[LoopbackBus, LoopbackBus], address: tuple[str, int], datagram: bytes
) -> None:
    a, b = pair
    a.sender.sendto(datagram, address)
    a.send(frame(0x123))
    got = b.recv(2.0)
    assert got is not None
    assert got.arbitration_id == 0x123
    assert b.malformed == 1


def test_nothing_leaves_the_machine(
    pair: tuple[LoopbackBus, LoopbackBus], address: tuple[str, int]
) -> None:
    bus = pair[0]
    sender, receiver = bus.sender, bus.receiver
    assert sender.getsockname()[0] == "127.0.0.1"
    assert sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
    interface = sender.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, 4)
    assert socket.inet_ntoa(interface) == "127.0.0.1"
    assert receiver.getsockname() == address
    assert receiver.getsockopt(socket.IPPROTO_IP, IP_MULTICAST_ALL) == 0


def test_only_classic_frames_are_sent(pair: tuple[LoopbackBus, LoopbackBus]) -> None:
    with pytest.raises(can.CanOperationError, match="classic CAN only"):
        pair[0].send(can.Message(arbitration_id=1, is_fd=True))


def test_members_of_a_hub_hear_each_other_in_virtual_time() -> None:
    hub = Hub()
    a, b, c = InProcessBus(hub), InProcessBus(hub), InProcessBus(hub)
    hub.time_s = 1.25
    sent = frame(0x80)
    a.send(sent)
    assert a.recv(0) is None
    heard = b.recv(0)
    assert heard is not None
    assert heard.equals(sent, timestamp_delta=None)
    assert heard.timestamp == 1.25
    assert c.take() == [(0x80, bytes(sent.data), 1.25)]
    other = InProcessBus(Hub())
    a.send(frame(0x81))
    assert other.recv(0) is None
    for bus in (a, b, c, other):
        bus.shutdown()


def test_an_answer_given_at_once_comes_after_the_question_for_everyone() -> None:
    hub = Hub()
    master = InProcessBus(hub)
    answering = InProcessBus(hub)
    answering.accept = lambda _frame: answering.send(frame(0x581))
    watching = InProcessBus(hub)
    master.send(frame(0x601))
    heard = [watching.recv(0), watching.recv(0)]
    assert [m.arbitration_id for m in heard if m] == [0x601, 0x581]
    answer = master.recv(0)
    assert answer is not None
    assert answer.arbitration_id == 0x581
    for bus in (master, answering, watching):
        bus.shutdown()


def test_who_waits_lets_the_others_run_and_never_the_wall_clock() -> None:
    hub = Hub()
    master, node = InProcessBus(hub), InProcessBus(hub)
    turns: list[int] = []

    def pump() -> None:
        turns.append(1)
        if len(turns) == 1:
            node.send(frame(0x705))

    hub.pump = pump
    assert master.recv(0) is None
    assert turns == []
    assert master.recv(1.0) is not None
    assert master.recv(3600.0) is None
    assert len(turns) == 2
    node.shutdown()
    node.shutdown()
    master.shutdown()


def test_a_cell_names_its_bus(address: tuple[str, int]) -> None:
    loopback = open_bus(BusSection(channel=address[0], port=address[1]))
    assert isinstance(loopback, LoopbackBus)
    hub = Hub()
    inside = open_bus(BusSection(interface="in_process"), hub)
    assert isinstance(inside, InProcessBus)
    other = open_bus(BusSection(interface="virtual", channel="test_a_cell_names_its_bus"))
    assert isinstance(other, can.BusABC)
    for bus in (loopback, inside, other):
        bus.shutdown()


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (BusSection(interface="in_process"), "only inside one process"),
        (BusSection(interface="no_such_thing"), "no_such_thing"),
        (BusSection(channel="10.0.0.1"), "loopback 10.0.0.1"),
        (BusSection(interface="socketcan", channel="can_that_is_not"), "socketcan can_that_is_not"),
        (BusSection(interface="virtual", options={"receive_own_messages": True}), "second master"),
    ],
)
def test_a_bus_that_cannot_be_opened_says_so_in_one_line(config: BusSection, words: str) -> None:
    with pytest.raises(DeviceError, match=words) as refused:
        open_bus(config)
    assert "\n" not in str(refused.value)


@pytest.fixture
def kernels() -> Iterator[tuple[socket.socket, socket.socket]]:
    """The two ends of a line of packets, each of which is read as a kernel's CAN bus is."""
    pair = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    yield pair
    for end in pair:
        end.close()


@pytest.mark.parametrize(
    "message",
    [
        frame(0x205, b"\x01\x02"),
        frame(0x7FF, bytes(range(8))),
        frame(0x080),
        can.Message(arbitration_id=0x123456, is_extended_id=True, data=b"\xff"),
        can.Message(arbitration_id=0x201, is_extended_id=False, is_remote_frame=True, dlc=3),
        can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, data=bytes(8)),
    ],
    ids=["standard", "full", "empty", "extended", "remote", "error"],
)
def test_a_kernels_frames_are_what_python_can_has_of_them(kernels, message) -> None:
    ours, other = kernels
    other.send(build_can_frame(message))
    (taken,) = take_from_kernel(ours, 1.0)
    assert taken == frame_of(message)
    assert take_from_kernel(ours, 0.0) == []
    if message.is_remote_frame:
        return  # we ask nobody
    put_by_kernel(ours, *taken[:2])
    assert dissect_can_frame(other.recv(72)) == dissect_can_frame(build_can_frame(message))


@pytest.mark.parametrize(
    ("protocol", "quick"), [(can.CanProtocol.CAN_20, True), (can.CanProtocol.CAN_FD, False)]
)
def test_a_kernels_bus_of_classic_frames_goes_without_python_can(kernels, protocol, quick) -> None:
    class Counted(SocketcanBus):
        """As python-can opens one, on a line that stands for the kernel's."""

        def __init__(self) -> None:
            self.socket, self._can_protocol, self.asked = ours, protocol, 0

        def send(self, msg, timeout=None):
            self.asked += 1

        def recv(self, timeout=None):
            self.asked += 1

        def __del__(self):
            """Nothing was opened."""

    ours, other = kernels
    bus = Counted()
    putting(bus)(0x123, b"out")
    other.send(build_can_frame(can.Message(arbitration_id=0x456, is_extended_id=False, data=b"in")))
    frames = taking(bus)(0.0)
    assert bus.asked == (0 if quick else 2)
    assert [frame[:2] for frame in frames] == ([(0x456, b"in")] if quick else [])


def test_a_frame_is_waited_for_as_long_as_it_may_take_to_come(kernels) -> None:
    ours, other = kernels
    start_s = time.monotonic()
    assert take_from_kernel(ours, 0.05) == []
    assert time.monotonic() - start_s >= 0.05
    late = threading.Timer(0.05, other.send, [build_can_frame(frame(0x181, b"late"))])
    late.start()
    assert take_from_kernel(ours, 10.0) == [(0x181, b"late", 0.0)]
    late.join()


def test_all_that_waits_comes_at_once_in_the_order_of_sending(kernels) -> None:
    ours, other = kernels
    for i in range(150):
        other.send(build_can_frame(frame(0x181, bytes([i]))))
    assert [data[0] for _, data, _ in take_from_kernel(ours, 0.0)] == [*range(150)]


def test_a_bus_of_python_cans_gives_all_that_waits_too() -> None:
    config = BusSection(interface="virtual", channel="test_all_that_waits")
    a, b = open_bus(config), open_bus(config)
    for i in range(5):
        putting(a)(0x181, bytes([i]))
    take = taking(b)
    assert [frame[:2] for frame in take(1.0)] == [(0x181, bytes([i])) for i in range(5)]
    assert take(0.0) == []
    a.shutdown()
    b.shutdown()


def test_frames_behind_any_number_of_foreign_datagrams_are_found(pair) -> None:
    a, b = pair
    for i in range(200):
        a.sender.send(b"what is this?")
        if i % 50 == 0:
            a.put(0x181, bytes([i]))
    heard = []
    while frames := b.take(0.2 if len(heard) < 4 else 0.0):
        heard += frames
    assert [data[0] for _, data, _ in heard] == [0, 50, 100, 150]
    assert b.malformed == 200


def _fill(bus: socket.socket) -> None:
    while True:
        put_by_kernel(bus, 0x181, bytes(8))


def test_a_kernels_bus_that_takes_no_more_is_an_error_and_is_not_waited_for(kernels) -> None:
    ours, other = kernels
    with pytest.raises(can.CanOperationError, match="cannot send: Resource temporarily"):
        _fill(ours)
    other.close()
    with pytest.raises(can.CanOperationError, match="cannot send"):
        put_by_kernel(ours, 0x181, bytes(8))
    ours.close()
    with pytest.raises(can.CanOperationError, match="cannot receive: Bad file"):
        take_from_kernel(ours, 0.0)


@pytest.fixture
def vcan() -> Iterator[str]:
    """Make a virtual CAN interface of the kernel's; skip, with its reason, where there is none."""
    name = f"vcan{random.SystemRandom().randrange(100, 1_000_000)}"
    ip = shutil.which("ip")
    if ip is None:
        pytest.skip("no `ip` to make a vcan interface with")
    for command in (["add", "dev", name, "type", "vcan"], ["set", name, "up"]):
        made = subprocess.run([ip, "link", *command], capture_output=True, text=True, check=False)
        if made.returncode:
            pytest.skip(f"no vcan here: {made.stderr.strip()}")
    yield name
    subprocess.run([ip, "link", "delete", name], check=True)


def test_frames_cross_the_kernels_virtual_can(vcan: str) -> None:
    config = BusSection(interface="socketcan", channel=vcan)
    a, b = open_bus(config), open_bus(config)
    a.send(frame(0x205, b"\x01\x02"))
    got = b.recv(2.0)
    assert got is not None
    assert (got.arbitration_id, bytes(got.data)) == (0x205, b"\x01\x02")
    assert a.recv(0) is None
    a.shutdown()
    b.shutdown()


def test_can_interfaces_are_told_from_others(tmp_path):
    for name, kind, state in (("eth0", "1", "up"), ("can0", "280", "down")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(f"{kind}\n")
        (tmp_path / name / "operstate").write_text(f"{state}\n")
    assert can_interfaces(tmp_path) == {"can0": "down"}
