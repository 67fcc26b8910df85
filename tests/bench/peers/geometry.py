"""Real shapes of the arm and of a scene, to measure distances between them.

The judge of the runs reads clearances here, with Coal on the URDF's own cylinders and spheres, and
the tool's pose, by the oracle's kinematics; none of the controllers under test is asked. The shapes
and the pairs are the same for all.
"""

import math
from typing import NamedTuple

import coal
import pinocchio as pin
from telerobot.config.load import Cell
from telerobot.server.control.spatial import Array, Pose

from ...oracle.arm import OracleArm
from .scenes import Thing

NEIGHBOURS = 2
"""Links that so many joints part, or fewer, are not kept apart: they are built to be close [1]."""


class PeerClearance(NamedTuple):
    """Least distances [m]; negative when inside each other, infinite where there is nothing."""

    things: float
    own: float


class PeerGeometry:
    """The arm of a cell among things. Holds scratch memory: not for two threads."""

    def __init__(self, cell: Cell, things: tuple[Thing, ...]) -> None:
        """Build from the cell's URDF. Joints outside of the chain stand at zero."""
        full = pin.buildModelFromXML(cell.robot.description())
        shapes = pin.buildGeomFromUrdfString(
            full, cell.robot.description(), pin.GeometryType.COLLISION
        )
        chain = tuple(joint.name for joint in cell.robot.joints)
        others = [i for i in range(1, full.njoints) if full.names[i] not in chain]
        if others:
            full, shapes = pin.buildReducedModel(full, shapes, others, pin.neutral(full))
        base = cell.config.mechanism.T_world_base
        self.model, self.shapes, self.things = full, shapes, things
        self.data = full.createData()
        self.T_base_world = Pose.from_xyz_rpy(base.xyz, base.rpy).inverse()
        # Names and joints, not the objects: adding to the list moves them in memory.
        arm = [(shape.name, shape.parentJoint) for shape in shapes.geometryObjects]
        self._index = [shapes.addGeometryObject(self._object(thing)) for thing in things]
        self.own = tuple(
            (i, k)
            for i, (_, a) in enumerate(arm)
            for k, (_, b) in enumerate(arm)
            if i < k and abs(a - b) > NEIGHBOURS
        )
        moved = [i for i, (_, joint) in enumerate(arm) if joint > 0]
        self.names = tuple(name for name, _ in arm)
        self.with_things = tuple((i, k) for i in moved for k in self._index)
        for i, k in self.own + self.with_things:
            shapes.addCollisionPair(pin.CollisionPair(i, k))
        self.shape_data = pin.GeometryData(shapes)
        self._arm = OracleArm.of(cell)

    def move(self, time_s: float) -> None:
        """Put the things where they are at a time."""
        for thing, i in zip(self.things, self._index, strict=True):
            if thing.moves:
                p = thing.at(time_s).centre
                T = self.T_base_world
                self.shapes.geometryObjects[i].placement.translation = T.R @ p + T.p

    def clearance(self, q: Array) -> PeerClearance:
        """Return the least distances at joint angles q (n,) [rad]."""
        pin.computeDistances(self.model, self.data, self.shapes, self.shape_data, q)
        found = [result.min_distance for result in self.shape_data.distanceResults]
        cut = len(self.own)
        return PeerClearance(min(found[cut:], default=math.inf), min(found[:cut], default=math.inf))

    def keep(self, clearance: float, own: float) -> None:
        """Set what `clear` asks for: distances from things and of links [m]."""
        for k, request in enumerate(self.shape_data.collisionRequests):
            request.security_margin = own if k < len(self.own) else clearance

    def clear(self, q: Array) -> bool:
        """Return whether what `keep` asks for is kept at q (n,) [rad]."""
        return not pin.computeCollisions(
            self.model, self.data, self.shapes, self.shape_data, q, True
        )

    def tool(self, q: Array) -> Pose:
        """Return the MRF's pose in World at q (n,) [rad]."""
        T = self._arm.tool(q)
        return Pose(T[:3, :3], T[:3, 3])

    def jacobian(self, q: Array) -> Array:
        """Return the MRF's Jacobian (6, n), World axes."""
        return self._arm.jacobian(q)

    def _object(self, thing: Thing) -> "pin.GeometryObject":
        T = self.T_base_world @ Pose.from_xyz_rpy(thing.xyz, thing.rpy)
        shape: coal.CollisionGeometry
        match thing.shape:
            case "sphere":
                shape = coal.Sphere(thing.radius)
            case "capsule":
                shape = coal.Capsule(thing.radius, 2.0 * thing.half_length)
            case "box":
                shape = coal.Box(*(2.0 * half for half in thing.half_size))
        return pin.GeometryObject(thing.name, 0, pin.SE3(T.R, T.p), shape)
