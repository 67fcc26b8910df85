"""How far obstacles may be from where they are, or are predicted, a while from now."""

from dataclasses import replace

import numpy as np
import pytest
from telerobot.server.control.scene import UNBOUNDED, Boxes, Rounds, Scene, empty


@pytest.fixture
def scene(rng) -> Scene:
    """Return six rounds that stand, may move at once or slowly, or are taken to stand soon."""
    none = np.zeros((0, 3))
    return Scene(
        names=tuple("abcdef"),
        rounds=Rounds(
            start=rng.uniform(-1, 1, (6, 3)),
            end=rng.uniform(-1, 1, (6, 3)),
            radius=np.full(6, 0.1),
            line=np.zeros(6, dtype=bool),
            carrier=np.full(6, -1),
        ),
        boxes=Boxes(np.zeros((0, 3, 3)), none, none),
        hard=np.ones(6, dtype=bool),
        clearance=np.full(6, 0.02),
        velocity=np.array([[0, 0, 0], [0, 0, 0], [0.3, 0, 0.4], [0, 0.1, 0], [0, 0, 0], [0, 0, 0]]),
        speed=np.array([0.0, 0.5, 0.7, 0.3, 0.2, 0.4]),
        acceleration=np.array([UNBOUNDED, UNBOUNDED, 2.0, 1.0, UNBOUNDED, 0.5]),
        age=np.array([0.0, 0.1, 0.05, 0.0, 0.3, 0.2]),
        still_after=np.array([np.inf, np.inf, np.inf, np.inf, 0.35, 0.3]),
        observed=np.zeros((6, 3)),
    )


def test_reach_is_at_the_bound_of_speed_or_on_the_way_to_it(scene):
    assert scene.reach(0.1) == pytest.approx([0.0, 0.1, 0.0225, 0.005, 0.07, 0.0225])
    assert scene.reach(5.0) == pytest.approx([0.0, 2.55, 3.535, 1.5, 0.07, 0.0225])


def test_nothing_gets_nearer_than_its_prediction_and_its_reach_allow(scene):
    which, ahead = np.array([3, -1, 2, 2, 0, 5]), np.array([0.0, 0.1, 0.6])
    growth = scene.growth(which, ahead)
    for s, t in enumerate(ahead):
        predicted = np.linalg.norm(scene.velocity * t, axis=1)
        expected = np.where(which < 0, 0.0, (scene.reach(float(t)) + predicted)[which])
        assert growth[s] == pytest.approx(expected)


def test_what_is_not_there_moves_nowhere(scene):
    nothing = np.zeros(0, dtype=np.int64)
    assert scene.growth(nothing, np.zeros(3)).shape == (3, 0)
    assert empty().reach(1.0).shape == (0,)
    assert empty().growth(np.array([-1, -1]), np.array([1.0])).tolist() == [[0.0, 0.0]]
    assert not replace(scene, speed=np.zeros(6)).moves
