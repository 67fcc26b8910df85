"""Rays on any arm of a cell are known for such, by what geom each truly hits in the physics."""

import mujoco
import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.rig.physics.world import World
from telerobot.server.control.spatial import Pose
from telerobot.server.perception.scanning.placing import (
    MeasuredInstant,
    ScannerGeometry,
    own_rays,
    place,
)

CELL = """
extends = "rover_beside"
[[mechanisms]]
name = "rover"
like = "rover_bridge"
bus = "rover"
[[mechanisms]]
name = "arm"
like = "pa10"
bus = "arm"
T_world_base = { xyz = [1.4, 0.9, 0.0], rpy = [0.0, 0.0, -1.5707963267948966] }
[rig.bridge]
height = 0.95
distance = 3.0
width = 1.4
thickness = 0.1
"""


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    path = tmp_path_factory.mktemp("rays") / "rays.toml"
    path.write_text(CELL)
    return load_cell(path)


@pytest.mark.parametrize("at", [(0.0, 0.0, 0.0), (0.4, -0.1, 0.3)])
def test_a_ray_is_own_where_it_hits_an_arm_and_nowhere_else(cell, at):
    """Wherever the rover has driven, and the arm reaches into its view."""
    world, geometry, scanner = World(cell), ScannerGeometry(cell), cell.config.scanner
    model, data, (x, y, yaw) = world.model, world.data, at
    model.opt.gravity[:] = 0.0
    data.qpos[:7] = [x, y, 0.0, np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]
    mirror, angle = model.body("rover.head").id, scanner.first + scanner.step * np.arange(541)
    c, s = np.cos(yaw), np.sin(yaw)
    T = Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, 0.0]))
    hits = {"arm": 0, "bridge": 0}
    for tilt in np.linspace(-0.6, 0.1, 8):
        world.q[cell.joints.index("rover.tilt")] = tilt
        mujoco.mj_kinematics(model, data)
        instants = [MeasuredInstant(i, 0.1 * i, world.q.copy(), T) for i in range(2)]
        knots = geometry.knots(instants)
        along = np.stack([np.sin(angle), -np.cos(angle), np.zeros(541)], axis=1)
        toward = along @ knots.R[0].T
        found, geom = np.empty(541), np.empty(541, dtype=np.int32)
        mujoco.mj_multiRay(
            model, data, knots.p[0], toward.ravel(), None, True, mirror, geom, found, None, 541, 9.0
        )
        time_s, distance = np.linspace(0.0, 0.1, 541), np.where(geom < 0, np.nan, found)
        points = place(time_s, angle, distance, knots)
        own = own_rays(time_s, points, knots, geometry.reach)
        for hit, body, is_own in zip(geom, model.geom_bodyid[geom], own, strict=True):
            name = model.body(body).name if hit >= 0 else ""
            if name.startswith("arm."):
                hits["arm"] += 1
                assert is_own
            elif name in cell.config.rig.bridge.blocks:
                hits["bridge"] += 1
                assert not is_own
    assert min(hits.values()) > 20
