"""A rover beside an arm that stands: each with its own Base, and clear of each other."""

import mujoco
import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.drivers.rig.physics.world import World
from telerobot.server.control.barriers.clearance import CollisionConstraint
from telerobot.server.control.proximity.capsules import Capsules
from telerobot.server.control.scene import Body
from telerobot.server.control.spatial import Pose
from telerobot.server.control.wheels import Rolled
from telerobot.tools.scripts.script import load_script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run


@pytest.fixture(scope="module")
def cell():
    return load_cell("rover_beside")


@pytest.fixture(scope="module")
def run(cell):
    simulation = Simulation(cell, load_script(cell.default_script))
    return Run(simulation, simulation.run())


def test_it_plays_without_refusal_fault_or_violation(run):
    assert run.result.ok, [str(row) for row in run.result.expected if not row.met]
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    assert [e for e in run.simulation.events if e.severity == "error"] == []


def test_the_rover_waits_before_the_arm_and_drives_on_when_it_withdraws(run):
    """In the physics: it comes no nearer than is promised, and stands there."""
    promised = run.simulation.cell.config.avoidance.self_clearance
    true = np.array([truth.between_arms_m for truth in run.truths])
    assert promised < true.min() < promised + 0.02
    before, later, end = (run.at(s).frames["base"][0] for s in (6.9, 7.4, 13.5))
    assert later - before < 1e-3
    assert 1.1 < before < 1.3
    assert end > 2.5
    assert "clearance:rover.arm1:arm.hand" in run.at(7.2).limits


def test_each_task_tells_of_its_own_base(run):
    state = run.at(7.2)
    assert state.frames["base"][0] > 1.0
    assert "base" not in state.tasks["arm"].frames
    assert state.tasks["arm"].ground == "world"
    assert state.ground == "base"


def test_the_tool_of_the_arm_that_stands_keeps_its_place_while_the_rover_drives(run):
    start = run.simulation.player.start_s
    places = [
        truth.arms["arm"].pose_mrf[:3] for truth in run.truths if 5.0 < truth.time_s - start < 7.4
    ]
    assert np.ptp(np.array(places), axis=0).max() < 2e-4


def test_links_are_where_the_physics_has_them_wherever_the_rover_is(cell):
    """The joints' frames of both, by MuJoCo's bodies."""
    forest, world = Capsules(cell).forest, World(cell)
    rng = np.random.default_rng(3)
    for _ in range(5):
        q = np.concatenate(
            [np.array(p.config.mechanism.postures["start"]) for p in cell.parts]
        ) + rng.uniform(-0.4, 0.4, world.n)
        x, y, yaw = rng.uniform(-1.0, 1.0, 3)
        c, s = np.cos(yaw), np.sin(yaw)
        T = Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, 0.0]))
        world.data.qpos[:7] = [x, y, 0.0, np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]
        world.q[:] = q
        mujoco.mj_kinematics(world.model, world.data)
        frames = forest.frames(q[None], [Rolled.at(T, q[:2]), forest.bases[1]])[0]
        for j, name in enumerate(cell.joints):
            if "wheel" in name:
                continue
            body = int(world.model.joint(name).bodyid[0])
            np.testing.assert_allclose(frames[j, :, 3], world.data.xpos[body], atol=1e-9)


def test_a_stop_takes_along_what_the_wheels_still_roll(cell):
    """Postures along a stop: the rover's links go by the arc, the other's stay."""
    forest = Capsules(cell).forest
    q = np.concatenate([np.array(p.config.mechanism.postures["start"]) for p in cell.parts])
    rolled = np.repeat(q[None], 2, axis=0)
    rolled[1, :2] += 1.0
    bases = [Rolled.at(forest.bases[0], q[:2]), forest.bases[1]]
    then, now = forest.frames(rolled, bases)[:, :, :, 3]
    way = now - then
    np.testing.assert_allclose(way[2:9], np.tile([0.12, 0.0, 0.0], (7, 1)), atol=1e-12)
    np.testing.assert_allclose(way[9:], 0.0, atol=1e-12)


@pytest.mark.parametrize("twist", [[0.0, 0.05, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.1]])
def test_a_base_that_is_corrected_comes_nearer_to_what_stands_on_another(cell, twist):
    """Rates of gaps between the two, by finite differences of the gaps."""
    joints = [d for p in cell.parts for d in p.config.mechanism.drives]
    guard = CollisionConstraint(
        cell, np.array([d.max_acceleration for d in joints]), np.array([d.max_jerk for d in joints])
    )
    clearance, forest = guard.clearance, guard.capsules.forest
    q = np.concatenate([np.array(p.config.mechanism.postures["start"]) for p in cell.parts])

    def look(ahead_s):
        v, w = np.array(twist[:3]), twist[5] * ahead_s
        c, s = np.cos(w), np.sin(w)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        T = Pose(R, np.array([1.2, 0.0, 0.0]) + ahead_s * v)
        bases = (Body(Rolled.at(T, q[:2]), np.array(twist)), Body.standing(forest.bases[1]))
        far = np.full(len(q), 1.0)
        return clearance.look(q, far, np.zeros(len(q)), None, 1.0, {}, bases).near

    before, near, after = look(-1e-5), look(0.0), look(1e-5)
    gaps = [
        dict(zip(zip(n.first, n.second, strict=True), n.gap, strict=True)) for n in (before, after)
    ]
    root = [forest.root(body) for body in guard.capsules.body.tolist()]
    seen = 0
    for i, pair in enumerate(zip(near.first, near.second, strict=True)):
        if root[pair[0]] == root[pair[1]]:
            assert near.speed[i] == 0.0
            continue
        closing = (gaps[0][pair] - gaps[1][pair]) / 2e-5
        assert near.speed[i] == pytest.approx(max(closing, 0.0), abs=1e-6)
        assert near.carried[i] >= near.speed[i] - 1e-12
        seen += near.speed[i] > 0.01
    assert seen > 0


def test_without_clearances_the_rover_hits_the_arm(cell):
    blind = altered(cell, {"avoidance.enabled": False})
    simulation = Simulation(blind, load_script(cell.default_script))
    summary = Run(simulation, simulation.run()).summary
    assert summary["min_between_arms_m"] < 0.0 or summary["own_contact_n"] > 1.0
