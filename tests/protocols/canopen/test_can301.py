"""Emergencies, heartbeats and mapping entries, with the canopen package as independent reader."""

import canopen
import pytest
from canopen.emcy import EmcyConsumer
from hypothesis import given
from hypothesis import strategies as st
from telerobot.protocols.canopen import can301
from telerobot.protocols.canopen.can301 import EmcyCode, FrameError

U16 = st.integers(0, 0xFFFF)
U8 = st.integers(0, 0xFF)


@given(U16, U8, st.binary(min_size=5, max_size=5))
def test_an_emergency_comes_back_as_it_was_sent(code: int, register: int, rest: bytes) -> None:
    sent = can301.encode_emcy(code, register, rest)
    assert can301.decode_emcy(sent) == (code, register, rest)


@given(U16, U8, st.integers(0, 5).flatmap(lambda n: st.binary(min_size=n, max_size=n)))
def test_canopen_reads_our_emergencies(code: int, register: int, rest: bytes) -> None:
    consumer = EmcyConsumer()
    consumer.on_emcy(can301.emcy_id(3), can301.encode_emcy(code, register, rest), 0.0)
    entry = consumer.log[-1]
    assert (entry.code, entry.register, entry.data) == (code, register, rest.ljust(5, b"\0"))


@pytest.mark.parametrize("length", [0, 7, 9])
def test_an_emergency_of_another_length_is_refused(length: int) -> None:
    with pytest.raises(FrameError, match=f"{length} bytes instead of 8"):
        can301.decode_emcy(bytes(length))


def test_an_emergency_with_too_much_to_say_is_refused() -> None:
    with pytest.raises(FrameError, match="6 manufacturer's bytes"):
        can301.encode_emcy(EmcyCode.SYNC, 0, bytes(6))


@pytest.mark.parametrize(
    ("code", "name"),
    [
        (0x8611, "following error"),
        (0x8130, "heartbeat"),
        (0x0000, "no error"),
        (0x2320, "current"),
        (0xFF77, "device specific"),
        (0xF123, "additional functions"),
        (0xA000, "unknown error"),
    ],
)
def test_emergency_codes_have_names(code: int, name: str) -> None:
    assert can301.emcy_name(code) == name


def test_identifiers_are_those_of_the_predefined_connection_set() -> None:
    node = canopen.RemoteNode(5, canopen.ObjectDictionary())
    assert can301.sdo_request_id(5) == node.sdo.rx_cobid
    assert can301.sdo_reply_id(5) == node.sdo.tx_cobid
    assert (can301.tpdo1_id(5), can301.rpdo1_id(5)) == (0x185, 0x205)
    assert (can301.emcy_id(5), can301.heartbeat_id(5)) == (0x085, 0x705)


def test_a_heartbeat_is_read_without_its_toggle_bit() -> None:
    assert can301.decode_heartbeat(b"\x85") == can301.NmtState.OPERATIONAL
    with pytest.raises(FrameError, match="2 bytes instead of 1"):
        can301.decode_heartbeat(b"\x05\x00")


def test_entries_outside_their_fields_are_refused() -> None:
    assert can301.mapping_entry(0x607A, 0, 32) == 0x607A0020
    assert can301.consumer_heartbeat(127, 200) == 0x007F00C8
    with pytest.raises(ValueError, match="no such mapping entry"):
        can301.mapping_entry(0x10000, 0, 8)
    with pytest.raises(ValueError, match="no such heartbeat watch"):
        can301.consumer_heartbeat(127, 70_000)
