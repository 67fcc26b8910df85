"""The physics against an independent truth: Pinocchio, statics, the published model."""

import math

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from telerobot.config.load import Cell, altered, load_cell
from telerobot.drivers.rig.nodes.drive_loops import DriveLoops
from telerobot.drivers.rig.physics.geoms import FIXED
from telerobot.drivers.rig.physics.world import World


def chain(cell: Cell) -> tuple[pin.Model, pin.Data]:
    model = pin.buildModelFromUrdf(str(cell.robot.urdf))
    return model, model.createData()


def without_payload(cell: Cell) -> Cell:
    return altered(cell, {"rig.payload_mass": 0.0})


@pytest.mark.parametrize("name", ["pa10", "ur5e"])
def test_mass_matrix_and_bias_forces_are_those_of_pinocchio(name: str) -> None:
    cell = without_payload(load_cell(name))
    world, (model, data) = World(cell), chain(cell)
    n = world.n
    rng = np.random.default_rng(4)
    for _ in range(20):
        world.q[:], world.dq[:] = rng.uniform(-2, 2, n), rng.uniform(-1, 1, n)
        mujoco.mj_forward(world.model, world.data)
        mass = np.zeros((world.model.nv, world.model.nv))
        mujoco.mj_fullM(world.model, world.data, mass)
        wanted = pin.crba(model, data, world.q.copy())
        wanted = np.triu(wanted) + np.triu(wanted, 1).T + np.diag(world.model.dof_armature[:n])
        np.testing.assert_allclose(mass[:n, :n], wanted, atol=1e-9)
        bias = pin.rnea(model, data, world.q.copy(), world.dq.copy(), np.zeros(n))
        np.testing.assert_allclose(world.data.qfrc_bias[:n], bias, atol=1e-9)


def test_pa10_tool_stands_where_the_published_lengths_put_it(cell: Cell) -> None:
    world = World(cell)
    world.q[:] = [0, math.pi / 4, 0, math.pi / 2, 0, -math.pi / 4, 0]
    position, R = world.mrf_pose()
    np.testing.assert_allclose(position, [0.872751, 0, 0.279645], atol=1e-6)
    np.testing.assert_allclose(R @ [0, 0, 1], [1, 0, 0], atol=1e-9)


def test_pa10_masses_are_the_published_ones(cell: Cell) -> None:
    model, _ = chain(cell)
    masses = [9.78, 8.41, 3.51, 4.31, 3.45, 1.46, 0.24 + 0.98]
    np.testing.assert_allclose([i.mass for i in model.inertias][1:], masses, atol=1e-12)


def test_only_parts_of_the_arm_that_press_on_each_other_count_as_its_own_contact() -> None:
    world = World(load_cell("ur5e"))
    assert world.contacts.own() == 0.0
    world.q[:] = [2.3, -1.76, 2.91, -2.78, 0.95, 0.0]  # wrist in shoulder
    mujoco.mj_forward(world.model, world.data)
    assert world.contacts.own() > 10.0
    assert world.contacts.force(0).tolist() == [0.0, 0.0, 0.0]


def test_a_closed_brake_holds_the_arm_against_its_weight(cell: Cell) -> None:
    world = World(cell)
    start = world.q.copy()
    for _ in range(500):
        world.step(np.zeros(world.n))
    np.testing.assert_allclose(world.q, start, atol=2e-5)


def test_an_open_brake_without_torque_lets_the_arm_fall(cell: Cell) -> None:
    world = World(cell)
    world.set_brake(3, closed=False)
    start = world.q[3]
    for _ in range(100):
        world.step(np.zeros(world.n))
    assert abs(world.q[3] - start) > 0.02


@pytest.mark.parametrize("name", ["pa10", "ur5e"])
def test_at_rest_the_sensor_reads_the_weight_of_the_cells_payload(name: str) -> None:
    cell = load_cell(name)
    sensor = cell.config.mechanism.force_torque
    assert sensor is not None
    world = World(cell)
    for _ in range(200):
        world.step(np.zeros(world.n))
    down = world.data.site("sensor").xmat.reshape(3, 3).T @ [0, 0, -9.81]
    force = sensor.payload.mass * down
    moment = np.cross(sensor.payload.com, force)
    np.testing.assert_allclose(world.sensor_wrench(), [*force, *moment], atol=2e-3)


class Pressed:
    """The tool ball pressed on the wall by the position loops, come to rest."""

    def __init__(self, cell: Cell, depth: float) -> None:
        mechanism, rig = cell.config.mechanism, cell.config.rig
        assert rig is not None
        assert rig.wall is not None
        self.wall = rig.wall
        self.world = World(cell)
        world = self.world
        loop = DriveLoops([(mechanism.drives, rig.drive)], world.dt)
        world.q[:] = mechanism.postures["ready"]
        goal = self.inverse(cell, rig.wall.xyz[0] - rig.tool_radius + depth)
        for joint in range(world.n):
            world.set_brake(joint, closed=False)
            loop.engage(joint, float(world.q[joint]))
        start = world.q.copy()
        for share in np.minimum(np.arange(1, 251) / 50, 1.0):
            for joint in range(world.n):
                loop.aim(joint, float(start[joint] + share * (goal - start)[joint]), 0.01)
            for _ in range(10):
                world.step(loop.step(world.q, world.dq))

    def inverse(self, cell: Cell, x: float) -> NDArray[np.float64]:
        """Joint angles with the tool `x` metres from the base, as high and as horizontal as now."""
        model, data = chain(cell)
        q = self.world.q.copy()
        start, R = self.world.mrf_pose()
        frame = model.getFrameId("flange")
        goal = pin.SE3(R, np.array([x, *start[1:]]) - R @ [0, 0, 0.121])
        for _ in range(50):
            pin.framesForwardKinematics(model, data, q)
            error = pin.log6(data.oMf[frame].actInv(goal)).vector
            J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL)
            q = q + np.linalg.pinv(J) @ error
        return q


@pytest.fixture(scope="module")
def pressed() -> Pressed:
    return Pressed(load_cell("pa10"), depth=0.002)


def test_the_wall_gives_way_by_force_over_stiffness(pressed: Pressed) -> None:
    force = pressed.world.contacts.force(0)
    assert 30 < force[0] < 45  # about 2 mm of 20 kN/m; drives without droop
    assert pressed.world.wall_travel() == pytest.approx(force[0] / pressed.wall.stiffness, rel=1e-3)


def test_pressing_loads_the_sensor_with_the_opposite_of_the_contact_force(pressed: Pressed) -> None:
    world = pressed.world
    _, R_world_sensor = world.mrf_pose()  # the PA-10's sensor has the MRF's axes
    load = R_world_sensor @ world.sensor_wrench()[:3]
    weight = np.array([0, 0, -0.98 * 9.81])
    np.testing.assert_allclose(load - weight, -world.contacts.force(0), atol=0.1)
    assert load[0] < -30


def test_a_push_on_the_wall_is_no_clearance_but_what_comes_near_besides_is(
    cell: Cell, pressed: Pressed
) -> None:
    world = World(cell)
    world.q[:] = cell.config.mechanism.postures["ready"]
    far, near = world.distances.clearance(), pressed.world.distances.clearance()
    assert abs(pressed.world.distances.gaps(1.0).min()) < 5e-4, "the ball is on the wall"
    assert far is not None
    assert near is not None
    assert 0.01 < near < far, "the stalk behind the ball came nearer"


def test_gaps_are_those_of_which_the_least_is_the_clearance(cell: Cell) -> None:
    world, rng = World(cell), np.random.default_rng(5)
    for _ in range(20):
        world.q[:] = rng.uniform(-2, 2, world.n)
        gaps, near, clearance = (
            world.distances.gaps(1.0),
            world.distances.gaps(0.1),
            world.distances.clearance(),
        )
        assert gaps.min() == pytest.approx(clearance, abs=1e-9)
        np.testing.assert_allclose(near, np.minimum(gaps, 0.1), atol=1e-9)


def test_what_is_nearest_among_many_boxes_is_that_of_all_pairs() -> None:
    world, rng = World(load_cell("pa10_pair")), np.random.default_rng(6)
    start = world.q.copy()
    for spread in (0.02, 0.1, 0.3):
        world.q[:] = start + rng.uniform(-spread, spread, world.n)
        nearest = world.distances.nearest()
        assert nearest is not None
        fixed = [g for g in range(world.model.ngeom) if world.model.geom_contype[g] == FIXED]
        weld = world.model.body_weldid[world.model.geom_bodyid]
        moving = [g for g in range(world.model.ngeom) if g not in fixed and weld[g] != 0]
        every = [
            mujoco.mj_geomDistance(world.model, world.data, a, f, 1.0, None)
            for a in moving
            for f in fixed
        ]
        assert nearest.distance == pytest.approx(min(every), abs=1e-9)


def test_a_push_on_the_tool_is_felt_at_the_joints_as_its_moment(cell: Cell) -> None:
    world, (model, data) = World(cell), chain(cell)
    force = np.array([3.0, -2.0, 5.0])
    mujoco.mj_forward(world.model, world.data)
    world.push_tool(force)
    world.step(np.zeros(world.n))
    q = np.array(cell.config.mechanism.postures["start"])
    J = pin.computeFrameJacobian(
        model, data, q, model.getFrameId("flange"), pin.LOCAL_WORLD_ALIGNED
    )
    pin.framesForwardKinematics(model, data, q)
    arm = data.oMf[model.getFrameId("flange")].rotation @ [0, 0, 0.121]
    moments = J.T @ np.concatenate((force, np.cross(arm, force)))
    felt = world.data.qfrc_smooth + world.data.qfrc_bias - world.data.qfrc_passive
    np.testing.assert_allclose(felt[: world.n], moments, atol=1e-6)


def test_a_hand_comes_and_goes_as_it_was_told(cell: Cell) -> None:
    world = World(cell)
    felt = []
    for _ in range(1300):
        if len(felt) == 100:
            world.push_tool(np.array([0.0, 4.0, 0.0]), 1.0)
        world.step(np.zeros(world.n))
        felt.append(float(np.abs(world.data.xfrc_applied).max(axis=0)[1]))
    t = np.clip((np.arange(1300) - 100) * world.dt, 0.0, 1.0)
    np.testing.assert_allclose(felt, 4.0 * np.sin(np.pi * t) ** 2, atol=0.02)
