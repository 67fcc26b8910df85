"""What the verified stop is told of clearances, against every millisecond of the same stop."""

import numpy as np
import pytest
from telerobot.server.control.spatial import Motion, Pose
from telerobot.server.control.stop.trajectory import VelocityPlanner

from .barriers.asked import situation
from .test_clearance import EVERYTHING, FAR, Kept


@pytest.fixture(scope="module")
def kept(pa10):
    return Kept(pa10, EVERYTHING)


def gaps_along(kept: Kept, stop) -> np.ndarray:
    """Return the least gap at every millisecond, less what is promised [m]."""
    around, scene = kept.guard.clearance.search, kept.world.scene(0)
    room = np.full(len(around.capsules.each), FAR)
    found = []
    for q in stop.postures(np.arange(0.0, stop.duration_s + 1e-3, 1e-3)):
        near = around.find(around.capsules.place(q[None]), scene, room, 0.0)
        found.append(float((near.gap - near.promise).min(initial=FAR)))
    return np.array(found)


def test_a_stop_that_is_said_to_be_clear_is_clear_at_every_millisecond(pa10, kept, rng):
    planner = VelocityPlanner(pa10.p.joints.acceleration, pa10.p.joints.jerk)
    scene, none = kept.world.scene(0), np.zeros(7)
    said: list[tuple[bool, float]] = []
    while len(said) < 150:
        q = pa10.posture("ready") + rng.uniform(-0.7, 0.7, 7)
        kept.run.memory.commanded.motion.q[:] = q
        if not 0.0 < kept.gap() < 0.08 or kept.gap(own=True) < 0.0:
            continue
        dq = rng.uniform(-1, 1, 7) * pa10.p.joints.velocity * rng.uniform(0, 1)
        stop = planner.stop(Motion(q, dq, none))
        motion, k = Motion(q, dq, none), pa10.mechanism.kinematics(q, Pose.identity())
        at = situation(k, dq, motion, scene)
        watch = kept.guard.watch(*at)
        short = kept.guard.violation(watch, stop.to_go_s, stop.low, stop.high, stop.postures)
        said.append((short == 0.0, float(gaps_along(kept, stop).min())))
    clear = [least for ok, least in said if ok]
    refused = [least for ok, least in said if not ok]
    assert min(clear) >= 0.0
    # And it is not simply refused whatever comes: those that are, are near the promise or below.
    assert len(clear) > 20
    assert len(refused) > 5
    assert max(refused) < 0.008
