"""One bus of the rig: which nodes hear which identifier, and whether it is plugged in."""

from collections import deque

import can

from ....protocols.canopen import can301
from ...bus import STANDARD, BusErrors, Frame, descriptor_of, putting, taking
from .canopen import CanNode
from .node import Node, NodeLink


class Wire:
    """Passes frames between a bus and the nodes on it."""

    def __init__(self, name: str, bus: can.BusABC) -> None:
        self.name = name
        self.plugged = True
        """False: nothing passes in either direction, a fault."""
        self.sync_count = 0
        self.lost = 0
        """Frames that could not be sent: the interface was down, or its queue full [1]."""
        self.stranger: int | None = None
        """Node of which somebody else sends the heartbeat, as last heard."""
        self._bus = bus
        self._put, self._take = putting(bus), taking(bus)
        self._waiting: deque[Frame] = deque()
        """Data frames that were taken, and wait for the nodes."""
        self._everyone: tuple[NodeLink, ...] = ()
        self._own_beats: set[int] = set()
        self._routes: dict[int, tuple[NodeLink, ...]] = {can301.NMT_ID: (), can301.SYNC_ID: ()}

    def add(self, node: Node) -> None:
        """Wire a node to the bus. Raises `ValueError` for a second one with a node id."""
        heard = node.identifiers()
        if isinstance(node, CanNode):
            self._everyone = (*self._everyone, node.link)
            beat = can301.heartbeat_id(node.node)
            if beat in self._own_beats:
                raise ValueError(f"bus {self.name}: two devices have the same node id {node.node}")
            self._own_beats.add(beat)
            heard = (can301.NMT_ID, can301.SYNC_ID, *heard)
        for can_id in heard:
            self._routes[can_id] = (*self._routes.get(can_id, ()), node.link)

    def send(self, can_id: int, data: bytes) -> None:
        """Send a node's frame."""
        if not self.plugged:
            return
        try:
            self._put(can_id, data)
        except BusErrors:
            self.lost += 1  # hardware speaks to nobody, and goes on

    @property
    def descriptor(self) -> int:
        """Descriptor of the bus to select on, -1 where the interface has none."""
        return descriptor_of(self._bus)

    @property
    def stamp(self) -> float | None:
        """Stamp of the next data frame that waits on the bus [s], None when there is none."""
        return self._waiting[0][2] if self._waiting or self._fill() else None

    def take(self) -> Frame | None:
        """Return the next data frame that waits on the bus, None when there is none."""
        return self._waiting.popleft() if self._waiting or self._fill() else None

    def _fill(self) -> bool:
        """Take data frames that wait on the bus; return whether there are any."""
        while not self._waiting:
            try:
                frames = self._take(0.0)
            except BusErrors:
                return False
            if not frames:
                return False
            if self.plugged:
                self._waiting.extend([frame for frame in frames if frame[0] <= STANDARD])
        return True

    def deliver(self, can_id: int, data: bytes) -> None:
        """Hand a frame to every node that hears it; one that only nodes of theirs send, to none."""
        if can_id in self._own_beats:
            self.stranger = can_id - can301.heartbeat_id(0)
            return
        if can_id == can301.SYNC_ID:
            self.sync_count += 1
        links = self._routes.get(can_id)
        if links is None:
            if can_id <= can301.heartbeat_id(0):
                return
            links = self._everyone
        for link in links:
            link.deliver(can_id, data)
