import numpy as np
import pytest
from telerobot.protocols.messages.messages import ClutchRequest, MasterPose
from telerobot.server.commands.haptics import SLIP, Master
from telerobot.server.control.spatial import Pose, pose_error, rotation_log, rotation_rpy
from telerobot.server.refusals import Refused, Why

ENVELOPE = {"seen_tick": 1}
MRF = Pose.from_xyz_rpy((0.7, 0.1, 0.4), (0.2, -0.5, 1.1))
AXES = rotation_rpy(0.0, 0.0, np.pi / 2)
AWAY = (5.0, -3.0, 2.0), (0.4, 0.1, -2.0)
"""Where a master device may happen to be: far from any arm."""


def clutch(**fields):
    return ClutchRequest(**ENVELOPE, **fields)


def pose(xyz, rpy):
    return MasterPose(**ENVELOPE, xyz=tuple(xyz), rpy=tuple(rpy))


class Hand:
    """A hand on a master that is engaged; the arm follows at once."""

    def __init__(self, axes=None):
        self.axes = np.eye(3) if axes is None else axes
        self.master, self.now_s = Master(), 0.0
        self.p, self.rpy = np.array(AWAY[0]), np.array(AWAY[1])
        self.T = MRF
        self.master.set(clutch(engaged=True))

    def move(self, by=(0, 0, 0), steps=10, turn=(0, 0, 0), follows=True):
        for _ in range(steps):
            self.p = self.p + np.array(by) / steps
            self.rpy = self.rpy + np.array(turn) / steps
            self.now_s += 0.01
            self.master.take(pose(self.p, self.rpy), self.now_s, self.axes, self.T)
            if follows and self.master.target is not None:
                self.T = self.master.target
        return self

    def set(self, **fields):
        self.master.set(clutch(**fields))
        return self


def same(a, b, atol=1e-9):
    np.testing.assert_allclose(pose_error(a, b), 0.0, atol=atol)


@pytest.fixture
def hand():
    hand = Hand()
    hand.move(steps=1)
    return hand


def test_engaging_takes_the_target_from_where_the_tool_is_wherever_the_master_is(hand):
    same(hand.master.target, MRF)


def test_the_masters_motion_moves_the_target_in_the_axes_named():
    hand = Hand(AXES).move(steps=1).move((0.1, 0.02, 0.0))
    np.testing.assert_allclose(hand.master.target.p - MRF.p, [-0.02, 0.1, 0.0], atol=1e-12)
    same(Pose(hand.master.target.R, MRF.p), MRF)


def test_a_whole_turn_of_the_hand_is_a_whole_turn_of_the_tool(hand):
    hand.rpy = np.zeros(3)
    hand.master.set(clutch(engaged=False))
    hand.set(engaged=True).move(steps=1)
    hand.move(turn=(0, 0, 1.5), steps=30)
    expected = rotation_rpy(0, 0, 1.5) @ MRF.R
    same(hand.master.target, Pose(expected, MRF.p))
    hand.move(turn=(0, 0, -1.5), steps=30)
    same(hand.master.target, MRF)


@pytest.mark.parametrize(("translation", "rotation"), [(0.2, 3.0), (4.0, 0.5), (0.0, 0.0)])
def test_translation_and_rotation_are_scaled_apart(hand, translation, rotation):
    hand.rpy = np.zeros(3)
    hand.set(engaged=False)
    hand.set(engaged=True, translation=translation, rotation=rotation).move(steps=1)
    hand.move((0.02, -0.01, 0.03), turn=(0.0, 0.3, 0.0))
    moved = hand.master.target.p - MRF.p
    np.testing.assert_allclose(moved, translation * np.array([0.02, -0.01, 0.03]), atol=1e-12)
    turned = rotation_log(hand.master.target.R @ MRF.R.T)
    np.testing.assert_allclose(turned, [0.0, 0.3 * rotation, 0.0], atol=1e-9)


def test_a_new_scale_never_moves_the_target(hand):
    hand.move((0.03, 0.0, 0.0))
    before = hand.master.target
    hand.set(translation=10.0, rotation=0.1)
    same(hand.master.target, before)
    hand.move(steps=3)
    same(hand.master.target, before)


def test_what_the_master_does_while_disengaged_does_not_count(hand):
    hand.move((0.03, 0.0, 0.0)).set(engaged=False)
    at = hand.T
    assert hand.master.target is None
    hand.move((0.3, 0.3, 0.3), turn=(1.0, 0, 0))
    hand.set(engaged=True).move(steps=1)
    same(hand.master.target, at)
    hand.move((0.0, 0.02, 0.0))
    np.testing.assert_allclose(hand.master.target.p - at.p, [0.0, 0.02, 0.0], atol=1e-12)


def test_silence_lets_go_and_the_next_word_counts_from_there(hand):
    hand.move((0.03, 0.0, 0.0))
    at = hand.T
    assert not hand.master.expired(hand.now_s + 0.1, 0.15)
    assert hand.master.expired(hand.now_s + 0.2, 0.15)
    assert not hand.master.expired(hand.now_s + 0.2, 0.15)
    assert hand.master.target is None
    hand.p = hand.p + 0.5
    hand.move(steps=1)
    same(hand.master.target, at)


def test_a_leap_of_the_master_is_refused_and_the_next_word_counts_from_there(hand):
    before = hand.master.target
    hand.p = hand.p + 0.3
    with pytest.raises(Refused) as caught:
        hand.move(steps=1)
    assert caught.value.reason == Why.OUT_OF_RANGE
    same(hand.master.target, before)
    hand.move((0.01, 0, 0))
    np.testing.assert_allclose(hand.master.target.p - before.p, [0.01, 0, 0], atol=1e-12)


def test_the_target_leads_a_tool_that_is_held_by_no_more_than_it_may(hand):
    hand.move((0.5, 0.0, 0.0), turn=(1.0, 0.0, 0.0), steps=50, follows=False)
    lead = pose_error(hand.master.target, hand.T)
    assert np.linalg.norm(lead[:3]) == pytest.approx(SLIP[0])
    assert np.linalg.norm(lead[3:]) == pytest.approx(SLIP[1])
    # The way back begins at once: what slipped has not to be undone first.
    hand.move((-0.02, 0.0, 0.0), follows=False)
    assert hand.master.target.p[0] - hand.T.p[0] == pytest.approx(SLIP[0] - 0.02, abs=1e-9)


def test_the_pose_mode_waits_to_be_engaged():
    hand = Hand()
    hand.master = Master()
    hand.move((0.1, 0, 0))
    assert hand.master.target is None
    hand.set(translation=2.0).move((0.1, 0, 0))
    assert hand.master.target is None
    hand.set(engaged=True).move(steps=1)
    same(hand.master.target, MRF)


def test_a_stick_is_scaled_and_let_through_only_while_engaged():
    master, twist = Master(), np.arange(1.0, 7.0)
    np.testing.assert_array_equal(master.scaled(twist), twist)
    master.set(clutch(translation=0.5, rotation=2.0))
    np.testing.assert_allclose(master.scaled(twist), [0.5, 1.0, 1.5, 8.0, 10.0, 12.0])
    master.set(clutch(engaged=False))
    assert master.scaled(twist) is None
