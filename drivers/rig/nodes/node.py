"""The contract of simulated devices, the parts they are made of, and their connection to a bus."""

from collections.abc import Callable, Sequence
from typing import Protocol, Self

import numpy as np

from ....config.schema.bus import Entry
from ....config.schema.rig import RigSection
from ....protocols.messages.rig import RigFault, value_of
from ..physics.world import World
from .drive_loops import DriveLoops

# --- A simulated node's connection to the bus, and what can go wrong with it ----------------------

LONGEST_DELAY_S = 10.0
"""A frame that is later than this might as well be lost [s]."""

Frame = tuple[int, bytes]
"""Identifier, data."""


class Sender(Protocol):
    """Sends frames: the rig's end of a bus."""

    def send(self, can_id: int, data: bytes, /) -> None:
        """Send a frame."""
        ...


class NodeLink:
    """A node's link to its bus: all it sends and hears passes through here, faults included.

    `silent`: neither sends nor hears. `drop`, `corrupt`: probability per frame, each direction;
    a corrupted frame has one bit turned. `delay_s`: frames are late by so much physics time.
    Random draws come from `rng` only while a fault asks for them.
    """

    def __init__(self, bus: Sender, clock: Callable[[], float], rng: np.random.Generator) -> None:
        self._bus = bus
        self._clock = clock
        self._rng = rng
        self.late: list[tuple[float, bool, Frame]] = []
        """Frames under way: when they arrive [s], whether they go outward."""
        self._disturbed = False
        """Whether there was ever a fault: without any, nothing is looked at on the way."""
        self.on_frame: Callable[[int, bytes], None] = _ignore
        self.silent = False
        self.drop = 0.0
        self.corrupt = 0.0
        self.delay_s = 0.0

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame, if the faults let it through."""
        if self._disturbed:
            self._pass(can_id, data, outward=True)
        else:
            self._bus.send(can_id, data)

    def deliver(self, can_id: int, data: bytes) -> None:
        """Hand the node a frame from the bus, if the faults let it through."""
        if self._disturbed:
            self._pass(can_id, data, outward=False)
        else:
            self.on_frame(can_id, data)

    def disturb(self, fault: RigFault) -> None:
        """Apply a fault of the connection, or take it back. Raises `ValueError` for a bad value."""
        self._disturbed = True
        if fault.kind == "silence":
            self.silent = fault.on
        elif fault.kind == "delay":
            if fault.on and fault.value is None:
                raise ValueError("fault delay: give its value in seconds")
            self.delay_s = value_of(fault, 0.0, LONGEST_DELAY_S, "s") if fault.on else 0.0
        else:
            share = value_of(fault, 0.0, 1.0, "of all frames", default=1.0)
            setattr(self, fault.kind, share if fault.on else 0.0)

    def flush(self) -> None:
        """Let go of the late frames whose time has come, in order."""
        now = self._clock() + 1e-9
        while self.late and self.late[0][0] <= now:
            _, outward, frame = self.late.pop(0)
            if not self.silent:
                self._hand_on(frame, outward)

    def _pass(self, can_id: int, data: bytes, *, outward: bool) -> None:
        if self.silent:
            return
        if self.drop > 0 and self._rng.random() < self.drop:
            return
        if self.corrupt > 0 and data and self._rng.random() < self.corrupt:
            data = self._flip(data)
        if self.delay_s > 0 or self.late:
            self.late.append((self._clock() + self.delay_s, outward, (can_id, data)))
        else:
            self._hand_on((can_id, data), outward)

    def _flip(self, data: bytes) -> bytes:
        bit = int(self._rng.integers(8 * len(data)))
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        return bytes(changed)

    def _hand_on(self, frame: Frame, outward: bool) -> None:
        can_id, data = frame
        if outward:
            self._bus.send(can_id, data)
        else:
            self.on_frame(can_id, data)


def _ignore(_can_id: int, _data: bytes) -> None:
    """Stand in until the node has taken its place."""


# --- Parts that simulated nodes are made of: physics, connection, random generators ---------------


class Bench:
    """Gives every node of a cell its parts; random generators are dealt in the order of asking."""

    def __init__(
        self,
        rigs: Sequence[RigSection],
        joints: Sequence[str],
        world: World,
        loop: DriveLoops,
        clock: Callable[[], float],
    ) -> None:
        """Take what the cell says of each mechanism's hardware, and the names of all joints."""
        self.world, self.loop, self.clock = world, loop, clock
        self.wire: Sender
        """Bus of the node that is being made."""
        self._rigs = tuple(rigs)
        self._joints = {name: i for i, name in enumerate(joints)}
        self._seeds = np.random.SeedSequence(rigs[0].seed)

    def rig(self, entry: Entry) -> RigSection:
        """Return what the cell says of the hardware of a device's mechanism."""
        return self._rigs[entry.part or 0]

    def joint(self, entry: Entry) -> int:
        """Return the place of a drive's joint in `loop` and `world`."""
        return self._joints[entry.name]

    def rng(self) -> np.random.Generator:
        """Return a random generator of its own."""
        return np.random.default_rng(self._seeds.spawn(1)[0])

    def link(self) -> NodeLink:
        """Return the node's connection to its bus."""
        return NodeLink(self.wire, self.clock, self.rng())


# --- The contract of simulated devices, by which the rig boots, steps and disturbs them -----------


class Node(Protocol):
    """One simulated device on a bus."""

    link: NodeLink
    due_s: float
    """Physics time at which `tick` has something to do next [s]."""
    samples_after_step: bool
    """`tick` comes after the physics of a step, not before it."""

    @classmethod
    def from_bench(cls, entry: Entry, bench: Bench) -> Self:
        """Make the node of a device with the parts that the bench gives."""
        ...

    def identifiers(self) -> tuple[int, ...]:
        """Return the CAN identifiers that it hears."""
        ...

    def boot(self) -> None:
        """Go through power-on."""
        ...

    def tick(self) -> None:
        """Do what is due at this physics time."""
        ...

    def inject(self, fault: RigFault) -> None:
        """Apply a fault of the device itself, or take it back.

        Raises `ValueError`, in one line, for a fault that such a device does not have.
        """
        ...
