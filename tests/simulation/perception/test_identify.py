"""A tool of unknown weight on a sensor that sits askew: found out by a guided motion, then gone."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.mechanism import PayloadSection
from telerobot.config.schema.section import PoseSection
from telerobot.server.control import spatial
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.spatial import wrench_to
from telerobot.server.identification.payload import attitudes, judge
from telerobot.tools.identify.cli import Guide, identify
from telerobot.tools.scripts.player import Phase
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

HAND = 0.98, np.array([0.0, 0.0, 0.051])
"""Body 8 of the PA-10's URDF, at the flange."""
MOUNTING = np.deg2rad([1.9, -1.6, 1.7])
"""3 degrees in all."""
TRUE = spatial.rotation_rpy(*MOUNTING)
ADDED = 1.02, np.array([0.07, -0.05, 0.10])
MASS = HAND[0] + ADDED[0]
COM = (HAND[0] * TRUE.T @ HAND[1] + ADDED[0] * ADDED[1]) / MASS
BIAS = (1.4, -2.3, 3.6, 0.11, -0.22, 0.15)
FREE = {"acceleration": 0.25, "angular_acceleration": 2.0, "jerk": 5.0, "angular_jerk": 40.0}


def changed(cell, sensor=None, rig=None, truth=None, limits=None):
    """Return a cell with some keys of these sections replaced."""
    cell = altered(cell, sensor or {}, "mechanism.force_torque")
    cell = altered(cell, truth or {}, "rig.force_torque")
    return altered(altered(cell, rig or {}, "rig"), limits or {}, "limits")


def unknown_tool(pa10):
    """A cell that knows nothing of its 2 kg tool nor of what is wrong with its sensor."""
    return changed(
        pa10,
        sensor={"payload": PayloadSection(), "bias": (0.0,) * 6},
        rig={"payload_mass": ADDED[0], "payload_com": tuple(ADDED[1])},
        truth={"mounting_rpy": tuple(MOUNTING), "cross_talk": 0.02, "bias": BIAS},
    )


def told(cell, found, **sections):
    """The cell with what was found written into it."""
    sensor = {
        "T_wrist_sensor": PoseSection(rpy=found.rpy()),
        "payload": PayloadSection(mass=found.mass, com=tuple(found.com)),
        "bias": tuple(found.bias),
        "calibration": None if found.calibration is None else tuple(map(tuple, found.calibration)),
    }
    return changed(cell, sensor=sensor, **sections)


def residuals(simulation):
    """Return norms of force (k,) and moment (k,) at the sensor, in free motion."""
    mechanism = simulation.cell.config.mechanism
    T_wrist_mrf = spatial.Pose.from_xyz_rpy(mechanism.T_wrist_mrf.xyz, mechanism.T_wrist_mrf.rpy)
    sensor = mechanism.force_torque.T_wrist_sensor
    T_sensor_mrf = spatial.Pose.from_xyz_rpy(sensor.xyz, sensor.rpy).inverse() @ T_wrist_mrf
    start = simulation.player.start_s + 0.1
    wrenches = np.array(
        [
            wrench_to(T_sensor_mrf, np.array(s.wrench_mrf))
            for s in simulation.states
            if s.mode == "enabled" and s.time_s > start
        ]
    )
    return np.linalg.norm(wrenches[:, :3], axis=1), np.linalg.norm(wrenches[:, 3:], axis=1)


def through_all_attitudes(cell):
    """Targets with gravity from every side that the wrist can turn to, and travel between them."""
    mechanism = Mechanism.from_cell(cell)
    tool = cell.config.mechanism.T_wrist_mrf
    T_wrist_mrf = spatial.Pose.from_xyz_rpy(tool.xyz, tool.rpy)
    steps = []
    for i, stop in enumerate(attitudes(cell, "ready", 8, 0.15)):
        x, y, z, *rpy = (mechanism.pose_wrist(stop.q) @ T_wrist_mrf).to_xyz_rpy()
        place = [x - 0.12, y + (0.08, -0.08)[i % 2], z + 0.12]
        target = {"xyz": place, "rpy": rpy, "relative_to": "world", "speed": 0.25}
        steps.append({"at_s": 0.1 + 5.0 * i, "cmd/position": target})
    return steps


def askew(cell, mass, degrees, bias=BIAS):
    """A cell that knows nothing of what is on its tool: so heavy, and so askew, in all."""
    own = cell.config.rig.payload_mass or 0.0
    hand = 0.0 if own else HAND[0]
    axis = np.array([1.0, -1.0, 0.5]) / 1.5
    nominal = spatial.rotation_rpy(*cell.config.mechanism.force_torque.T_wrist_sensor.rpy)
    R = nominal @ spatial.rotation_exp(np.deg2rad(degrees) * axis)
    rpy = spatial.Pose(R, np.zeros(3)).to_xyz_rpy()[3:]
    com = np.array([0.03, -0.02, 0.12])
    spoilt = changed(
        cell,
        sensor={"payload": PayloadSection(), "bias": (0.0,) * 6},
        rig={"payload_mass": mass - hand, "payload_com": tuple(com)},
        truth={"mounting_rpy": rpy, "cross_talk": 0.0, "bias": bias},
    )
    return spoilt, R, (hand * R.T @ HAND[1] + (mass - hand) * com) / mass


@pytest.mark.parametrize(
    ("name", "mass", "degrees"),
    [("pa10", 10.0, 6.0), ("pa10", 1.6, 5.6), ("ur5e", 5.0, 6.0)],
)
def test_whatever_the_arm_is_rated_for_is_identified_on_a_sensor_that_is_askew(name, mass, degrees):
    cell, R, com = askew(load_cell(name), mass, degrees)
    found = judge(cell, identify(cell, attitudes(cell, "ready", 8, 0.15), simulate=True))
    assert found.mass == pytest.approx(mass, rel=0.01)
    assert np.linalg.norm(com - found.com) < 0.005
    off = np.linalg.norm(spatial.rotation_log(R.T @ found.R_wrist_sensor))
    assert np.rad2deg(off) < 0.5


@pytest.mark.parametrize(
    ("target", "vector"),
    [("e1", [0.0, 60.0, 0.0]), ("force_torque", [60.0, 0.0, 0.0])],
    ids=["elbow", "tool"],
)
def test_a_push_stops_an_identification(pa10, target, vector):
    cell, _, _ = askew(pa10, 8.0, 6.0)
    push = {"at_s": 8.0, "rig/fault": {"kind": "push", "target": target, "vector": vector}}
    simulation = Simulation(cell, Script.model_validate({"duration_s": 40.0, "step": [push]}))
    guide = Guide(simulation.player.client, attitudes(cell, "ready", 8, 0.15))

    def lead(running):
        if running.player.phase is Phase.PLAYING:
            guide.run(running.states[-1])

    simulation.on_tick = lead
    simulation.run(until=lambda: guide.over)
    assert guide.failure == "mode became stopping"
    (felt,) = [e for e in simulation.events if e.name == "touched"]
    assert felt.time_s - simulation.player.start_s < 9.5


def test_a_tool_on_a_bad_sensor_is_identified_and_then_weighs_nothing(pa10):
    cell = unknown_tool(pa10)
    found = judge(cell, identify(cell, attitudes(cell, "ready", 24, 0.15), simulate=True))
    off = np.rad2deg(np.linalg.norm(spatial.rotation_log(TRUE.T @ found.R_wrist_sensor)))
    assert found.mass == pytest.approx(MASS, rel=0.01)
    assert np.linalg.norm(COM - found.com) < 0.005
    assert off < 0.5

    free = told(cell, found, limits=FREE)
    script = Script.model_validate({"duration_s": 45.0, "step": through_all_attitudes(cell)})
    simulation = Simulation(free, script)
    result = simulation.run()
    assert result.summary["failure"] is None
    assert result.summary["refused"] == []
    force, moment = residuals(simulation)
    assert np.percentile(force, 99) < 0.5
    assert np.percentile(moment, 99) < 0.05
