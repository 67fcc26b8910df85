"""Obstacles by name: news, its age, what holds when it is stale, and what is refused."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.surroundings import ObstacleSection
from telerobot.protocols.codec import CodecError, decode_as, encode
from telerobot.protocols.messages.perception import ObstacleNews
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import MOST, ObstacleMap
from telerobot.server.refusals import Refused, Why

TABLE = ObstacleSection(name="table", shape="box", xyz=(0.5, 0, 0.1), half_size=(0.2, 0.4, 0.1))
CART = ObstacleSection(
    name="cart", shape="sphere", xyz=(2, 0, 0), radius=0.2, max_speed=0.5, timeout_s=0.2
)


@dataclass
class Knowing:
    """A world model, the tick, and the events that came of it."""

    obstacles: tuple[ObstacleSection, ...] = ()
    certified: bool = False
    tick: int = 1000
    events: Events = field(default_factory=Events)

    def __post_init__(self) -> None:
        cell = load_cell("pa10")
        self.world = ObstacleMap.from_cell(
            altered(cell, {"obstacles": self.obstacles}), self.events
        )
        if self.certified:
            self.world = ObstacleMap(self.obstacles, (), 0.02, 0.01, self.events, certified=True)

    def tell(self, name: str, by: str = "", **news) -> None:
        self.world.take(ObstacleNews(name=name, **{"tick": self.tick, **news}), self.tick, by)

    def refused(self, name: str, by: str = "", **news) -> Why:
        with pytest.raises(Refused) as caught:
            self.tell(name, by, **news)
        return caught.value.reason

    def go(self, ticks: int) -> None:
        for _ in range(ticks):
            self.tick += 1
            self.events.at(self.tick, 0.01 * self.tick)
            self.world.update(self.tick)

    @property
    def scene(self):
        return self.world.scene(self.tick)

    @property
    def told(self) -> list[str]:
        return [event.name for event in self.events.take()]


@pytest.fixture
def knowing():
    return Knowing()


def test_obstacles_are_set_moved_and_removed(knowing):
    knowing.tell("ball", shape="sphere", xyz=(1, 2, 3), radius=0.1, max_speed=10.0)
    knowing.go(100)
    knowing.tell("ball", xyz=(1, 2, 4))
    assert knowing.scene.rounds.start.tolist() == [[1, 2, 4]]
    assert knowing.scene.rounds.radius.tolist() == [0.1]
    knowing.tell("ball", remove=True)
    assert knowing.scene.names == ()
    assert "obstacle_removed" in knowing.told


def test_a_moved_capsule_keeps_its_length(knowing):
    knowing.tell("bar", shape="capsule", xyz=(0, 0, 0), to=(0, 0, 1), radius=0.1, max_speed=10)
    knowing.go(100)
    knowing.tell("bar", xyz=(1, 0, 0))
    assert knowing.scene.rounds.end.tolist() == [[1, 0, 1]]


def test_an_obstacle_of_the_cell_that_stands_cannot_be_moved_away():
    knowing = Knowing((TABLE,))
    for news in ({"xyz": (5, 5, 5)}, {"remove": True}):
        with pytest.raises(Refused) as caught:
            knowing.tell("table", **news)
        assert caught.value.reason is Why.FIXED_OBSTACLE
    assert knowing.scene.names == ("table",)


def test_what_stands_never_ages(knowing):
    knowing.tell("post", shape="point", xyz=(1, 1, 1))
    knowing.go(1000)
    assert knowing.world.stale == ()
    assert knowing.scene.reach(10.0).tolist() == [0.0]


def test_what_may_move_is_anywhere_within_its_bound_since_it_was_seen():
    knowing = Knowing((CART,))
    knowing.tell("cart", xyz=(1, 0, 0), tick=knowing.tick - 5)
    assert knowing.scene.age.tolist() == pytest.approx([0.05])
    assert knowing.scene.reach(0.1) == pytest.approx(np.array([0.5 * 0.15]))


def test_with_a_bound_on_acceleration_it_is_where_its_velocity_takes_it(knowing):
    knowing.tell(
        "ball", shape="sphere", xyz=(1, 0, 0), radius=0.1, velocity=(0.4, 0, 0), max_speed=0.5,
        max_acceleration=2.0, tick=knowing.tick - 10,
    )  # fmt: skip
    scene = knowing.scene
    assert scene.rounds.start[0] == pytest.approx([1.04, 0, 0])
    assert scene.velocity[0] == pytest.approx([0.4, 0, 0])
    assert scene.reach(0.1) == pytest.approx(np.array([0.5 * 2.0 * 0.2**2]))
    assert scene.reach(10.0) == pytest.approx(np.array([0.9 * 10.1]))


@pytest.mark.parametrize("start_speed", [0.0, 0.3, 0.5])
def test_no_motion_inside_the_bounds_escapes_the_reach(knowing, rng, start_speed):
    bound, most = 0.5, 2.0
    v = start_speed * np.array([1.0, 0.0, 0.0])
    knowing.tell(
        "ball", shape="point", xyz=(0, 0, 0), velocity=tuple(v), max_speed=bound,
        max_acceleration=most,
    )  # fmt: skip
    scene, p, h = knowing.scene, np.zeros(3), 0.01
    for i in range(1, 200):
        push = rng.normal(size=3)
        after = v + most * h * push / np.linalg.norm(push)
        after *= min(1.0, bound / np.linalg.norm(after))
        p, v = p + 0.5 * h * (v + after), after
        predicted = scene.rounds.start[0] + scene.velocity[0] * i * h
        assert np.linalg.norm(p - predicted) <= scene.reach(i * h)[0] + 1e-12


@pytest.mark.parametrize(("policy", "reach"), [("keep", 0.1), ("grow", 0.5), ("stop", 0.5)])
def test_what_holds_when_news_is_stale(policy, reach):
    knowing = Knowing((CART.model_copy(update={"stale": policy}),))
    knowing.tell("cart", xyz=(1, 0, 0))
    knowing.go(100)
    assert knowing.world.stale == ("cart",)
    assert knowing.scene.reach(0.0)[0] == pytest.approx(reach)
    assert knowing.scene.stop == ("cart" if policy == "stop" else None)
    assert knowing.told.count("obstacle_stale") == 1
    knowing.tell("cart", xyz=(1.2, 0, 0))
    knowing.go(1)
    assert knowing.told == ["obstacle_fresh"]
    assert knowing.scene.stop is None


def test_a_jump_beyond_its_own_bound_is_told(knowing):
    knowing.tell("ball", shape="sphere", xyz=(1, 0, 0), radius=0.1, max_speed=0.5)
    knowing.go(10)
    knowing.tell("ball", xyz=(1.05, 0, 0))
    assert "obstacle_jumped" not in knowing.told
    knowing.go(10)
    knowing.tell("ball", xyz=(0.5, 0, 0))
    assert "obstacle_jumped" in knowing.told


@pytest.mark.parametrize(
    ("news", "why"),
    [
        ({"xyz": (1, 0, 0)}, Why.UNKNOWN_OBSTACLE),
        ({"remove": True}, Why.UNKNOWN_OBSTACLE),
        ({"shape": "point", "xyz": (1, 0, 0), "tick": 1001}, Why.FUTURE_PICTURE),
    ],
)
def test_news_that_does_not_fit_is_refused_by_name(knowing, news, why):
    with pytest.raises(Refused) as caught:
        knowing.tell("ghost", **news)
    assert caught.value.reason is why


def test_old_news_does_not_bring_back_what_was_removed(knowing):
    knowing.tell("ball", shape="point", xyz=(1, 0, 0))
    knowing.tell("ball", remove=True)
    with pytest.raises(Refused) as caught:
        knowing.tell("ball", shape="point", xyz=(1, 0, 0), tick=knowing.tick - 1)
    assert caught.value.reason is Why.OUT_OF_ORDER


CLAIMS = (
    {"remove": True},
    {"xyz": (5, 5, 5)},
    {"shape": "point", "xyz": (5, 5, 5)},
    {"shape": "point", "xyz": (5, 5, 5), "tick": 2000},
)
"""News by which another sender would have an obstacle gone."""


@pytest.mark.parametrize("claim", CLAIMS)
@pytest.mark.parametrize("thief", ["", "thief"])
def test_only_its_own_sender_moves_replaces_or_removes_an_obstacle(knowing, claim, thief):
    knowing.tell("ball", "lidar", shape="sphere", xyz=(1, 0, 0), radius=0.1, stale="stop")
    knowing.go(1)
    assert knowing.refused("ball", thief, **claim) is Why.ANOTHERS_OBSTACLE
    assert knowing.scene.rounds.start.tolist() == [[1, 0, 0]]
    knowing.tell("ball", "lidar", remove=True)
    knowing.tell("ball", "radar", shape="point", xyz=(2, 0, 0))


@pytest.mark.parametrize("speed", [0.0, 10.0])
def test_an_obstacle_that_another_says_is_gone_is_stale_until_its_sender_tells_again(
    knowing, speed
):
    ball = {"shape": "sphere", "xyz": (1, 0, 0), "radius": 0.1, "max_speed": speed}
    knowing.tell("ball", "lidar", **ball)
    knowing.go(1)
    assert knowing.scene.stop is None
    knowing.refused("ball", "thief", remove=True)
    knowing.tell("ball", "lidar", **ball)  # seen before: the next one counts
    knowing.go(1)
    assert knowing.scene.stop == knowing.world.stop == "ball"
    (stale,) = [e for e in knowing.events.take() if e.name == "obstacle_stale"]
    assert stale.detail == "ball: removed by thief too: stop"
    knowing.tell("ball", "lidar", **ball)
    knowing.go(1)
    assert knowing.scene.stop is None
    assert knowing.told == ["obstacle_fresh"]


def test_refused_news_of_its_own_sender_makes_an_obstacle_stale_but_for_late_ones(knowing):
    knowing.tell("post", "lidar", shape="point", xyz=(1, 0, 0))
    assert knowing.refused("post", "lidar", xyz=(2, 0, 0), tick=900) is Why.OUT_OF_ORDER
    knowing.go(1)
    assert knowing.world.stale == ()
    assert knowing.refused("post", "lidar", xyz=(2, 0, 0), tick=5000) is Why.FUTURE_PICTURE
    knowing.go(1)
    assert knowing.world.stale == ("post",)


def test_an_obstacle_of_the_cell_that_moves_belongs_to_who_tells_of_it_first():
    knowing = Knowing((CART,))
    knowing.tell("cart", "lidar", xyz=(1, 0, 0))
    assert knowing.refused("cart", "thief", xyz=(5, 0, 0)) is Why.ANOTHERS_OBSTACLE


def test_where_senders_are_certified_nobody_tells_without_a_name():
    knowing = Knowing(certified=True)
    point = {"shape": "point", "xyz": (1, 0, 0)}
    assert knowing.refused("ball", **point) is Why.UNNAMED_SENDER
    knowing.tell("ball", "lidar", **point)
    assert knowing.refused("ball", remove=True) is Why.UNNAMED_SENDER
    knowing.go(1)
    assert knowing.world.stale == ("ball",)


def test_there_is_an_end_to_obstacles(knowing):
    for i in range(MOST):
        knowing.tell(f"ball{i}", shape="point", xyz=(1, 0, 0))
    with pytest.raises(Refused) as caught:
        knowing.tell("one_more", shape="point", xyz=(1, 0, 0))
    assert caught.value.reason is Why.TOO_MANY_OBSTACLES


def test_rounds_come_first_whatever_the_order_of_news():
    knowing = Knowing((TABLE, CART))
    knowing.tell("post", shape="point", xyz=(1, 1, 1))
    assert knowing.scene.names == ("cart", "post", "table")
    assert knowing.scene.boxes.centre.tolist() == [[0.5, 0, 0.1]]


def test_news_crosses_the_wire_and_half_an_obstacle_does_not():
    news = ObstacleNews(name="bar", tick=7, shape="capsule", xyz=(0, 0, 0), to=(0, 0, 1), radius=1)
    assert decode_as(ObstacleNews, encode(news)) == news
    halved = encode(news.model_copy(update={"to": None}))
    with pytest.raises(CodecError, match="capsule needs to"):
        decode_as(ObstacleNews, halved)


BALL = {"shape": "sphere", "xyz": (1, 0, 0), "radius": 0.1, "max_speed": 0.5, "stale": "keep"}


@pytest.mark.parametrize("shape", ["point", "sphere"])
def test_a_round_one_that_is_moved_leaves_nothing_where_it_was(knowing, shape):
    radius = {} if shape == "point" else {"radius": 0.1}
    knowing.tell("ball", shape=shape, xyz=(1, 2, 3), max_speed=10.0, **radius)
    knowing.go(100)
    knowing.tell("ball", xyz=(1, 2, 4))
    rounds = knowing.scene.rounds
    np.testing.assert_array_equal(rounds.start, [[1, 2, 4]])
    np.testing.assert_array_equal(rounds.end, rounds.start)


def watched(knowing, velocity, told, seconds=1.5, noise=lambda: 0.0):
    """Return the velocity along x that the scene shows in each tick (k,), 20 news a second."""
    knowing.tell("ball", **BALL, velocity=(velocity, 0, 0))
    found = []
    for i in range(round(seconds / 0.01)):
        knowing.go(1)
        if knowing.tick % 5 == 0:
            more = {"velocity": (velocity + noise(), 0, 0)} if told else {}
            x = 1 + velocity * 0.01 * (i + 1) + (0.0 if told else noise())
            knowing.tell("ball", xyz=(x, 0, 0), **more)
        found.append(knowing.scene.observed[0, 0])
    return np.array(found)


@pytest.mark.parametrize("told", [True, False])
def test_the_velocity_that_news_shows_fades_in_and_is_told_or_seen(knowing, told):
    found = watched(knowing, 0.2, told, 3.0)
    assert found[-1] == pytest.approx(0.2, rel=0.03)
    assert np.abs(np.diff(found)).max() < 0.05
    assert found[9] < 0.1


def test_it_fades_out_when_the_news_is_stale_or_says_that_it_stands(knowing):
    watched(knowing, 0.2, told=True)
    knowing.go(20)
    assert knowing.scene.observed[0, 0] > 0.15
    knowing.go(30)
    assert not knowing.scene.comes
    watched(knowing, 0.2, told=True)
    knowing.go(1)
    knowing.tell("ball", xyz=(1, 0, 0), velocity=(0, 0, 0))
    assert knowing.scene.observed[0, 0] > 0.05
    knowing.go(21)
    assert not knowing.scene.comes


@pytest.mark.parametrize(("told", "size"), [(True, 0.02), (False, 0.002)])
def test_noise_is_no_motion(knowing, rng, told, size):
    found = watched(knowing, 0.0, told, 10.0, lambda: float(rng.normal(0.0, size)))
    assert not found.any()


def test_what_jumps_is_seen_no_faster_than_it_may_be(knowing):
    knowing.tell("ball", **BALL)
    for x in (1.5, 2.0, 2.5, 3.0):
        knowing.go(5)
        knowing.tell("ball", xyz=(x, 0, 0))
    knowing.go(4)
    assert 0.0 < knowing.scene.observed[0, 0] <= 0.5


def test_an_obstacle_of_the_cell_that_stands_is_never_seen_to_come():
    knowing = Knowing((TABLE,))
    assert not knowing.scene.comes


WHOLE = {
    "point": {"xyz": (1.0, 0.0, 0.0)},
    "sphere": {"xyz": (1.0, 0.0, 0.0), "radius": 0.1},
    "capsule": {"xyz": (1.0, 0.0, 0.0), "to": (1.0, 0.5, 0.0), "radius": 0.1},
    "box": {"xyz": (1.0, 0.0, 0.0), "half_size": (0.1, 0.2, 0.3), "rpy": (0.0, 0.0, 1.0)},
    "sight_line": {"xyz": (1.0, 0.0, 0.0), "to": (1.0, 0.5, 0.0)},
}


@pytest.mark.parametrize("shape", WHOLE)
def test_listeners_are_told_each_obstacle_as_a_whole_as_it_is_held(shape):
    known = Knowing()
    known.tell("crate", by="lidar", shape=shape, max_speed=0.5, **WHOLE[shape])
    known.tell("crate", by="lidar", xyz=(2.0, 0.0, 0.0))
    (told,) = known.world.told(known.tick)
    told = decode_as(ObstacleNews, encode(told), 4096)
    assert (told.shape, told.xyz, told.max_speed) == (shape, (2.0, 0.0, 0.0), 0.5)
    for key in WHOLE[shape].keys() - {"xyz", "to"}:
        assert getattr(told, key) == WHOLE[shape][key]


def test_listeners_are_told_nothing_that_was_refused():
    known = Knowing()
    known.tell("crate", by="lidar", shape="point", xyz=(1.0, 0.0, 0.0), max_speed=0.5)
    list(known.world.told(known.tick))
    assert known.refused("crate", by="thief", xyz=(5.0, 0.0, 0.0)) is Why.ANOTHERS_OBSTACLE
    assert known.refused("crate", by="thief", remove=True) is Why.ANOTHERS_OBSTACLE
    assert known.refused("other", xyz=(5.0, 0.0, 0.0)) is Why.UNKNOWN_OBSTACLE
    assert {news.xyz for news in known.world.told(known.tick)} == {(1.0, 0.0, 0.0)}


def test_who_listens_later_is_told_of_all_in_turn_and_of_what_was_removed():
    known = Knowing((TABLE, CART))
    assert list(known.world.told(known.tick)) == []  # as in the cell file
    for i in range(5):
        known.tell(f"crate_{i}", shape="point", xyz=(float(i), 0.0, 0.0))
    known.tell("cart", remove=True)
    known.tell("crate_0", remove=True)
    assert len({news.name for news in known.world.told(known.tick)}) == 6
    later = {}
    for _ in range(6):
        known.go(1)
        (news,) = known.world.told(known.tick)
        later[news.name] = news.remove
    assert later == {f"crate_{i}": i == 0 for i in range(5)} | {"cart": True}


def test_the_line_of_a_carried_camera_is_told_by_where_it_ends():
    cell = load_cell("pa10_scene")
    known = Knowing()
    known.world = ObstacleMap.from_cell(cell, known.events)
    carried = [o.name for o in known.world.known if o.carrier >= 0]
    for name in carried:
        known.tell(name, to=(1.0, 2.0, 0.5))
        (told,) = known.world.told(known.tick)
        assert (told.shape, told.xyz, told.to) == (None, None, (1.0, 2.0, 0.5))


def test_what_only_news_changes_is_packed_once_until_there_is_some():
    knowing = Knowing((CART, TABLE))
    knowing.tell("cart", xyz=(1.0, 0.0, 0.0), velocity=(0.3, 0.0, 0.0))
    before = knowing.scene
    knowing.go(10)
    later = knowing.scene
    assert later is not before
    assert later.age[0] == pytest.approx(0.1)
    assert later.clearance is before.clearance
    knowing.tell("cart", clearance=0.07)
    assert knowing.scene.clearance[0] == 0.07
