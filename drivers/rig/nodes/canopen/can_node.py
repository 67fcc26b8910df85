"""A simulated CANopen slave (CiA 301): network management, SDO, PDOs, SYNC, heartbeats, EMCY."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from .....protocols.canopen import can301
from .....protocols.canopen.can301 import CommunicationObject as Com
from .....protocols.canopen.can301 import EmcyCode, NmtCommand, NmtState
from .....protocols.messages.rig import RigFault
from ..link import NodeLink
from .event_pdo import EventPdo
from .objects import EDS, ObjectStore, RefusedError
from .pdo import Pdo, check_pdo_object, existing_pdos, is_pdo_object
from .sdo_server import NodeSdoServer

NEVER = float("inf")
_EPSILON_S = 1e-7
_PDO_LENGTH = 0x8210
_SELF_STARTED = {
    NmtCommand.START: NmtState.OPERATIONAL,
    NmtCommand.STOP: NmtState.STOPPED,
    NmtCommand.PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
}


class CanNode:
    """Base of every CANopen slave; a device derives from it and fills in the `on_…` methods.

    `clock` is the physics' time [s]. Frames are handled when they come; a synchronous RPDO takes
    effect at the next SYNC, after the TPDOs of that SYNC have been sampled and sent.
    """

    samples_after_step = False
    plain: frozenset[tuple[int, int]] = frozenset()
    """Objects of an RPDO that are only stored: any value will do, and `on_rpdo` reads them."""

    def __init__(
        self, node: int, link: NodeLink, clock: Callable[[], float], eds: Path = EDS
    ) -> None:
        self.node = node
        self.link = link
        self.clock = clock
        link.on_frame = self.receive
        self.objects = ObjectStore(node, self._before_write, eds)
        self._sdo = NodeSdoServer(node, self.objects, link.send)
        self.nmt = NmtState.BOOT_UP
        self.master_lost = False
        self.due_s = 0.0
        """When `tick` has something to do next [s]."""
        self._rpdos: dict[int, Pdo] | None = None
        self._tpdos: tuple[Pdo, ...] = ()
        self._events: tuple[EventPdo, ...] = ()
        self._pending: list[tuple[Pdo, bytes]] = []
        self._syncs = 0
        self._next_beat_s = NEVER
        self._master_beat_s: float | None = None

    # --- what a device fills in -----------------------------------------------------------------

    def on_reset(self, *, communication_only: bool) -> None:
        """Take the state after power-on, or after a reset of the communication."""

    def on_written(self, index: int, subindex: int, value: int) -> None:
        """An object was written, over SDO or by an RPDO. May raise `RefusedError`."""

    def on_rpdo(self, _pdo: Pdo) -> None:
        """All objects of one RPDO have been written."""

    def on_sync(self) -> None:
        """A SYNC came, and the RPDOs that waited for it have been written."""

    def on_setpoint_frame(self) -> None:
        """An RPDO came in; what it says takes effect at its own time."""

    def on_master_lost(self) -> None:
        """The master's heartbeat stopped (1016h)."""

    def on_master_back(self) -> None:
        """The master's heartbeat is there again."""

    def inject(self, fault: RigFault) -> None:
        """Apply a fault of the device itself. Raises `ValueError` for one that it has not."""
        raise ValueError(f"fault {fault.kind}: a {type(self).__name__} has no such fault")

    # --- the bus --------------------------------------------------------------------------------

    def identifiers(self) -> tuple[int, ...]:
        """Return those of its SDO server and its RPDOs."""
        rpdos = (can301.rpdo1_id(self.node) + 0x100 * i for i in range(can301.DEFAULT_PDOS))
        return (can301.sdo_request_id(self.node), *rpdos)

    def boot(self, *, communication_only: bool = False) -> None:
        """Go through initialisation: defaults, boot-up message, *Pre-operational*."""
        self.objects.reset(communication_only=communication_only)
        self._rpdos, self._pending, self._syncs = None, [], 0
        self._next_beat_s, self._master_beat_s, self.master_lost = NEVER, None, False
        self.on_reset(communication_only=communication_only)
        self.link.send(can301.heartbeat_id(self.node), bytes((NmtState.BOOT_UP,)))
        self.nmt = NmtState.PRE_OPERATIONAL
        self.due_s = 0.0

    def receive(self, can_id: int, data: bytes) -> None:
        """Handle one frame from the bus; one that is not for this node is ignored."""
        self.due_s = 0.0
        if can_id == can301.SYNC_ID:
            self._on_sync()
        elif can_id == can301.sdo_request_id(self.node):
            if self.nmt is not NmtState.STOPPED:
                self._sdo.on_request(can_id, data, self.clock())
        elif can_id == can301.NMT_ID:
            self._on_nmt(data)
        elif can_id > can301.heartbeat_id(0):
            self._on_heartbeat(can_id - can301.heartbeat_id(0))
        elif self.nmt is NmtState.OPERATIONAL:
            self._on_rpdo(can_id, data)

    def emergency(self, code: int) -> None:
        """Send an emergency message, unless the node is stopped, and keep code and register."""
        self.objects[0x603F, 0] = code
        register = 0 if code == EmcyCode.NO_ERROR else 1 | _register_bit(code)
        self.objects[Com.ERROR_REGISTER, 0] = register
        if self.nmt is not NmtState.STOPPED:
            self.link.send(can301.emcy_id(self.node), can301.encode_emcy(code, register))

    def tick(self) -> None:
        """Do what is due at this physics time; sets `due_s` to when it wants the next call."""
        now = self.clock() + _EPSILON_S
        period = self.objects[Com.PRODUCER_HEARTBEAT, 0] * 1e-3
        if period <= 0:
            self._next_beat_s = NEVER
        elif self._next_beat_s > now + period:
            self._next_beat_s = now + period
        elif now >= self._next_beat_s:
            self.link.send(can301.heartbeat_id(self.node), bytes((self.nmt,)))
            self._next_beat_s += period
        self.due_s = min(self._next_beat_s, self._watch_master(now))
        if self.nmt is NmtState.OPERATIONAL:
            self._map_pdos()
            for event in self._events:
                if not event.at_sync:
                    self._tell(event)
                    self.due_s = 0.0  # what it maps may change at any step

    def _watch_master(self, now: float) -> float:
        timeout = (self.objects[Com.CONSUMER_HEARTBEAT, 1] & 0xFFFF) * 1e-3
        if timeout <= 0 or self._master_beat_s is None or self.master_lost:
            return NEVER
        deadline = self._master_beat_s + timeout
        if now < deadline:
            return deadline
        self.master_lost = True
        self.emergency(EmcyCode.HEARTBEAT)
        self.on_master_lost()
        if self.nmt is NmtState.OPERATIONAL:
            self.nmt = NmtState.PRE_OPERATIONAL
        return NEVER

    def _on_heartbeat(self, node: int) -> None:
        if node != self.objects[Com.CONSUMER_HEARTBEAT, 1] >> 16:
            return
        self._master_beat_s = self.clock()
        if self.master_lost:
            self.master_lost = False
            self.on_master_back()

    def _on_nmt(self, data: bytes) -> None:
        if len(data) != 2 or data[1] not in (0, self.node):
            return
        command = data[0]
        if command in _SELF_STARTED:
            self.nmt = _SELF_STARTED[NmtCommand(command)]
            self._rpdos, self._pending = None, []
        elif command == NmtCommand.RESET_NODE:
            self.boot()
        elif command == NmtCommand.RESET_COMMUNICATION:
            self.boot(communication_only=True)

    def _on_sync(self) -> None:
        if self.nmt is not NmtState.OPERATIONAL:
            return
        self._map_pdos()
        self._syncs += 1
        for pdo in self._tpdos:
            if self._syncs % pdo.transmission == 0:
                self.link.send(pdo.can_id, pdo.pack(self.objects))
        for event in self._events:
            if event.at_sync:
                self._tell(event)
        pending, self._pending = self._pending, []
        for pdo, data in pending:
            self._apply(pdo, data)
        self.on_sync()

    def _on_rpdo(self, can_id: int, data: bytes) -> None:
        pdo = self._map_pdos().get(can_id)
        if pdo is None:
            return
        if len(data) < pdo.layout.size:
            self.emergency(_PDO_LENGTH)
            return
        self.on_setpoint_frame()
        if pdo.synchronous:
            self._pending = [p for p in self._pending if p[0] is not pdo] + [(pdo, data)]
        else:
            self._apply(pdo, data)

    def _apply(self, pdo: Pdo, data: bytes) -> None:
        for key, value in zip(pdo.keys, pdo.layout.unpack_from(data), strict=True):
            if key in self.plain:
                self.objects[key] = value
                continue
            with suppress(RefusedError):  # nobody asked for an answer: the old value stays
                self.objects.write(*key, value)
        self.on_rpdo(pdo)

    def _tell(self, event: EventPdo) -> None:
        data = event.due(self.objects, self.clock())
        if data is not None:
            self.link.send(event.pdo.can_id, data)

    def _map_pdos(self) -> dict[int, Pdo]:
        if self._rpdos is None:
            tpdos = existing_pdos(self.objects, receive=False)
            self._tpdos = tuple(pdo for pdo in tpdos if pdo.synchronous)
            self._events = tuple(EventPdo(pdo) for pdo in tpdos if not pdo.synchronous)
            self._rpdos = {pdo.can_id: pdo for pdo in existing_pdos(self.objects, receive=True)}
        return self._rpdos

    def _before_write(self, index: int, subindex: int, value: int) -> None:
        if is_pdo_object(index):
            check_pdo_object(self.objects, index, subindex, value)
            self._rpdos = None
        if index == Com.PRODUCER_HEARTBEAT:
            self._next_beat_s = NEVER
        self.on_written(index, subindex, value)


def _register_bit(code: int) -> int:
    """Return the bit of 1001h that an error code belongs to (CiA 301, table 46)."""
    return {0x2: 0x02, 0x3: 0x04, 0x4: 0x08, 0x8: 0x10, 0xF: 0x80}.get(code >> 12, 0)
