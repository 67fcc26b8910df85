"""Who answers on a cell's buses, asked by SDO, compared with what the cell says."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final

from ....config.load import Cell
from ....config.schema.bus import CanOpenNodeSection, Entry
from ....config.schema.mechanism import DriveSection
from ....drivers.canopen.sdo import SdoAbortError, SdoClient, SdoSilenceError, wait_for
from ....drivers.canopen.servo_setup import to_radians
from ....drivers.device import DeviceError
from ....drivers.fieldbus import Fieldbus, Fieldbuses, open_buses
from ....protocols.canopen import can301, cia402
from ....protocols.canopen.can301 import CommunicationObject as Com
from ....protocols.canopen.can301 import FrameError, emcy_name
from ....protocols.canopen.cia402 import SPAN, DriveState, Object, OperationMode
from ..findings import Finding, Severity, Value

# --- Nodes on a CAN bus, and what they hold: SDO uploads only; nothing changes, nothing moves -----
QUIET_S: Final = 0.5  # a control server is heard within so long [s]
NODES: Final = range(1, 127)
PACE_S: Final = 0.005  # between the questions to two nodes: no transmit queue overflows [s]
LATE_S: Final = 0.5  # time that the slowest answer to the last question may take [s]
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
    wait_for(fieldbus, lambda: fieldbus.trouble is not None, QUIET_S)
    if fieldbus.trouble is not None:
        raise DeviceError(f"{fieldbus.name}: {fieldbus.trouble.detail}: a control server is on it")


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
        wait_for(fieldbus, lambda: False, PACE_S)
    wait_for(fieldbus, lambda: False, LATE_S)
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


# --- Compare what one drive holds with the cell's table of it, in the joint's units ---------------
LIMIT: Final = 1e-3  # 607Dh and the cell's limits are the same within this [rad]
TORQUE: Final = 0.01  # 6076h and `rated_torque` are the same within this part [1]
_UNBOUNDED: Final = SPAN - 2
POWER_IS_OFF: Final = (
    DriveState.NOT_READY, DriveState.SWITCH_ON_DISABLED, DriveState.READY_TO_SWITCH_ON,
)  # fmt: skip


def compare(cell: Cell, name: str, drive: DriveSection, found: FoundNode) -> Iterator[Finding]:
    """Judge a drive's state, mode, position, position limits and torques."""
    joint = next(j for j in cell.robot.joints if j.name == drive.joint)
    mode = OperationMode[cell.config.mechanism.mode_of(drive).upper()]
    judged: dict[str, Judged] = {"state": _state(found), "mode": _mode(found, mode)}
    if drive.joint not in cell.config.mechanism.wheels:
        judged["position"] = _position(drive, found, joint.lower, joint.upper)
        judged["607Dh"] = _limits(drive, found, joint.lower, joint.upper)
    judged["torque"] = _torque(drive, found)
    for what, (status, text, values) in judged.items():
        yield Finding(f"{name} {what}", status, text, values)


Judged = tuple[Severity, str, dict[str, Value]]


def _state(found: FoundNode) -> Judged:
    word, code = found.get(Object.STATUSWORD), found.get(Object.ERROR_CODE) or 0
    if word is None:
        return Severity.ERROR, "6041h cannot be read: is it a CiA 402 drive?", {}
    try:
        state = cia402.decode_state(word)
    except FrameError as error:
        return Severity.ERROR, str(error), {"statusword": word}
    text = state.name.lower().replace("_", " ")
    status = Severity.OK
    if state.in_fault or code:
        status, text = Severity.WARN, f"{text}, 603Fh {code:04X}h: {emcy_name(code)}"
    elif state not in POWER_IS_OFF:
        status, text = Severity.ERROR, f"{text}: its power is on, and nobody here has asked for it"
    register = found.get(Com.ERROR_REGISTER) or 0
    return status, text, {"statusword": word, "code": code, "register": register}


def _mode(found: FoundNode, mode: OperationMode) -> Judged:
    supported = found.get(Object.SUPPORTED_MODES)
    if supported is None:
        return Severity.ERROR, "6502h cannot be read: no mode is known", {}
    has = cia402.supports_mode(supported, mode)
    text = f"{mode.name} {'is' if has else 'is not'} among its modes, 6502h {supported:#x}"
    return Severity.OK if has else Severity.ERROR, text, {"supported": supported}


def _position(drive: DriveSection, found: FoundNode, lower: float, upper: float) -> Judged:
    counts = found.get(Object.POSITION_ACTUAL)
    if counts is None:
        return Severity.ERROR, "6064h cannot be read", {}
    angle = to_radians(drive, counts)
    text = f"{angle:.4f} rad ({counts} counts), limits {lower:.4g} to {upper:.4g}"
    values: dict[str, Value] = {"counts": counts, "angle": angle}
    if lower - LIMIT <= angle <= upper + LIMIT:
        return Severity.OK, text, values
    return Severity.ERROR, f"{text}: is counts_per_radian, direction or zero_rad wrong?", values


def _limits(drive: DriveSection, found: FoundNode, lower: float, upper: float) -> Judged:
    low, high = (found.get(Object.POSITION_LIMIT, sub) for sub in (1, 2))
    if low is None or high is None:
        text = "cannot be read; the daemon writes it before it enables the drive"
        return Severity.ERROR, text, {}
    ends = sorted((to_radians(drive, low), to_radians(drive, high)))
    values: dict[str, Value] = {"lower": ends[0], "upper": ends[1]}
    if low >= high or high - low >= _UNBOUNDED:
        text = f"holds no limits; the daemon will write {lower:.4g} to {upper:.4g} rad"
        return Severity.OK, text, values
    text = f"{ends[0]:.4g} to {ends[1]:.4g} rad"
    if max(abs(ends[0] - lower), abs(ends[1] - upper)) <= LIMIT:
        return Severity.OK, text, values
    text += (
        f", the cell says {lower:.4g} to {upper:.4g}: which of them is right, or is the "
        "joint's scale wrong? The daemon writes the cell's"
    )
    return Severity.ERROR, text, values


def _torque(drive: DriveSection, found: FoundNode) -> Judged:
    rated, most = found.get(Object.RATED_TORQUE), found.get(Object.MAX_TORQUE)
    if not rated:
        text = "6076h cannot be read: what 6077h calls 1000 has to come from the data sheet"
        return Severity.WARN, text, {}
    torque = rated * 1e-3
    text = f"6076h {torque:g} N·m, the cell's rated_torque {drive.rated_torque:g} at the joint"
    status = Severity.OK
    if abs(torque - drive.rated_torque) > TORQUE * drive.rated_torque:
        status = Severity.WARN
        text += f": right behind a gear of {drive.rated_torque / torque:.4g}, and of no other"
    bound = None if most is None else most * 1e-3 * drive.rated_torque
    if bound is not None and bound < drive.max_torque * (1.0 - TORQUE):
        status = Severity.WARN
        text += f"; 6072h stops at {bound:.4g} N·m, below max_torque {drive.max_torque:g}"
    return status, text, {"rated": torque, "max_per_mille": most}


# --- Compare who is on a cell's buses with the cell: `telerobot check CELL --bus` -----------------
_IO: Final = (401, "input/output module")
FIELDS: Final = ("vendor", "product", "revision", "serial")


def on_bus(cell: Cell, clock: Callable[[], float]) -> list[Finding]:
    """Open the buses, ask everybody, and compare. Raises `DeviceError`."""
    buses = open_buses(cell, clock)
    try:
        return list(compared(cell, buses))
    finally:
        buses.close()


def compared(cell: Cell, buses: Fieldbuses) -> Iterator[Finding]:
    """Compare every bus. Raises `DeviceError` where another master is on one."""
    for config, fieldbus in zip(cell.config.fieldbuses, buses, strict=True):
        listen_for_masters(fieldbus)
        there = nodes_on(fieldbus)
        entries = [entry for entry in cell.devices if entry.bus == config.name]
        known = {e.section.node: e for e in entries if isinstance(e.section, CanOpenNodeSection)}
        told = ", ".join(map(str, there)) or "none"
        status = Severity.OK if there else Severity.ERROR
        yield Finding(config.label, status, f"nodes that answer: {told}", {"nodes": len(there)})
        strangers = [node for node in there if node not in known]
        for entry in entries:
            yield from _device(cell, fieldbus, entry, there, strangers)
        for node in strangers:
            found = read_node(fieldbus, node, drive=False)
            text = f"answers, and is not in the cell: {_words(found)}"
            yield Finding(f"node {node}", Severity.WARN, text, {"node": node})


def _device(
    cell: Cell, fieldbus: Fieldbus, entry: Entry, there: list[int], strangers: list[int]
) -> Iterator[Finding]:
    section = entry.section
    if not isinstance(section, CanOpenNodeSection):
        yield Finding(entry.name, Severity.OK, "is no CANopen node, and was not asked")
        return
    if section.node not in there:
        text = f"node {section.node} does not answer"
        if strangers:
            text += f"; not in the cell, but there: {', '.join(map(str, strangers))}"
        yield Finding(f"{entry.name} node", Severity.ERROR, text, {"node": section.node})
        return
    try:
        found = read_node(fieldbus, section.node, drive=isinstance(section, DriveSection))
    except SdoSilenceError as error:
        yield Finding(f"{entry.name} node", Severity.ERROR, str(error), {"node": section.node})
        return
    yield _identity(entry, section, found)
    if isinstance(section, DriveSection):
        part = cell if entry.part is None else cell.parts[entry.part]
        yield from compare(part, entry.name, section, found)


def _identity(entry: Entry, section: CanOpenNodeSection, found: FoundNode) -> Finding:
    wrong = []
    profile = (found.get(Com.DEVICE_TYPE) or 0) & 0xFFFF
    number, name = (402, "servo drive") if isinstance(section, DriveSection) else _IO
    if profile != number:
        wrong.append(f"profile {profile} in 1000h, a {name} has {number}")
    for place, key in enumerate(FIELDS, 1):
        wanted = None if section.identity is None else getattr(section.identity, key)
        value = found.get(Com.IDENTITY, place)
        if wanted is not None and value != wanted:
            has = "none" if value is None else f"{value:#x}"
            wrong.append(f"{key} {has}, the cell says {wanted:#x}")
    text = f"node {section.node}: {_words(found)}"
    status = Severity.ERROR if wrong else Severity.OK
    values = {"node": section.node} | {
        key: found.get(Com.IDENTITY, place) for place, key in enumerate(FIELDS, 1)
    }
    return Finding(f"{entry.name} identity", status, "; ".join((text, *wrong)), values)


def _words(found: FoundNode) -> str:
    pairs = [(key, found.get(Com.IDENTITY, place)) for place, key in enumerate(FIELDS, 1)]
    parts = [f"{key} {value:#x}" for key, value in pairs if value is not None]
    return ", ".join(([found.name] if found.name else []) + parts) or "it tells nothing of itself"
