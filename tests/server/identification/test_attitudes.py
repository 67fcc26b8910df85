import numpy as np
import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.spatial import Pose
from telerobot.server.identification.payload import attitudes

ROOM = 0.15


@pytest.fixture(params=["pa10", "ur5e"])
def cell(request):
    return load_cell(request.param)


def test_the_way_stays_in_the_room_and_inside_the_joint_limits(cell):
    mechanism, m = Mechanism.from_cell(cell), cell.config.mechanism
    tool = Pose.from_xyz_rpy(m.T_wrist_mrf.xyz, m.T_wrist_mrf.rpy)
    home = np.array(m.postures["ready"])
    centre = (mechanism.pose_wrist(home) @ tool).p
    at = home
    for stop in attitudes(cell, "ready", 24, ROOM):
        for share in np.linspace(0, 1, 50):
            p = (mechanism.pose_wrist(at + share * (stop.q - at)) @ tool).p
            assert np.linalg.norm(p - centre) < 1.05 * ROOM
        for q, joint in zip(stop.q, cell.robot.joints, strict=True):
            assert joint.lower < q < joint.upper
        at = stop.q
    np.testing.assert_array_equal(at, home)


def test_as_many_as_asked_are_measured_and_gravity_comes_from_all_sides(cell):
    mechanism = Mechanism.from_cell(cell)
    stops = [s for s in attitudes(cell, "ready", 20, ROOM) if s.measure]
    assert len(stops) == 20
    up = np.array([mechanism.pose_wrist(s.q).R[2] for s in stops])
    assert np.linalg.cond(np.column_stack([up, np.ones(20)])) < 5


def test_a_posture_that_is_not_there_or_has_no_room_is_named(cell):
    with pytest.raises(ConfigError, match="nowhere"):
        attitudes(cell, "nowhere", 20, ROOM)
    with pytest.raises(ConfigError, match="room"):
        attitudes(cell, "ready", 20, 1e-4)
