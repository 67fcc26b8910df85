"""An arm keeps out of the line of sight of a camera that another arm carries, or that stands."""

import mujoco
import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.rig.physics.clearance import PROBE
from telerobot.drivers.rig.physics.world import World
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

CELL = """
extends = "pa10_two"
name = "eyes"
[avoidance]
enabled = true
[potential]
lines = 0.3
joint_limits = 0.1
[redundancy]
mid_range = 0.0
[[tasks]]
name = "right"
[[tasks.cameras]]
name = "eye"
T_wrist_lens = { xyz = [-0.05, 0.0, 0.0] }
device = "0"
[[tasks.cameras]]
name = "mast"
T_world_lens = { xyz = [0.9, -0.1, 1.0] }
device = "1"
[[obstacles]]
name = "view"
shape = "sight_line"
camera = "eye"
to = [-0.4, 1.6, 1.35]
"""
BARRED = """
[[obstacles]]
name = "over"
shape = "sight_line"
camera = "mast"
to = [0.9, 1.2, -0.2]
hard = true
"""
LENS, TO = np.array([-0.05, 0.0, 0.0]), np.array([-0.4, 1.6, 1.35])
MAST, BEYOND = np.array([0.9, -0.1, 1.0]), np.array([0.9, 1.2, -0.2])
CLEAR = 0.05
"""Every housing of the other arm stays so far from the line [m]."""


def loaded(folder, more=""):
    path = folder / "eyes.toml"
    path.write_text(CELL + more)
    return load_cell(path)


def played(cell, *steps, seconds):
    simulation = Simulation(
        cell, Script.model_validate({"duration_s": seconds, "step": list(steps)})
    )
    return Run(simulation, simulation.run())


@pytest.fixture(scope="module", params=[4.0, 0.0], ids=["field", "without"])
def run(request, tmp_path_factory):
    """The right arm lowers its camera, so that it looks through where the left one's elbow is."""
    return request.param, played(
        loaded(tmp_path_factory.mktemp("eyes")),
        {"at_s": 0.2, "operator/redundancy": {"task": "left", "objective": "field",
                                              "gain": request.param}},
        {"at_s": 0.2, "cmd/position": {"task": "left", "xyz": [0.0] * 3, "rpy": [0.0] * 3,
                                       "relative_to": "mrf"}},
        {"at_s": 0.4, "cmd/position": {"task": "right", "xyz": [0.0, 0.0, -0.2],
                                       "rpy": [0.0, 0.0, 0.0], "relative_to": "mrf",
                                       "expressed_in": "world", "speed": 0.1}},
        seconds=4.5,
    )  # fmt: skip


def gaps(world, q, start, end):
    """Return how far each geom of the left arm is from a line, by the physics [m]."""
    model, data = world.model, world.data
    world.q[:] = q
    mujoco.mj_kinematics(model, data)
    first = start(data)
    probe, along, quat, R = model.geom(PROBE).id, end - first, np.zeros(4), np.zeros(9)
    mujoco.mju_quatZ2Vec(quat, along / np.linalg.norm(along))
    mujoco.mju_quat2Mat(R, quat)
    data.geom_xpos[probe], data.geom_xmat[probe] = 0.5 * (first + end), R
    model.geom_size[probe, :2] = 1e-4, 0.5 * np.linalg.norm(along)
    return [
        mujoco.mj_geomDistance(model, data, probe, g, 10.0, None)
        for g in range(model.ngeom)
        if model.body(int(model.geom_bodyid[g])).name.startswith("left.")
        and model.body_weldid[model.geom_bodyid[g]]
        and model.geom_conaffinity[g]
    ]


def test_the_left_arm_keeps_out_of_what_the_right_ones_camera_sees(run):
    gain, run = run
    assert run.summary["failure"] is None
    assert run.summary["refused"] == []
    assert run.summary["limit_violations"] == 0
    world = World(run.simulation.cell)
    wrist = world.model.body("right.flange").id

    def lens(data):
        return data.xpos[wrist] + data.xmat[wrist].reshape(3, 3) @ LENS

    found = [min(gaps(world, truth.q, lens, TO)) for truth in run.truths[::5]]
    lost = run.events("sight_line_lost")
    tool = np.array([t.arms["left"].pose_mrf[:3] for t in run.truths])
    if gain:
        assert min(found) > CLEAR
        assert lost == []
        # It is the elbow that goes: the tool stands.
        assert np.ptp(tool, axis=0).max() < 1e-3
        return
    assert min(found) < 0.0
    (lost,) = lost
    assert lost.values["mechanism"] == "left"
    assert lost.values["obstacle"] == "view"


def test_no_arm_comes_into_the_hard_line_of_another_ones_standing_camera(tmp_path):
    cell = loaded(tmp_path, BARRED)
    stick = {"task": "left", "twist": [0.15, 0.0, 0.0, 0.0, 0.0, 0.0], "expressed_in": "base"}
    run = played(cell, {"at_s": 0.3, "cmd/joystick": stick}, seconds=3.0)
    assert run.summary["failure"] is None
    world = World(cell)
    least = min(min(gaps(world, t.q, lambda _: MAST, BEYOND)) for t in run.truths[::5])
    assert cell.config.avoidance.clearance < least < cell.config.avoidance.clearance + 0.02
    assert "clearance:left.hand:over" in run.states[-1].limits
    assert run.events("sight_line_lost") == []
