"""Nodes on a CAN bus, and what they hold: SDO uploads only; nothing changes, nothing moves."""

from dataclasses import dataclass, field
from typing import Final

from ....drivers.device import DeviceError
from ....drivers.fieldbus import Fieldbus
from ....protocols.canopen import can301
from ....protocols.canopen.can301 import CommunicationObject as Com
from ....protocols.canopen.cia402 import Object
from .sdo_client import SdoAbortError, SdoClient, SdoSilenceError

QUIET_S: Final = 0.5
"""A control server is heard within so long [s]."""
NODES: Final = range(1, 127)
PACE_S: Final = 0.005
"""Between the questions to two nodes: no transmit queue overflows [s]."""
LATE_S: Final = 0.5
"""Time that the slowest answer to the last question may take [s]."""
_NAME: Final = 0x1008

Key = tuple[int, int]

OF_ANY: Final[tuple[Key, ...]] = (
    (Com.DEVICE_TYPE, 0), (Com.ERROR_REGISTER, 0),
    (Com.IDENTITY, 1), (Com.IDENTITY, 2), (Com.IDENTITY, 3), (Com.IDENTITY, 4),
)  # fmt: skip
OF_A_DRIVE: Final[tuple[Key, ...]] = (
    (Object.ERROR_CODE, 0), (Object.STATUSWORD, 0), (Object.SUPPORTED_MODES, 0),
    (Object.POSITION_ACTUAL, 0), (Object.POSITION_LIMIT, 1), (Object.POSITION_LIMIT, 2),
    (Object.RATED_TORQUE, 0), (Object.MAX_TORQUE, 0), (Object.QUICK_STOP_OPTION, 0),
    (Object.QUICK_STOP_DECELERATION, 0), (Object.FOLLOWING_WINDOW, 0),
)  # fmt: skip
_SIGNED: Final = frozenset(
    ((Object.POSITION_ACTUAL, 0), (Object.POSITION_LIMIT, 1), (Object.POSITION_LIMIT, 2))
)


@dataclass(frozen=True)
class FoundNode:
    """One node that answered: the objects that it has, by index and sub-index."""

    node: int
    name: str
    values: dict[Key, int] = field(default_factory=dict)

    def get(self, index: int, subindex: int = 0) -> int | None:
        """Return an object's value; None where the node has none."""
        return self.values.get((index, subindex))


def listen_for_masters(fieldbus: Fieldbus) -> None:
    """Listen whether somebody commands on the bus. Raises `DeviceError`."""
    deadline = fieldbus.clock() + QUIET_S
    while fieldbus.trouble is None and fieldbus.clock() < deadline:
        fieldbus.wait_until(lambda: fieldbus.trouble is not None, deadline - fieldbus.clock())
    if fieldbus.trouble is not None:
        raise DeviceError(f"{fieldbus.name}: {fieldbus.trouble.detail}")


def nodes_on(fieldbus: Fieldbus) -> list[int]:
    """Return the nodes that answer to a question for 1000h. Raises `DeviceError`."""
    heard: set[int] = set()
    for node in NODES:
        fieldbus.listen(can301.sdo_reply_id(node), lambda _d, _s, node=node: heard.add(node))  # type: ignore[misc]  # a default that is bound
    for node in NODES:
        question = b"\x40" + int(Com.DEVICE_TYPE).to_bytes(2, "little") + bytes(5)
        if not fieldbus.send(can301.sdo_request_id(node), question):
            why = fieldbus.trouble.detail if fieldbus.trouble else "cannot send"
            raise DeviceError(f"{fieldbus.name}: {why}: is the bus up, and is anybody on it?")
        _pass(fieldbus, PACE_S)
    _pass(fieldbus, LATE_S)
    return sorted(heard)


def read_node(fieldbus: Fieldbus, node: int, *, drive: bool) -> FoundNode:
    """Read a node's identity, and a drive's limits. Raises `SdoSilenceError`."""
    client = SdoClient(fieldbus, node)
    values: dict[Key, int] = {}
    for key in (*OF_ANY, *(OF_A_DRIVE if drive else ())):
        try:
            values[key] = client.number(*key, signed=key in _SIGNED)
        except SdoAbortError:
            continue  # it does not have that one
    try:
        name = client.read(_NAME).decode("ascii", "replace").strip("\0 ")
    except (SdoAbortError, SdoSilenceError):
        name = ""
    return FoundNode(node, name, values)


def _pass(fieldbus: Fieldbus, seconds: float) -> None:
    deadline = fieldbus.clock() + seconds
    while fieldbus.clock() < deadline:
        fieldbus.wait_until(lambda: False, deadline - fieldbus.clock())
