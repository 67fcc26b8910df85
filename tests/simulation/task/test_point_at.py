"""A tool that looks at a point while it goes past, through the whole line and its physics."""

import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.config.schema.sources import PointAtSection
from telerobot.protocols.messages.telemetry import State
from telerobot.server.control.spatial import Pose

STICK = {"twist": [0.0, 0.08, 0.0, 0.0, 0.0, 0.0], "expressed_in": "base"}
BELOW = 0.4
"""The point is so far ahead of the tool at start [m]."""


def rotation(pose):
    return Pose.from_xyz_rpy(pose[:3], pose[3:]).R


@pytest.fixture
def watching(pa10, play):
    """A PA-10 that looks at a point straight ahead of its tool, which it is told."""
    pose = np.array(play(seconds=0.3).truths[-1].pose_mrf)
    point = pose[:3] + BELOW * rotation(pose)[:, 2]
    section = PointAtSection(gain=(0.0,) * 3 + (2.0,) * 3, point=tuple(point))
    free = {"sources.point_at": section, "rig.wall": None, "rig.boxes": ()}
    return altered(pa10, free), point


def off(pose, point):
    """Return the angle between the tool's axis and the line to a point [rad], in the physics."""
    way = point - np.array(pose[:3])
    cosine = rotation(pose)[:, 2] @ way / np.linalg.norm(way)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def test_a_tool_that_goes_past_looks_at_the_point_all_the_way_until_it_is_let_go(watching, play):
    cell, point = watching
    run = play(
        {"at_s": 0.3, "cmd/joystick": STICK},
        {"at_s": 3.0, "operator/switch": {"source": "point_at", "on": False}},
        seconds=4.5,
        cell=cell,
    )
    assert run.summary["failure"] is None
    assert run.summary["limit_violations"] == 0
    start = run.simulation.player.start_s
    on_way = [t.pose_mrf for t in run.truths if 0.0 <= t.time_s - start <= 3.0]
    assert np.linalg.norm(np.array(on_way[-1][:3]) - np.array(on_way[0][:3])) > 0.19
    # It turned by 28 degrees; without what is fed forward it would be v / (r K) = 0.1 rad behind.
    assert max(off(pose, point) for pose in on_way) < 0.01
    state: State = run.at(2.5)
    assert np.linalg.norm(state.sources["point_at"][3:]) > 0.1
    assert state.sources["point_at"][:3] == (0.0, 0.0, 0.0)
    assert off(run.truths[-1].pose_mrf, point) > 0.1
    assert not run.at(4.0).on["point_at"]
