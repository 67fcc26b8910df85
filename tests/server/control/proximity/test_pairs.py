"""What is found near the arm: nothing is missed, and slopes and speeds are those of the gaps."""

from dataclasses import replace

import numpy as np
import pytest
from telerobot.config.load import Cell, altered
from telerobot.config.schema.surroundings import (
    AllowedContactSection,
    AvoidanceSection,
    ObstacleSection,
)
from telerobot.server.control.proximity.capsules import Capsules
from telerobot.server.control.proximity.pairs import PairSearch
from telerobot.server.control.scene import Scene
from telerobot.server.control.spatial import Pose
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap

BOXES = tuple(
    ObstacleSection(
        name=f"box{i}", shape="box", xyz=xyz, half_size=(0.1, 0.2, 0.05), rpy=(0.3, 0.5, i)
    )
    for i, xyz in enumerate([(0.6, 0.1, 0.2), (-0.5, 0.4, 0.6)])
)
ROUNDS = (
    ObstacleSection(
        name="pole", shape="capsule", xyz=(0.5, 0.35, 0), to=(0.5, 0.35, 1), radius=0.05
    ),
    ObstacleSection(name="ball", shape="sphere", xyz=(0.4, -0.4, 0.7), radius=0.1, clearance=0.07),
    ObstacleSection(name="post", shape="point", xyz=(0.85, 0.0, 0.5)),
)
VIEW = ObstacleSection(name="view", shape="sight_line", xyz=(0.0, -0.4, 1.0), to=(0.8, -0.2, 0.1))
EVERYWHERE = 1e3


class Near:
    """An arm among obstacles."""

    def __init__(self, cell: Cell, obstacles: tuple[ObstacleSection, ...], **avoidance) -> None:
        given = AvoidanceSection(enabled=True, clearance=0.02, self_clearance=0.01, **avoidance)
        cell = altered(cell, {"obstacles": obstacles, "avoidance": given})
        self.capsules = Capsules(cell)
        self.search = PairSearch(cell, self.capsules)
        self.scene = ObstacleMap.from_cell(cell, Events()).scene(0)

    def look(self, q, room=EVERYWHERE, scene: Scene | None = None, ahead_s=0.0, base=None):
        rooms = np.full(len(self.capsules.each), room)
        placed = self.capsules.place(q[None], base)
        return self.search.find(placed, self.scene if scene is None else scene, rooms, ahead_s)


@pytest.fixture(params=["pa10", "ur5e"])
def arm(request):
    return request.getfixturevalue(request.param)


def _names(near) -> list[tuple[int, int]]:
    return list(zip(near.first.tolist(), near.second.tolist(), strict=True))


def test_every_pair_that_is_near_is_found_and_few_others(arm, rng):
    among = Near(arm.cell, ROUNDS + BOXES)
    found = every = 0
    for _ in range(100):
        q, room = arm.random_posture(rng), rng.uniform(0.0, 0.3)
        near, all_pairs = among.look(q, room), among.look(q)
        # Two links may both come nearer by the room.
        both = room * np.where(all_pairs.obstacle < 0, 2.0, 1.0)
        due = all_pairs.gap < all_pairs.promise + both
        names = _names(near)
        assert set(names) >= {p for p, is_due in zip(_names(all_pairs), due, strict=True) if is_due}
        found, every = found + len(names), every + all_pairs.size
        # What is found is the same as where everything is.
        place = {name: i for i, name in enumerate(_names(all_pairs))}
        index = [place[name] for name in names]
        assert index == sorted(index)
        for told, expected in ((near.gap, all_pairs.gap), (near.rows, all_pairs.rows)):
            np.testing.assert_array_equal(told, expected[index])
    assert found < 0.5 * every


def test_slopes_of_gaps_agree_with_finite_differences(arm, rng):
    among = Near(arm.cell, ROUNDS + BOXES)
    h = 1e-7
    checked = 0
    for _ in range(10):
        q = arm.random_posture(rng)
        near = among.look(q)
        smooth = near.near.distance > 0.02
        for j in range(arm.p.n):
            step = h * np.eye(arm.p.n)[j]
            slope = (among.look(q + step).gap - among.look(q - step).gap) / (2 * h)
            # Where the nearest place leaps there is no slope: a few of very many.
            off = np.abs(slope - near.rows[:, j])[smooth] > 1e-5
            assert off.mean() < 0.02
            checked += len(off)
    assert checked > 1000


def test_gaps_and_promises_are_those_of_the_things_that_pairs_name(pa10, rng):
    among = Near(pa10.cell, ROUNDS + BOXES)
    near = among.look(pa10.posture("ready"))
    capsules = len(among.capsules.each)
    radius = [*among.capsules.radius, *among.scene.rounds.radius, 0.0, 0.0]
    promised = {"ball": 0.07}
    for i, (first, second) in enumerate(_names(near)):
        assert near.obstacle[i] == max(second - capsules, -1)
        assert near.gap[i] == pytest.approx(near.near.distance[i] - radius[first] - radius[second])
        own = second < capsules
        name = "" if own else among.scene.names[second - capsules]
        assert near.promise[i] == (0.01 if own else promised.get(name, 0.02))


def test_what_may_touch_what_is_soft_and_base_are_left_out(pa10):
    contact = AllowedContactSection(link="hand", other="post")
    among = Near(pa10.cell, (*ROUNDS, VIEW), allowed_contacts=(contact,))
    near = among.look(pa10.posture("ready"))
    found = {
        (among.capsules.links[first], among.scene.names[obstacle])
        for first, obstacle in zip(near.first, near.obstacle, strict=True)
        if obstacle >= 0
    }
    moved = {link for c, link in enumerate(among.capsules.links) if among.capsules.body[c] > 0}
    assert found == {(link, o.name) for link in moved for o in ROUNDS} - {("hand", "post")}


def test_what_comes_nearer_is_as_fast_as_its_gap_closes(pa10, rng):
    among = Near(pa10.cell, ROUNDS + BOXES)
    scene, h = among.scene, 1e-6
    velocity = rng.normal(0.0, 0.3, (len(scene.names), 3))
    bound = np.array([0.1, 0.0, 0.2, 0.0, 0.3])
    moving = replace(scene, velocity=velocity, speed=bound)
    m = len(scene.rounds.radius)
    later = replace(
        moving,
        rounds=replace(
            scene.rounds,
            start=scene.rounds.start + h * velocity[:m],
            end=scene.rounds.end + h * velocity[:m],
        ),
        boxes=replace(scene.boxes, centre=scene.boxes.centre + h * velocity[m:]),
    )
    q = pa10.posture("ready")
    near = among.look(q, scene=moving)
    others = near.obstacle >= 0
    closing = (near.gap - among.look(q, scene=later).gap) / h
    expected = np.where(others, np.maximum(bound[near.obstacle] + closing, 0.0), 0.0)
    assert near.speed == pytest.approx(expected, abs=1e-4)
    assert (near.speed > 0.0).any()


def test_what_moves_is_looked_at_as_far_ahead_as_it_may_be_near(pa10):
    among = Near(pa10.cell, (ROUNDS[2].model_copy(update={"xyz": (1.6, 0.0, 0.5)}),))
    q = pa10.posture("ready")
    comes = replace(among.scene, speed=np.array([2.0]), still_after=np.array([np.inf]))
    for scene, ahead_s, seen in (
        (among.scene, 0.4, False),
        (comes, 0.1, False),
        (comes, 0.4, True),
    ):
        assert (among.look(q, 0.1, scene, ahead_s).obstacle >= 0).any() == seen


def test_a_base_elsewhere_carries_all_links(pa10):
    among = Near(pa10.cell, ROUNDS + BOXES)
    q, away = pa10.posture("ready"), Pose(np.eye(3), np.array([0.0, 0.0, 10.0]))
    near, far = among.look(q), among.look(q, base=away)
    own = near.obstacle < 0
    assert far.gap[own] == pytest.approx(near.gap[own], abs=1e-12)
    assert far.gap[~own].min() > 8.0
