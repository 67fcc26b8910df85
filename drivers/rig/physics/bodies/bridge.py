"""A bridge across the way, and a person who walks in: things that only a scanner can tell of."""

import math

import mujoco

from .....config.schema.rig.bridge import RigBridgeSection, RigPersonSection
from ..geoms import fixed

BEAM, LEFT, RIGHT, PERSON = "bridge_beam", "bridge_left", "bridge_right", "person"
"""Bodies; each can be placed elsewhere."""


def add_bridge(spec: mujoco.MjSpec, bridge: RigBridgeSection) -> None:
    """Add pillars and beam; the near face's middle is at `distance`, shifted by `offset`."""
    c, s = math.cos(bridge.skew), math.sin(bridge.skew)
    depth, side = 0.5 * bridge.thickness, 0.5 * bridge.side
    across = 0.5 * bridge.width + side
    for name, y, z, half in (
        (LEFT, across, 0.5 * bridge.height, (depth, side, 0.5 * bridge.height)),
        (RIGHT, -across, 0.5 * bridge.height, (depth, side, 0.5 * bridge.height)),
        (BEAM, 0.0, bridge.height + side, (depth, across + side, side)),
    ):
        body = spec.worldbody.add_body(
            name=name,
            pos=(
                bridge.distance + c * depth - s * y,
                bridge.offset + s * depth + c * y,
                z,
            ),
            quat=(math.cos(0.5 * bridge.skew), 0.0, 0.0, math.sin(0.5 * bridge.skew)),
            mocap=True,
        )
        fixed(body.add_geom(name=f"{name}_box", type=mujoco.mjtGeom.mjGEOM_BOX, size=half))


def add_person(spec: mujoco.MjSpec, person: RigPersonSection) -> None:
    """Add who may walk in: an upright capsule on the floor."""
    x, y, z = person.xyz
    body = spec.worldbody.add_body(name=PERSON, pos=(x, y, z + 0.5 * person.height), mocap=True)
    shape = body.add_geom(name=f"{PERSON}_shape", type=mujoco.mjtGeom.mjGEOM_CAPSULE)
    shape.size[:2] = person.radius, 0.5 * person.height - person.radius
    fixed(shape)
