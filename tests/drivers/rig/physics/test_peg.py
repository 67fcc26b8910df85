"""The peg and the hole have the shape that the cell says, seen by rays."""

import math

import mujoco
import numpy as np
import pytest
from laboratory.oracle.poses import matrix
from pydantic import ValidationError
from telerobot.config.load import load_cell
from telerobot.config.schema.rig import RigHoleSection, RigPegSection
from telerobot.drivers.rig.physics.world import World


@pytest.fixture(scope="module")
def world():
    return World(load_cell("pa10_peg"))


@pytest.fixture(scope="module")
def rig():
    return load_cell("pa10_peg").config.rig


def seen(world, T, start, direction):
    """Return how far a ray in a frame T (4, 4) goes until it meets a geom, and that geom's name."""
    origin = T[:3, :3] @ start + T[:3, 3]
    geom = np.zeros(1, dtype=np.int32)
    along = T[:3, :3] @ direction
    far = mujoco.mj_ray(world.model, world.data, origin, along, None, 1, -1, geom)
    return far, world.model.geom(int(geom[0])).name if geom[0] >= 0 else ""


@pytest.mark.parametrize("depth", [0.0005, 0.0015, 0.0029, 0.0031, 0.02, 0.044])
def test_the_hole_is_an_octagon_with_a_chamfer(world, rig, depth):
    hole = rig.holes[0]
    T = matrix(hole.T_world_hole) @ matrix(hole.misplaced)
    side = hole.radius + max(0.0, hole.chamfer - depth)
    for angle in np.linspace(0.0, 2.0 * math.pi, 96, endpoint=False):
        far, _ = seen(world, T, [0.0, 0.0, -depth], [math.cos(angle), math.sin(angle), 0.0])
        from_side = (angle + math.pi / 8) % (math.pi / 4) - math.pi / 8
        assert far == pytest.approx(side / math.cos(from_side), abs=1e-7)


def test_the_hole_goes_through_the_block_down_to_the_table(world, rig):
    hole, table = rig.holes[0], rig.boxes[0]
    T = matrix(hole.T_world_hole) @ matrix(hole.misplaced)
    far, name = seen(world, T, [0.0, 0.0, -0.001], [0.0, 0.0, -1.0])
    assert name == "table_box"
    top = table.xyz[2] + table.half_size[2]
    assert far > hole.depth
    assert (T[2, 3] - top) == pytest.approx((far + 0.001) * T[2, 2], abs=1e-7)


def test_the_peg_is_as_thick_and_as_long_as_the_cell_says(world, rig):
    position, R = world.mrf_pose()
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, position
    for i in range(12):
        out = np.array([math.cos(math.pi * i / 6), math.sin(math.pi * i / 6), 0.0])
        far, name = seen(world, T, 0.02 * out - [0.0, 0.0, 0.01], -out)
        assert name == f"peg_{i}"
        assert 0.02 - far == pytest.approx(rig.peg.radius, abs=1e-9)
    edge = [rig.peg.radius - rig.peg.rounding, 0.0, 0.001]
    far, name = seen(world, T, edge, [0.0, 0.0, -1.0])
    assert (name, far) == ("peg_0", pytest.approx(0.001, abs=1e-9))


def test_the_sensor_carries_the_peg(world, rig):
    load = world.sensor_wrench()
    mass = load_cell("pa10_peg").config.mechanism.force_torque.payload.mass
    assert mass == pytest.approx(0.98 + rig.peg.mass)
    assert np.linalg.norm(load[:3]) == pytest.approx(9.81 * mass, rel=1e-3)


@pytest.mark.parametrize(
    ("section", "fields", "complaint"),
    [
        (RigPegSection, {"radius": 0.002}, "rounding 0.002 must be below radius 0.002"),
        (RigPegSection, {"length": 0.004}, "length 0.004 must be above 2 x rounding 0.002"),
        (RigHoleSection, {"half_size": 0.016}, "half_size 0.016 must be above radius 0.01025"),
        (RigHoleSection, {"depth": 0.006}, "depth 0.006 must be above 2 x chamfer 0.003"),
    ],
)
def test_a_shape_that_cannot_be_is_refused_with_its_numbers(section, fields, complaint):
    more = {} if section is RigPegSection else {"name": "hole", "T_world_hole": {}}
    with pytest.raises(ValidationError, match=complaint):
        section.model_validate({**more, **fields})
