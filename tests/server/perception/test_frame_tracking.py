"""What is made of news that is late, seldom and noisy: no lag at constant motion, no jumps."""

from dataclasses import replace

import numpy as np
import pytest
from telerobot.server.control.spatial import Pose, pose_error, rotation_exp
from telerobot.server.perception.filters import (
    Follower,
    NewsRejection,
    PlausibleMotion,
    RejectedNews,
    update_track,
)

T = 0.01
LATE, EVERY = 6, 3
"""Ticks from measurement to hearing, and between two measurements."""
PLAUSIBLE = PlausibleMotion(
    T, 0.3, 1.0, 2.0, 0.02, 0.05, 0.06, 2.0, 6.0, (np.inf, np.inf), Pose.identity()
)
A, J = np.repeat([2.0, 6.0], 3), np.repeat([40.0, 120.0], 3)


def arc(t, twist, acceleration=0.0):
    """Return the pose at t on the way of a constant twist, times 1 + acceleration t / 2."""
    way = np.asarray(twist) * (t + 0.5 * acceleration * t * t)
    return Pose(rotation_exp(way[3:]), way[:3])


class Listener:
    """Hears of a frame's true poses, late and noisy, and follows it."""

    def __init__(self, truth, noise=0.0, twist=None, rng=None, plausible=PLAUSIBLE):
        self.plausible, self.truth, self.noise, self.twist, self.rng = (
            plausible,
            truth,
            noise,
            twist,
            rng,
        )
        self.follower = Follower(np.repeat([0.5, 1.0], 3), A, J, T)
        self.state = self.follower.standing(truth(0.0))
        self.track = None
        self.told = []

    def run(self, ticks, heard=lambda tick: True, snap=False):
        for tick in ticks:
            measured = tick - LATE
            if measured >= 0 and measured % EVERY == 0 and heard(tick):
                pose = self.truth(measured * T)
                if self.noise:
                    n = self.rng.normal(size=6) * self.noise
                    pose = Pose(rotation_exp(n[3:]) @ pose.R, pose.p + n[:3])
                twist = None if self.twist is None else self.twist(measured * T)
                found = update_track(self.track, measured, pose, twist, 1.0, self.plausible)
                assert not isinstance(found, RejectedNews), f"{found} at {tick}"
                self.track = found
            self.state = self.follower.step(self.state, self.track, tick, T, snap)
            self.told.append(self.state.now)
        return self.state.now

    def bounded(self):
        """Assert that what was told has no jump in pose, and accelerates within the bounds."""
        for before, after in zip(self.told, self.told[1:], strict=False):
            step = pose_error(after.T, before.T)
            np.testing.assert_allclose(step, T * after.twist, atol=T * T * 2 * A.max())


@pytest.mark.parametrize("acceleration", [0.0, 0.5])
def test_a_constant_motion_is_followed_without_lag_however_late_its_news(acceleration):
    twist = np.array([0.1, -0.05, 0.02, 0.1, 0.0, -0.2])
    if acceleration:
        twist[3:] = [0.0, 0.0, 0.2]
    listener = Listener(lambda t: arc(t, twist, acceleration))
    now = listener.run(range(200))
    at = 200 * T  # the last tick is 199, and it is asked for a period later
    away = pose_error(arc(at, twist, acceleration), now.T)
    np.testing.assert_allclose(away, 0.0, atol=2e-5)
    np.testing.assert_allclose(now.twist, twist * (1 + acceleration * at), atol=2e-4)


def test_a_twist_that_is_measured_takes_part_and_leaves_less_lag():
    def truth(t):
        return Pose(np.eye(3), np.array([0.1 * np.sin(3.0 * t), 0.0, 0.0]))

    def twist(t):
        return np.array([0.3 * np.cos(3.0 * t), 0, 0, 0, 0, 0])

    errors = {}
    for name, measured in (("poses", None), ("twists", twist)):
        listener = Listener(truth, twist=measured)
        listener.run(range(400))
        told = [now.T.p[0] for now in listener.told[100:]]
        true = [truth((tick + 1) * T).p[0] for tick in range(100, 400)]
        errors[name] = np.abs(np.subtract(told, true)).max()
    assert errors["poses"] < 0.1 / 6
    assert errors["twists"] < 0.6 * errors["poses"]


def test_noise_is_not_amplified(rng):
    twist = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    slow = replace(PLAUSIBLE, smoothing_s=0.2)
    listener = Listener(lambda t: arc(t, twist), noise=5e-4, rng=rng, plausible=slow)
    listener.run(range(1000))
    told = np.array([b.T.p[1:] for b in listener.told[100:]])
    assert told.std() < 5e-4
    assert np.array([b.twist for b in listener.told[100:]]).std(axis=0).max() < 0.1 * 0.1
    listener.bounded()


def test_silence_brings_the_frame_to_rest_inside_its_bounds_and_news_brings_it_back():
    twist = np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0])
    listener = Listener(lambda t: arc(t, twist))
    listener.run(range(100))
    listener.track = None  # its news is stale now
    stopped = listener.run(range(100, 200), heard=lambda tick: False)
    assert not stopped.twist.any()
    gone = stopped.T.p[0] - listener.told[99].T.p[0]
    assert 0.0 < gone < 0.2**2 / 2.0 + 0.2 / 20.0 + 0.01
    found = listener.run(range(200, 500))
    np.testing.assert_allclose(found.T.p, arc(500 * T, twist).p, atol=1e-4)
    listener.bounded()


def test_no_news_makes_a_frame_faster_or_accelerate_more_than_it_may(rng):
    """Wild but plausible news: each within the slack of the last, in one sense or another."""
    listener = Listener(lambda t: Pose.identity())
    speed, most = np.array([0.5, 1.0]), np.array([2.0, 6.0])
    place, way, before = Pose.identity(), np.zeros(6), listener.state.now.twist
    for tick in range(LATE, 600):
        if tick % 20 == 0:
            way = np.repeat([0.019, 0.045], 3) / np.sqrt(3.0) * rng.choice([-1.0, 0.0, 1.0], 6)
        place = Pose(rotation_exp(way[3:]) @ place.R, place.p + way[:3])
        found = update_track(listener.track, tick - LATE, place, None, 1.0, PLAUSIBLE)
        if isinstance(found, RejectedNews):
            place = listener.track.T
        else:
            listener.track = found
            assert np.linalg.norm(found.acceleration[:3]) <= 2.0 * 1.001
        listener.state = listener.follower.step(listener.state, listener.track, tick, T, False)
        twist = listener.state.now.twist
        for part, v, a in zip((slice(0, 3), slice(3, 6)), speed, most, strict=True):
            assert np.linalg.norm(twist[part]) <= v * 1.001
            assert np.linalg.norm(twist[part] - before[part]) <= a * T * 1.001
        before = twist


def test_where_nothing_depends_on_it_the_frame_is_told_as_it_is_believed():
    far = Pose(rotation_exp(np.array([0.0, 0.5, 0.0])), np.array([1.0, 2.0, 3.0]))
    listener = Listener(lambda t: far)
    listener.state = Follower.standing(Pose.identity())
    now = listener.run(range(20), snap=True)
    np.testing.assert_allclose(pose_error(now.T, far), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("doubt", "news"),
    [
        (NewsRejection.QUALITY, {"quality": 0.2}),
        (NewsRejection.SPEED, {"twist": np.array([1.1, 0, 0, 0, 0, 0])}),
        (NewsRejection.OUT_OF_ORDER, {"tick": 10}),
        (NewsRejection.JUMP, {"T": Pose(np.eye(3), np.array([0.2, 0.0, 0.0]))}),
        (NewsRejection.JUMP, {"T": Pose(rotation_exp(np.array([0.3, 0, 0])), np.zeros(3))}),
        (NewsRejection.ACCELERATION, {"T": Pose(np.eye(3), np.array([0.03, 0.0, 0.0]))}),
        (NewsRejection.EXTENT, {"T": Pose(np.eye(3), np.array([0.5, 0.0, 0.0]))}),
        (NewsRejection.EXTENT, {"T": Pose(rotation_exp(np.array([0.5, 0, 0])), np.zeros(3))}),
    ],
)
def test_what_is_not_plausible_is_not_believed_and_told_with_value_and_bound(doubt, news):
    track = None
    near = replace(PLAUSIBLE, extent=(0.4, 0.4))
    for tick in (4, 6, 8, 10, 30):
        track = update_track(track, tick, Pose.identity(), None, 1.0, near)
    given = {"tick": 32, "T": Pose.identity(), "twist": None, "quality": 1.0, **news}
    found = update_track(track, plausible=near, **given)
    assert found.doubt is doubt
    assert (found.value < found.bound) == (
        doubt in (NewsRejection.QUALITY, NewsRejection.OUT_OF_ORDER)
    )
    assert str(doubt) in found.words
