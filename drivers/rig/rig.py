"""The virtual hardware of one cell: devices on its CAN buses, and the physics they move.

It meets the daemon on the bus and nowhere else. Time is the physics' own: `step` makes it pass.
"""

import math
import select
import time
from collections import deque
from collections.abc import Callable
from importlib import import_module
from typing import Final

import can

from ...config.load import Cell
from ...config.schema.bus import Entry
from ...protocols.canopen.cia402 import DriveState
from ...protocols.messages.messages import Vector6
from ...protocols.messages.perception import RigMotion
from ...protocols.messages.rig import FARTHEST, ArmTruth, BeamTruth, RigFault, RigTruth, vector_of
from ..bus import Frame
from ..kinds import KINDS as DEVICES
from .faults import Faults
from .nodes.drive_loops import DriveLoops
from .nodes.node import Bench, Node
from .nodes.sensors import NAME as SCANNER
from .nodes.sensors import SimulatedScanner
from .nodes.servo import SimulatedDrive
from .nodes.wire import Wire
from .physics.beam import Beam
from .physics.clearance import SightLines
from .physics.geoms import quaternion
from .physics.movers import Movers
from .physics.scene import prefixes, turned_by
from .physics.sensors import KINDS, Tags
from .physics.world import Vector, World

_STATE_NAMES: Final = {state: state.name.lower() for state in DriveState}
SYNC_STAMPS = 1 << 16
"""So many of the newest SYNC stamps are kept [1]."""


class Rig:
    """All simulated nodes of a cell, booted, brakes closed, at the posture `start`.

    `buses` are those of the cell, in its order. Runs are equal to the last bit when cell, frames
    and faults are. Raises `ValueError` for a cell without `[rig]`, or with two nodes of one id on a
    bus.
    """

    def __init__(self, cell: Cell, *buses: can.BusABC) -> None:
        config = cell.config
        self.world = World(cell)
        parts = [part.config for part in cell.parts]
        rigs = [part.rig for part in parts if part.rig is not None]
        rig = rigs[0]
        self.period_s = config.timing.period_s
        self.dt = rig.physics_step_s
        self.sync_count = 0
        self.sync_stamps: deque[float] = deque(maxlen=SYNC_STAMPS)
        """Physics time of the newest SYNCs [s], of all buses at once."""
        self.on_sync: Callable[[], None] = _ignore
        """Called at every SYNC, after the nodes have sampled."""
        self.unseen: set[str] = set()
        """Frames that may move and of which no sensor tells: a fault, `silence`."""
        self._steps = 0
        self.time_s = 0.0
        """Physics time since the start [s]."""
        drives = [part.mechanism.drives for part in parts]
        self._loop = DriveLoops([(d, r.drive) for d, r in zip(drives, rigs, strict=True)], self.dt)
        self._wires = tuple(
            Wire(c.name, bus) for c, bus in zip(config.fieldbuses, buses, strict=True)
        )
        by_name = {wire.name: wire for wire in self._wires}
        bench = Bench(rigs, cell.joints, self.world, self._loop, self.now)
        self.nodes: dict[str, Node] = {}
        """Simulated devices by name, in the order of the cell's."""
        for entry in cell.devices:
            bench.wire = by_name[entry.bus]
            self.nodes[entry.name] = node = _node(entry, bench)
            bench.wire.add(node)
        nodes = tuple(self.nodes.values())
        self.drives = {k: n for k, n in self.nodes.items() if isinstance(n, SimulatedDrive)}
        self.scanner = SimulatedScanner.of(cell, self.world)
        """The laser scanner; None where there is none."""
        self.tags = Tags(rig.tags)
        self._movers = Movers(cell)
        self._moving = frozenset(config.frames.moving)
        self._T_world_carrier = cell.config.frames.T_world_carrier
        self._sight = SightLines(cell, self.world.model, self.world.data)
        self._faults = Faults(self.world, self.nodes, by_name, prefixes(cell))
        self._names = tuple(part.mechanism.name for part in parts)
        self._before = tuple(node for node in nodes if not node.samples_after_step)
        self._after = tuple(node for node in nodes if node.samples_after_step)
        self._links = [node.link for node in nodes]
        for node in nodes:
            node.boot()

    def now(self) -> float:
        """Return `time_s`."""
        return self.time_s

    def poll(self) -> None:
        """Handle every frame that waits on a bus."""
        while (heard := self.receive()) is not None:
            self.handle(*heard)

    @property
    def due_s(self) -> float:
        """Physics time until which nothing is sent that no frame asks for [s]."""
        if self.scanner is not None:
            return self.time_s
        late = [link.late[0][0] for link in self._links if link.late]
        return min(*late, *(node.due_s for node in self.nodes.values()))

    def wait(self, seconds: float) -> None:
        """Block until a frame may have come, for so long at most [s].

        Where a bus has nothing to select on, for a physics step at most.
        """
        descriptors = [wire.descriptor for wire in self._wires]
        if -1 in descriptors:
            time.sleep(min(seconds, self.dt))
        else:
            select.select(descriptors, [], [], seconds)

    def receive(self) -> tuple[Wire, Frame] | None:
        """Return the oldest frame that waits, and its bus; None when there is none."""
        if len(self._wires) == 1:
            wire = self._wires[0]
            frame = wire.take()
            return None if frame is None else (wire, frame)
        stamps = [(stamp, i) for i, w in enumerate(self._wires) if (stamp := w.stamp) is not None]
        if not stamps:
            return None
        wire = self._wires[min(stamps)[1]]
        frame = wire.take()
        return None if frame is None else (wire, frame)

    def handle(self, wire: Wire, frame: Frame, ahead_s: float = 0.0) -> None:
        """Handle a frame that was sent `ahead_s` after the newest step [s]."""
        self.world.ahead_s = ahead_s
        wire.deliver(frame[0], frame[1])
        if wire.sync_count > self.sync_count:  # on the first bus that it came on
            self.sync_count = wire.sync_count
            self.sync_stamps.append(self.time_s + ahead_s)
            self.on_sync()

    def step(self) -> None:
        """Advance nodes, position loops and physics by one physics step."""
        now = self.time_s + 1e-7
        for link in self._links:
            if link.late:
                link.flush()
        beyond = self._loop.beyond
        for node in self._before:
            if beyond or node.due_s <= now:
                node.tick()
        world = self.world
        if self._movers.by_name:
            self._movers.step()
            if "platform" in self._movers.by_name:
                world.place_platform(self._movers.by_name["platform"].place)
        world.step(self._loop.step(world.q, world.dq))
        self._steps += 1
        self.time_s = self._steps * self.dt
        if self.scanner is not None:
            self.scanner.step(self.time_s)
        for node in self._after:
            if node.due_s <= self.time_s + 1e-7:
                node.tick()

    def advance(self, seconds: float) -> None:
        """Advance by whole physics steps, as many as are nearest to `seconds`."""
        for _ in range(round(seconds / self.dt)):
            self.step()

    @property
    def frames(self) -> dict[str, Vector6]:
        """Where Base and Carrier truly are in World, where these may move."""
        poses: dict[str, Vector6] = {}
        if self.world.rolls or "platform" in self._movers.by_name:
            poses["base"] = _six(*self.world.base_pose())
        carrier = self._movers.by_name.get("carrier")
        if carrier is not None:
            place = self._T_world_carrier
            turned = turned_by(carrier.place[3:], quaternion(place))
            poses["carrier"] = _six(carrier.place[:3] + place.xyz, turned)
        return poses

    def frame_twist(self, name: str) -> list[float]:
        """Return the true twist (6,) of Base or Carrier at its origin, in World axes."""
        twist = self.world.base_twist() if name == "base" else self._movers.by_name[name].rate
        return [float(x) for x in twist]

    def inject(self, fault: RigFault | RigMotion) -> None:
        """Apply a fault or a motion, or take a fault back.

        Raises `ValueError` for one that makes no sense.
        """
        if isinstance(fault, RigMotion):
            self._movers.move(fault)
        elif fault.kind == "place":
            self.world.place(fault.target, vector_of(fault, FARTHEST, "m"))
        elif fault.kind in KINDS:
            self.tags.inject(fault)
        elif self.scanner is not None and fault.target == SCANNER:
            self.scanner.inject(fault)
        elif fault.kind == "silence" and fault.target in self._moving:
            (self.unseen.add if fault.on else self.unseen.discard)(fault.target)
        else:
            self._faults.inject(fault)

    def truth(self) -> RigTruth:
        """Return what is really the case now."""
        arms = {name: self._arm_truth(i) for i, name in enumerate(self._names)}
        first = arms[self._names[0]]
        return RigTruth.of_valid(
            time_s=self.time_s,
            sync_count=self.sync_count,
            q=tuple(self.world.q.tolist()),
            dq=tuple(self.world.dq.tolist()),
            pose_mrf=first.pose_mrf,
            contact_force=first.contact_force,
            clearance_m=self.world.distances.clearance(),
            drives=tuple([_STATE_NAMES[node.state] for node in self.drives.values()]),
            tags=self.tags.poses,
            sight=self._sight.clearances(self.tags.poses),
            covered=self.tags.covered,
            frames=self.frames,
            arms=arms,
            between_arms_m=self.world.distances.between_arms(),
            own_contact_peak=self.world.contacts.own_peak(),
            beam=None if self.world.beam is None else self._beam_truth(self.world.beam),
        )

    def _arm_truth(self, arm: int) -> ArmTruth:
        contacts = self.world.contacts
        return ArmTruth.of_valid(
            pose_mrf=_six(*self.world.mrf_pose(arm)),
            contact_force=_three(contacts.force(arm)),
            contact_sum=contacts.total(arm),
            contact_peak=contacts.peak(arm),
        )

    def _beam_truth(self, beam: Beam) -> BeamTruth:
        payload = len(self._names)
        return BeamTruth.of_valid(
            pose=_six(*beam.pose()),
            grasps=tuple((a, b, c, d, e, f) for a, b, c, d, e, f in beam.wrenches.tolist()),
            internal_force=beam.internal_force(),
            stretch=beam.stretch(),
            peg_depth=beam.peg_depths(),
            push=_three(self.world.contacts.force(payload)),
            push_peak=self.world.contacts.peak(payload),
        )


def _node(entry: Entry, bench: Bench) -> Node:
    """Make the simulated node of a device, by its row in the table of kinds."""
    module, name = DEVICES[type(entry.section)].node.split(":")
    maker = getattr(import_module(f"{__package__}.nodes.{module}"), name)
    node: Node = maker.from_bench(entry, bench)
    return node


def _ignore() -> None:
    """Stand in for a listener."""


def _three(vector: Vector) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _six(position: Vector, R: Vector) -> Vector6:
    """Return x, y, z and fixed-axis roll, pitch, yaw of a pose."""
    (a, _, _), (b, _, _), (c, d, e) = R.tolist()
    roll, pitch, yaw = math.atan2(d, e), math.atan2(-c, math.hypot(a, b)), math.atan2(b, a)
    x, y, z = position.tolist()
    return (x, y, z, roll, pitch, yaw)
