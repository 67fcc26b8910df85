"""The tree of frames against finite differences of frames that truly move."""

import numpy as np
import pytest
from telerobot.server.control.scene import FRAMES, Body, FrameTree, Mount, Moved, UnknownFrame
from telerobot.server.control.spatial import Pose, pose_error, rotation_exp, rotation_rpy

STEP_S = 1e-5


def random_pose(rng):
    return Pose(rotation_rpy(*rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 3))


def moved_on(body, seconds):
    turn, way = seconds * body.twist[3:], seconds * body.twist[:3]
    return Body(Pose(rotation_exp(turn) @ body.T.R, body.T.p + way), body.twist)


@pytest.fixture
def world(rng):
    """A function from time to the tree of three bodies that move, everything mounted askew."""
    base, carrier, wrist = (Body(random_pose(rng), rng.uniform(-1, 1, 6)) for _ in range(3))
    T_wrist_mrf, sensor = random_pose(rng), random_pose(rng)
    crf, lens = Mount("carrier", random_pose(rng)), Mount("base", random_pose(rng))

    def at(seconds):
        b, c, w = (moved_on(body, seconds) for body in (base, carrier, wrist))
        moved = Moved(b, c, b.T)
        return FrameTree(moved, w.T @ T_wrist_mrf, T_wrist_mrf, crf, sensor, lens, wrist.twist)

    return at


@pytest.mark.parametrize("seen_from", FRAMES)
@pytest.mark.parametrize("frame", FRAMES)
def test_a_frames_twist_seen_from_another_is_the_rate_of_its_pose_there(world, frame, seen_from):
    tree = world(0.0)
    before, after = (world(t).pose(frame, seen_from) for t in (-STEP_S, STEP_S))
    rate = pose_error(after, before) / (2 * STEP_S)
    R = tree.pose(seen_from).R
    found = tree.twist(frame, seen_from)
    np.testing.assert_allclose(R @ rate[:3], found[:3], atol=1e-5)
    np.testing.assert_allclose(R @ rate[3:], found[3:], atol=1e-5)


def test_a_tool_that_does_what_its_ground_carries_stands_still_on_it(world):
    tree = world(0.0)
    p = tree.pose("mrf").p
    for ground in ("world", "base", "carrier"):
        expected = tree.twist(ground, "base", at=p)
        np.testing.assert_allclose(tree.moved.carries(ground, p), expected, atol=1e-12)


def test_a_frame_that_is_not_there_is_named_with_those_that_are(world):
    tree = world(0.0)
    bare = FrameTree(
        tree.moved, tree.T_world_mrf, tree.T_wrist_mrf, Mount("world", Pose.identity())
    )
    for name in ("lens", "sensor", "hand"):
        with pytest.raises(UnknownFrame) as caught:
            bare.pose(name)
        assert str(caught.value).endswith("world, base, carrier, crf, wrist, mrf")


def test_what_the_arm_carries_moves_with_a_base_that_moves_an_arm_at_rest(world):
    tree = world(0.0)
    resting = FrameTree(tree.moved, tree.T_world_mrf, tree.T_wrist_mrf, tree.crf)
    np.testing.assert_allclose(resting.twist("mrf", "base"), 0.0, atol=1e-12)
