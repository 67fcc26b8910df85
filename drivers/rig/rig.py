"""The virtual hardware of one cell: drives and sensor on a CAN bus, and the physics they move.

It meets the daemon on the bus and nowhere else. Time is the physics' own: `step` makes it pass.
"""

import math
from collections import deque
from collections.abc import Callable

import can
import numpy as np

from ...config.load import Cell
from ...protocols.canopen import can301
from ...protocols.messages.messages import Vector6
from ...protocols.messages.moving import RigMotion
from ...protocols.messages.rig import RigFault, RigTruth
from .fault_values import FARTHEST, vector_of
from .faults import Faults
from .nodes.can_node import CanNode
from .nodes.drive_loops import DriveLoops
from .nodes.force_torque_node import SimulatedForceTorque
from .nodes.gripper_node import SimulatedGripper
from .nodes.link import NodeLink
from .nodes.servo_node import SimulatedDrive
from .physics.geoms import quaternion
from .physics.movers import Movers
from .physics.scene import turned_by
from .physics.sight import SightLines
from .physics.tags import KINDS, Tags
from .physics.world import Vector, World

SYNC_STAMPS = 1 << 16
"""So many of the newest SYNC stamps are kept [1]."""


class RigError(Exception):
    """The bus is not the rig's alone: names what was heard."""


class Rig:
    """All simulated nodes of a cell on `bus`, booted, brakes closed, at the posture `start`.

    Runs are equal to the last bit when cell, frames and faults are. Raises `ValueError` for a cell
    without `[rig]` or with two nodes of one id.
    """

    def __init__(self, cell: Cell, bus: can.BusABC) -> None:
        config = cell.config
        self.world = World(cell)
        rig, mechanism = config.rig, config.mechanism
        if rig is None:
            raise ValueError(f"cell {config.name} has no [rig]: nothing to simulate")
        self.period_s = config.timing.period_s
        self.dt = rig.physics_step_s
        self.sync_count = 0
        self.sync_stamps: deque[float] = deque(maxlen=SYNC_STAMPS)
        """Physics time of the newest SYNCs [s]."""
        self.on_sync: Callable[[], None] = _ignore
        """Called at every SYNC, after the nodes have sampled."""
        self.unseen: set[str] = set()
        """Frames that may move and of which no sensor tells: a fault, `silence`."""
        self._bus = bus
        self._steps = 0
        self._time_s = 0.0
        self._loop = DriveLoops(mechanism.drives, rig.drive, self.dt)
        generators = (
            np.random.default_rng(s)
            for s in np.random.SeedSequence(rig.seed).spawn(len(mechanism.drives) + 3)
        )
        nodes = [d.node for d in mechanism.drives]
        if len(set(nodes)) < len(nodes):
            raise ValueError(f"cell {config.name}: two drives have the same node id: {nodes}")
        self.drives = {
            drive.joint: SimulatedDrive(
                drive,
                joint,
                NodeLink(bus, self.now, next(generators)),
                self._loop,
                self.world,
                rig.drive.torque_delay_s,
                self.now,
            )
            for joint, drive in enumerate(mechanism.drives)
        }
        sensor = mechanism.force_torque
        self.force_torque: SimulatedForceTorque | None = None
        if sensor is not None:
            self.force_torque = SimulatedForceTorque(
                sensor,
                rig.force_torque,
                NodeLink(bus, self.now, next(generators)),
                self.world.sensor_wrench,
                next(generators),
                next(generators),
                self.now,
            )
        self.gripper: SimulatedGripper | None = None
        if mechanism.gripper is not None:
            link = NodeLink(bus, self.now, np.random.default_rng(rig.seed))
            self.gripper = SimulatedGripper(mechanism.gripper, link, self.world.grasp, self.now)
        self.tags = Tags(rig.tags)
        self._movers = Movers(cell)
        self._moving = frozenset(config.frames.moving)
        self._T_world_carrier = cell.config.frames.T_world_carrier
        self._sight = SightLines(cell, self.world.model, self.world.data)
        self._faults = Faults(self.world, self.drives, self.force_torque)
        self._nodes: tuple[CanNode, ...] = tuple(self.drives.values())
        if self.gripper is not None:
            self._nodes = (*self._nodes, self.gripper)
        self._links = [node.link for node in self._nodes]
        if self.force_torque is not None:
            self._links.append(self.force_torque.link)
        self._own_beats = {can301.heartbeat_id(node.node) for node in self._nodes}
        self._routes = self._make_routes()
        for node in self._nodes:
            node.boot()

    def _make_routes(self) -> dict[int, tuple[NodeLink, ...]]:
        everyone = tuple(node.link for node in self._nodes)
        routes = {can301.NMT_ID: everyone, can301.SYNC_ID: everyone}
        for node in self._nodes:
            routes[can301.sdo_request_id(node.node)] = (node.link,)
            for number in range(can301.DEFAULT_PDOS):
                routes[can301.rpdo1_id(node.node) + 0x100 * number] = (node.link,)
        if self.force_torque is not None:
            command = self.force_torque.command_id
            routes[command] = (*routes.get(command, ()), self.force_torque.link)
        return routes

    @property
    def time_s(self) -> float:
        """Physics time since the start [s]."""
        return self._time_s

    def now(self) -> float:
        """Return `time_s`."""
        return self._time_s

    def poll(self) -> None:
        """Handle every frame that waits on the bus. Raises `RigError` for a second rig on it."""
        while (message := self.receive()) is not None:
            self.handle(message)

    def receive(self) -> can.Message | None:
        """Return the next data frame that waits on the bus, None when there is none."""
        while (message := self._bus.recv(0)) is not None:
            if not (message.is_error_frame or message.is_remote_frame or message.is_extended_id):
                return message
        return None

    def handle(self, message: can.Message, ahead_s: float = 0.0) -> None:
        """Handle one frame that was sent `ahead_s` after the newest step [s].

        Raises `RigError` for one that only a node of the same id sends.
        """
        self.world.ahead_s = ahead_s
        can_id, data = message.arbitration_id, bytes(message.data)
        if can_id in self._own_beats:
            node = can_id - can301.heartbeat_id(0)
            raise RigError(f"another node {node} is on the bus: is a second rig running on it?")
        if can_id == can301.SYNC_ID:
            self.sync_count += 1
            self.sync_stamps.append(self._time_s + ahead_s)
        links = self._routes.get(can_id)
        if links is None:
            if can_id <= can301.heartbeat_id(0):
                return
            links = self._routes[can301.SYNC_ID]
        for link in links:
            link.deliver(can_id, data)
        if can_id == can301.SYNC_ID:
            self.on_sync()

    def step(self) -> None:
        """Advance nodes, position loops and physics by one physics step."""
        now = self._time_s + 1e-7
        for link in self._links:
            if link.waiting:
                link.flush()
        beyond = bool(self._loop.steps_beyond.any())
        for node in self._nodes:
            if beyond or node.due_s <= now:
                node.tick()
        world = self.world
        if self._movers.by_name:
            self._movers.step()
            if "platform" in self._movers.by_name:
                world.place_platform(self._movers.by_name["platform"].place)
        world.step(self._loop.step(world.q, world.dq))
        self._steps += 1
        self._time_s = self._steps * self.dt
        sensor = self.force_torque
        if sensor is not None and sensor.due_s <= self._time_s + 1e-7:
            sensor.tick()

    def advance(self, seconds: float) -> None:
        """Advance by whole physics steps, as many as are nearest to `seconds`."""
        for _ in range(round(seconds / self.dt)):
            self.step()

    @property
    def frames(self) -> dict[str, Vector6]:
        """Where Base and Carrier truly are in World, where these may move."""
        poses: dict[str, Vector6] = {}
        if "platform" in self._movers.by_name:
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
        elif fault.kind == "silence" and fault.target in self._moving:
            (self.unseen.add if fault.on else self.unseen.discard)(fault.target)
        else:
            self._faults.inject(fault)

    def truth(self) -> RigTruth:
        """Return what is really the case now."""
        fx, fy, fz = self.world.contact_force().tolist()
        return RigTruth(
            time_s=self._time_s,
            sync_count=self.sync_count,
            q=tuple(self.world.q.tolist()),
            dq=tuple(self.world.dq.tolist()),
            pose_mrf=_six(*self.world.mrf_pose()),
            contact_force=(fx, fy, fz),
            clearance_m=self.world.clearance(),
            drives=tuple(node.state.name.lower() for node in self.drives.values()),
            tags=self.tags.poses,
            sight=self._sight.clearances(self.tags.poses),
            covered=self.tags.covered,
            frames=self.frames,
        )


def _ignore() -> None:
    """Stand in for a listener."""


def _six(position: Vector, R: Vector) -> Vector6:
    """Return x, y, z and fixed-axis roll, pitch, yaw of a pose."""
    roll = math.atan2(R[2, 1], R[2, 2])
    pitch = math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))
    yaw = math.atan2(R[1, 0], R[0, 0])
    x, y, z = position.tolist()
    return (x, y, z, roll, pitch, yaw)
