"""The drive's state machine and PDOs, with the canopen package as independent reader."""

import struct

import canopen
import pytest
from canopen.objectdictionary import ODVariable
from canopen.objectdictionary.datatypes import INTEGER16, INTEGER32, UNSIGNED16
from canopen.pdo.base import PdoMap
from canopen.profiles.p402 import State402
from hypothesis import given
from hypothesis import strategies as st
from telerobot.protocols.canopen import cia402
from telerobot.protocols.canopen.can301 import FrameError
from telerobot.protocols.canopen.cia402 import (
    Controlword,
    DriveState,
    Object,
    OperationMode,
    Status,
)

U16 = st.integers(0, 0xFFFF)
I16 = st.integers(-(2**15), 2**15 - 1)
I32 = st.integers(-(2**31), 2**31 - 1)
STATES = st.sampled_from(DriveState)
ENABLED = DriveState.OPERATION_ENABLED
DISABLED = DriveState.SWITCH_ON_DISABLED

TYPES = {
    Object.CONTROLWORD: UNSIGNED16,
    Object.STATUSWORD: UNSIGNED16,
    Object.TARGET_POSITION: INTEGER32,
    Object.POSITION_ACTUAL: INTEGER32,
    Object.TARGET_TORQUE: INTEGER16,
    Object.TORQUE_ACTUAL: INTEGER16,
}
NAMES = {
    "SWITCH ON DISABLED": DriveState.SWITCH_ON_DISABLED,
    "READY TO SWITCH ON": DriveState.READY_TO_SWITCH_ON,
    "SWITCHED ON": DriveState.SWITCHED_ON,
    "OPERATION ENABLED": DriveState.OPERATION_ENABLED,
    "QUICK STOP ACTIVE": DriveState.QUICK_STOP_ACTIVE,
    "FAULT REACTION ACTIVE": DriveState.FAULT_REACTION_ACTIVE,
    "FAULT": DriveState.FAULT,
}


def read_with_canopen(mapping: tuple[int, ...], data: bytes) -> list[int]:
    """Decode a PDO with canopen's own map, built from our mapping entries alone."""
    dictionary = canopen.ObjectDictionary()
    for index, kind in TYPES.items():
        variable = ODVariable(index.name, index, 0)
        variable.data_type = kind
        dictionary.add_object(variable)
    node = canopen.RemoteNode(1, dictionary)
    pdo = PdoMap(node.tpdo, None, None)
    for entry in mapping:
        pdo.add_variable(entry >> 16, entry >> 8 & 0xFF, entry & 0xFF)
    assert len(pdo.data) == len(data)
    pdo.data = bytearray(data)
    return [int(variable.raw) for variable in pdo]


@given(STATES, U16)
def test_every_state_is_read_back_whatever_the_other_bits_say(
    state: DriveState, other: int
) -> None:
    statusword = cia402.STATE_BITS[state] | (other & ~0x6F)
    assert cia402.decode_state(statusword) is state


@given(U16)
def test_canopen_reads_the_same_state_from_a_statusword(statusword: int) -> None:
    theirs = {
        NAMES[name]
        for name, (mask, value) in State402.SW_MASK.items()
        if name in NAMES and statusword & mask == value
    }
    try:
        ours = cia402.decode_state(statusword)
    except FrameError:
        assert theirs == set()
    else:
        assert theirs == ({ours} - {DriveState.NOT_READY})


def test_bits_that_mean_no_state_are_an_error() -> None:
    with pytest.raises(FrameError, match="0x0001 means no state"):
        cia402.decode_state(0x0001)


def walk(state: DriveState, target: DriveState) -> list[DriveState]:
    """Step a drive by the controlwords that the driver would send."""
    path = [state]
    previous = 0
    for _ in range(6):
        word = cia402.next_controlword(path[-1], target)
        path.append(cia402.apply_controlword(path[-1], previous, word))
        previous = word
    return path


def test_the_controlwords_lead_to_operation_enabled_without_skipping_a_state() -> None:
    path = walk(DISABLED, ENABLED)
    assert path[:4] == [
        DISABLED,
        DriveState.READY_TO_SWITCH_ON,
        DriveState.SWITCHED_ON,
        ENABLED,
    ]
    assert set(path[3:]) == {ENABLED}


@pytest.mark.parametrize(
    "start", [ENABLED, DriveState.SWITCHED_ON, DriveState.READY_TO_SWITCH_ON, DISABLED]
)
def test_the_controlwords_lead_back_to_disabled(start: DriveState) -> None:
    assert walk(start, DISABLED)[-1] is DISABLED


@given(st.sampled_from([ENABLED, DISABLED]))
def test_a_quick_stop_under_way_is_not_cut_short(target: DriveState) -> None:
    assert set(walk(DriveState.QUICK_STOP_ACTIVE, target)) == {DriveState.QUICK_STOP_ACTIVE}


def test_only_the_two_ends_can_be_asked_for() -> None:
    with pytest.raises(ValueError, match="SWITCHED_ON is not a state"):
        cia402.next_controlword(DISABLED, DriveState.SWITCHED_ON)


def test_only_the_rising_edge_resets_a_fault() -> None:
    fault = DriveState.FAULT
    assert cia402.apply_controlword(fault, 0x00, Controlword.FAULT_RESET) is DISABLED
    assert cia402.apply_controlword(fault, 0x80, 0x80) is fault
    assert cia402.apply_controlword(fault, 0x80, 0x0F) is fault
    assert cia402.apply_controlword(DriveState.FAULT_REACTION_ACTIVE, 0, 0x80) is (
        DriveState.FAULT_REACTION_ACTIVE
    )


@pytest.mark.parametrize(
    ("state", "word", "after"),
    [
        (ENABLED, Controlword.QUICK_STOP, DriveState.QUICK_STOP_ACTIVE),
        (ENABLED, Controlword.SHUTDOWN, DriveState.READY_TO_SWITCH_ON),
        (ENABLED, Controlword.DISABLE_VOLTAGE, DISABLED),
        (ENABLED, Controlword.SWITCH_ON, DriveState.SWITCHED_ON),
        (DriveState.SWITCHED_ON, Controlword.QUICK_STOP, DISABLED),
        (DriveState.QUICK_STOP_ACTIVE, Controlword.DISABLE_VOLTAGE, DISABLED),
        (DISABLED, Controlword.ENABLE_OPERATION, DISABLED),
        (DriveState.NOT_READY, Controlword.SHUTDOWN, DriveState.NOT_READY),
    ],
)
def test_transitions(state: DriveState, word: Controlword, after: DriveState) -> None:
    assert cia402.apply_controlword(state, 0, word) is after


@given(U16, I32)
def test_canopen_reads_our_position_setpoint(word: int, target: int) -> None:
    data = cia402.COMMAND[OperationMode.CSP].pack(word, target)
    assert read_with_canopen(cia402.CSP_MAPPING, data) == [word, target]


@given(U16, I16)
def test_canopen_reads_our_torque_setpoint(word: int, target: int) -> None:
    data = cia402.COMMAND[OperationMode.CST].pack(word, target)
    assert read_with_canopen(cia402.CST_MAPPING, data) == [word, target]


@given(U16, I32, I16)
def test_canopen_reads_our_feedback(word: int, position: int, torque: int) -> None:
    data = cia402.FEEDBACK.pack(word, position, torque)
    assert read_with_canopen(cia402.FEEDBACK_MAPPING, data) == [word, position, torque]
    assert cia402.unpack_feedback(data) == (word, position, torque)


@given(st.integers(0, 8).flatmap(lambda n: st.binary(min_size=n, max_size=n)))
def test_feedback_of_another_length_is_refused(data: bytes) -> None:
    if len(data) == 8:
        cia402.unpack_feedback(data)
        return
    with pytest.raises(FrameError, match=f"{len(data)} bytes instead of 8"):
        cia402.unpack_feedback(data)


def test_numbers_too_large_for_their_field_are_never_wrapped() -> None:
    with pytest.raises(struct.error):
        cia402.COMMAND[OperationMode.CSP].pack(0, 2**31)
    with pytest.raises(struct.error):
        cia402.COMMAND[OperationMode.CST].pack(0, 2**15)


def test_supported_modes_and_status_bits() -> None:
    assert cia402.supports_mode(1 << 7, OperationMode.CSP)
    assert not cia402.supports_mode(1 << 7, OperationMode.CST)
    assert Status.FOLLOWING_ERROR | Status.FOLLOWS_COMMAND == 0x3000
