"""Base and Carrier move in the rig's process; what the arm does about it is judged by the physics.

The rig itself tells where they are. Where a publisher is to be killed, it is one of the test's own:
the rig's sensor of that frame is silenced, and another process tells instead.
"""

import subprocess
import sys

import numpy as np
import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.messages.perception import RigMotion
from telerobot.server.control.spatial import Pose, rotation_log

pytestmark = [pytest.mark.hil, pytest.mark.alone]

ABOVE = [0.0, 0.0, 0.05]
"""Of the Carrier; the tool points down to it [m]."""

SWAYS = 0.25
"""Greatest acceleration of the tool on a platform that sways, were it not led [m/s²]."""

PUBLISHER = """
import sys, time
from telerobot.protocols import topics as t
from telerobot.protocols.codec import decode_as, encode
from telerobot.protocols.messages.perception import FrameNews
from telerobot.protocols.messages.rig import RigTruth
from telerobot.protocols.messages.telemetry import State
from telerobot.drivers.network.session import Session

session = Session("pa10_platform", sys.argv[1])
truths, states = session.subscribe(t.RIG_TRUTH, 1), session.subscribe(t.STATE, 1)
tick = None
while True:
    for payload in states.take():
        tick = decode_as(State, payload, t.STATE.max_bytes).tick
    for payload in truths.take():
        x, y, z, *rpy = decode_as(RigTruth, payload, t.RIG_TRUTH.max_bytes).frames["carrier"]
        if tick is not None:
            news = FrameNews(name="carrier", tick=tick, xyz=(x, y, z), rpy=tuple(rpy))
            session.put(t.FRAME_NEWS, encode(news))
    time.sleep(0.005)
"""


def pose(six):
    return Pose.from_xyz_rpy(six[:3], six[3:])


def on_carrier(truth):
    return (pose(truth.frames["carrier"]).inverse() @ pose(truth.pose_mrf)).p


def during(plant, physics_s):
    """Let so much physics time pass; return the truths of it."""
    first = len(plant.truths)
    plant.run_for(physics_s)
    return plant.truths[first:]


def events(operator, name, frame):
    return [e for e in operator.events if e.name == name and e.values["frame"] == frame]


@pytest.fixture
def operator(make_plant):
    """An operator whose tool is over the Carrier, with the CRF on it; it stands still yet."""
    plant = make_plant("pa10_platform")
    operator = plant.enabled_operator()
    operator.plant = plant
    operator.request(t.FRAME, frame="crf", moves_with="carrier", relative_to="carrier")
    operator.move_to(ABOVE, [0.0, 2.2, 0.0])
    plant.until(lambda: np.linalg.norm(on_carrier(plant.truth) - ABOVE) < 2e-3, 20.0)
    plant.run_for(1.0)
    return operator


def test_the_arm_follows_a_conveyor_and_a_stick_pushes_it_aside(operator):
    plant = operator.plant
    operator.inject(RigMotion(target="carrier", twist=(0.0, 0.1, 0.0, 0.0, 0.0, 0.0)))
    plant.run_for(1.5)
    followed = during(plant, 1.0)
    speed = np.diff([tr.frames["carrier"][1] for tr in (followed[0], followed[-1])])[0]
    assert speed / (followed[-1].time_s - followed[0].time_s) == pytest.approx(0.1, rel=0.02)
    error = np.array([on_carrier(tr) for tr in followed]) - ABOVE
    assert np.linalg.norm(error.mean(axis=0)) < 1e-3
    assert np.linalg.norm(error, axis=1).max() < 3e-3
    operator.joystick([-0.04, 0.0, 0.04, 0.0, 0.0, 0.0], seconds=0.8, expressed_in="base")
    plant.turn()
    aside = on_carrier(plant.truth) - ABOVE
    assert aside[0] < -0.01
    assert aside[2] > 0.01
    plant.run_for(3.0)
    back = np.array([on_carrier(tr) for tr in during(plant, 0.5)]) - ABOVE
    assert np.linalg.norm(back.mean(axis=0)) < 1e-3


def test_the_tool_keeps_its_pose_in_world_over_a_platform_that_sways(operator):
    plant = operator.plant
    operator.request(t.FRAME, frame="crf", moves_with="world")
    at = pose(plant.truth.pose_mrf)
    sway = (0.0, 0.05, 0.02, 0.02, 0.0, 0.04)
    operator.inject(RigMotion(target="platform", sway=sway, period_s=4.0))
    plant.run_for(2.0)
    ages = []
    operator.on_state = lambda state: ages.append(state.frame_age_ticks["base"])
    swaying = during(plant, 4.0)
    first = pose(swaying[0].frames["base"]).inverse() @ at
    carried = np.ptp([(pose(tr.frames["base"]) @ first).p[1] for tr in swaying])
    assert carried > 0.12
    error = np.array([pose(tr.pose_mrf).p - at.p for tr in swaying])
    turned = [np.linalg.norm(rotation_log(at.R.T @ pose(tr.pose_mrf).R)) for tr in swaying]
    # News is carried on to now at the speed that it tells of: what it misses grows with its age.
    oldest_s = max(ages) * 0.01
    assert np.linalg.norm(error, axis=1).max() < 4e-3 + 0.5 * SWAYS * oldest_s**2
    assert np.ptp(error[:, 1]) < carried / 15.0
    assert max(turned) < 8e-3
    assert operator.state.mode == "enabled"


def test_a_publisher_that_is_killed_is_named_and_no_longer_followed_until_news_comes(operator):
    plant = operator.plant
    plant.inject("silence", "carrier")
    plant.until(lambda: events(operator, "frame_lost", "carrier"), 3.0, "the rig goes on telling")
    command = [sys.executable, "-c", PUBLISHER, plant.cell.config.zenoh.listen]
    publisher = subprocess.Popen(command, stderr=subprocess.PIPE)
    try:
        found = len(events(operator, "frame_found", "carrier"))
        plant.wait_wall(
            lambda: len(events(operator, "frame_found", "carrier")) > found, "nobody tells"
        )
        operator.inject(RigMotion(target="carrier", twist=(0.0, 0.08, 0.0, 0.0, 0.0, 0.0)))
        plant.run_for(1.5)
        fed_forward = []
        operator.on_state = lambda state: fed_forward.append(state.sources["frames"][1])
        error = np.array([on_carrier(tr) for tr in during(plant, 0.5)]) - ABOVE
        assert np.linalg.norm(error.mean(axis=0)) < 3e-3
        assert np.mean(fed_forward) == pytest.approx(0.08, abs=0.01)
        publisher.kill()
        plant.until(lambda: len(events(operator, "frame_lost", "carrier")) == 2, 1.5, "not named")
        lost = events(operator, "frame_lost", "carrier")[-1]
        assert lost.values["reason"] == "no_news"
        plant.run_for(1.0)
        stood = during(plant, 0.5)
        assert np.ptp([tr.pose_mrf[1] for tr in stood]) < 2e-3
        assert stood[-1].frames["carrier"][1] - stood[0].frames["carrier"][1] > 0.03
        assert operator.state.frame_age_ticks["carrier"] is None
        assert operator.state.mode == "enabled"
    finally:
        publisher.kill()
        publisher.communicate()
    plant.inject("silence", "carrier", on=False)
    plant.until(lambda: operator.state.frame_age_ticks["carrier"] is not None, 2.0, "not found")
    plant.run_for(3.0)
    back = np.array([on_carrier(tr) for tr in during(plant, 0.3)]) - ABOVE
    assert np.linalg.norm(back.mean(axis=0)) < 2e-3
    assert [e for e in operator.events if e.severity == "error"] == []
