"""A camera on one arm's wrist looks at a tag on another's: the view is kept wherever that goes."""

import mujoco
import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.rig.physics.world import World
from telerobot.server.control.spatial import Pose, rotation_log
from telerobot.tools.scripts.script import load_script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

pytestmark = pytest.mark.usefixtures("rendering")
STORED_S, CARRIED_S = 0.8, (1.5, 5.0)


@pytest.fixture(scope="module")
def run():
    cell = load_cell("pa10_eyes")
    simulation = Simulation(cell, load_script(cell.default_script))
    return Run(simulation, simulation.run())


@pytest.fixture(scope="module")
def seen(run):
    """Return a function: where the tag is in the Lens at a time of the script, by the physics."""
    cell = run.simulation.cell
    world, (tag,) = World(cell), cell.config.rig.tags
    lens, panel = cell.cameras[0].T_wrist_lens, tag.T_wrist_tag

    def wrist(name):
        body = world.model.body(f"{name}.flange").id
        return Pose(world.data.xmat[body].reshape(3, 3).copy(), world.data.xpos[body].copy())

    def at(script_s):
        start = run.simulation.player.start_s
        truth = min(run.truths, key=lambda t: abs(t.time_s - start - script_s))
        world.q[:] = truth.q
        mujoco.mj_kinematics(world.model, world.data)
        T_world_lens = wrist("right") @ Pose.from_xyz_rpy(lens.xyz, lens.rpy)
        return T_world_lens.inverse() @ (wrist("left") @ Pose.from_xyz_rpy(panel.xyz, panel.rpy))

    return at


def off(a, b):
    """Return how far poses are from each other [m], [rad]."""
    return np.linalg.norm(a.p - b.p), np.linalg.norm(rotation_log(a.R.T @ b.R))


def test_it_plays_without_refusal_fault_or_violation(run):
    assert run.result.ok, [str(row) for row in run.result.expected if not row.met]
    assert run.summary["limit_violations"] == 0
    assert [e for e in run.simulation.events if e.severity == "error"] == []
    assert run.events("view_stored")[0].values["mechanism"] == "right"


def test_the_tag_on_the_left_wrist_is_again_where_the_right_camera_had_it(run, seen):
    stored, end = seen(STORED_S), seen(12.0)
    metres, radians = off(stored, end)
    assert metres < 1.5e-3
    assert radians < 5e-3
    poses = [{name: np.array(arm.pose_mrf) for name, arm in t.arms.items()} for t in run.truths]
    for name in ("left", "right"):
        assert np.linalg.norm(poses[-1][name][:3] - poses[0][name][:3]) > 0.1


def test_it_follows_while_the_tag_is_carried_with_the_lag_of_its_gain(run, seen):
    """The tag goes at 0.05 m/s; K_V is 2 /s."""
    worst = max(off(seen(STORED_S), seen(s))[0] for s in np.arange(*CARRIED_S, 0.1))
    assert 5e-3 < worst < 0.05 / 2.0 + 0.02
