"""What clearances are at one posture: bounds of the ways of links, and a Base that moves."""

import numpy as np
import pytest
from telerobot.config.load import altered
from telerobot.config.schema.surroundings import AvoidanceSection, ObstacleSection
from telerobot.server.control.barriers.clearance import (
    BESIDE,
    BETWEEN,
    CREEP,
    HORIZON_S,
    ROUNDEST,
    SLACK,
    Clearance,
    standing,
    wanted,
)
from telerobot.server.control.compiled import evolve
from telerobot.server.control.proximity.capsules import Capsules, doubtful, travel
from telerobot.server.control.proximity.pairs import Shown
from telerobot.server.control.scene import Body
from telerobot.server.control.spatial import Pose, rotation_exp
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap

THINGS = (
    ObstacleSection(name="table", shape="box", xyz=(0.6, 0, 0.1), half_size=(0.3, 0.6, 0.1)),
    ObstacleSection(name="ball", shape="sphere", xyz=(0.4, -0.4, 0.7), radius=0.1),
    ObstacleSection(
        name="pole", shape="capsule", xyz=(0.5, 0.35, 0), to=(0.5, 0.35, 1), radius=0.05
    ),
)


@pytest.fixture
def clear(pa10):
    """Return the clearances of an arm among things, and the scene."""
    given = AvoidanceSection(enabled=True)
    cell = altered(pa10.cell, {"obstacles": THINGS, "avoidance": given})
    clearance = Clearance(cell, pa10.p.joints.acceleration, pa10.p.joints.jerk, Capsules(cell))
    return clearance, ObstacleMap.from_cell(cell, Events()).scene(0)


def test_the_way_of_a_link_is_that_of_a_lever_which_grows_with_it(rng):
    lever, way = rng.uniform(0.0, 1.0, (5, 4)), rng.uniform(0.0, 0.6, 4)
    steps = 20000
    gone = np.zeros(5)
    for _ in range(steps):
        middle = gone + 0.5 / steps * (lever + gone[:, None]) @ way
        gone = gone + (lever + middle[:, None]) @ way / steps
    assert travel(lever, way) == pytest.approx(gone, rel=1e-7)
    assert travel(lever, np.zeros(4)) == pytest.approx(np.zeros(5))


def test_no_end_of_a_link_goes_further_than_its_way(pa10, clear, rng):
    clearance, _ = clear
    links = clearance.capsules
    for _ in range(50):
        q, turn = pa10.random_posture(rng), rng.uniform(-0.5, 0.5, 7)
        placed = links.place(q[None])
        way = travel(links.levers(placed), np.abs(turn))
        moved = links.place((q + turn)[None]).ends[0] - placed.ends[0]
        assert (np.linalg.norm(moved, axis=-1).max(axis=1) <= way + 1e-12).all()


def test_a_base_that_moves_closes_gaps_to_obstacles_as_fast_as_it_is_told(pa10, clear, rng):
    clearance, scene = clear
    q, none, far = pa10.posture("ready"), np.zeros(7), np.full(7, 1.0)
    twist = np.array([0.2, 0.1, -0.1, 0.1, 0.3, 0.2])
    base, h = Body(Pose(np.eye(3), np.array([0.01, 0.02, 0.0])), twist), 1e-6
    later = Body(Pose(rotation_exp(h * twist[3:]), base.T.p + h * twist[:3]), twist)
    seen, next_ = (clearance.look(q, far, none, scene, 1.0, {}, (b,)).near for b in (base, later))
    assert next_.second.tolist() == seen.second.tolist()
    others = seen.obstacle >= 0
    assert others.sum() > 5
    assert (~others).any()
    closing = (seen.gap - next_.gap) / h
    assert seen.speed[others] == pytest.approx(np.maximum(closing[others], 0.0), abs=1e-5)
    assert (seen.speed[~others] == 0.0).all()
    assert (seen.carried[~others] == 0.0).all()
    places = seen.near.place[others] - base.T.p
    carried = twist[:3] + np.cross(twist[3:], places)
    assert seen.carried[others] == pytest.approx(np.linalg.norm(carried, axis=1))


def test_pairs_that_may_come_below_a_bound_are_doubtful(rng):
    capsules, k = 6, 40
    lever, way = rng.uniform(0.0, 0.5, (capsules, 4)), rng.uniform(0.0, 0.2, 4)
    gap, most, gone = rng.uniform(0, 0.5, k), rng.uniform(0, 0.1, k), travel(lever, way)
    first, second = rng.integers(0, capsules, k), rng.integers(0, capsules + 5, k)
    both = np.r_[gone, np.zeros(5)]
    closer = both[first] + both[second]
    expected = np.flatnonzero(gap - closer < most)
    for room, leaves in ((gone + 1e-9, False), (np.r_[gone[:-1], 0.0], True)):
        left, pairs, told = doubtful(lever, way, room, (first, second), gap, most)
        assert left == leaves
        assert 0 < len(expected) < k
        np.testing.assert_array_equal(pairs, expected)
        np.testing.assert_array_equal(told, closer[expected])


def test_what_gaps_must_keep_follows_from_what_tracking_takes_off_them(pa10, clear, rng):
    clearance, scene = clear
    moving = evolve(scene, speed=np.array([0.1, 0.0, 0.2]), still_after=np.full(3, np.inf))
    margin, wait_s = pa10.cell.config.avoidance.margin, 0.03
    held = 0
    for _ in range(20):
        q, error = pa10.random_posture(rng), rng.uniform(-0.05, 0.05, 7)
        speed, twist = rng.uniform(0.0, 1.0, 7), rng.uniform(-0.2, 0.2, 6)
        for around, bases in ((scene, ()), (moving, ()), (moving, (Body(Pose.identity(), twist),))):
            sight = clearance.look(q, speed, error, around, 0.5, {}, bases)
            near = sight.near
            tube = np.abs(near.rows) @ np.abs(error)
            needed = near.promise + tube + BETWEEN * margin
            comes = np.where(near.obstacle >= 0, around.speed[near.obstacle], 0.0) * wait_s
            stands = (comes > 0.0) & (near.speed == 0.0) if not bases else comes < 0.0
            room = near.gap - near.promise - margin - tube - near.carried * wait_s
            room -= np.where(stands, 0.0, comes)
            assert sight.tube == pytest.approx(tube, abs=1e-12)
            assert sight.needed == pytest.approx(needed, abs=1e-12)
            assert sight.room == pytest.approx(room, abs=1e-12)
            below = near.gap < needed + comes * HORIZON_S / wait_s + near.carried * HORIZON_S
            np.testing.assert_array_equal(np.isfinite(sight.floor), below | stands)
            assert len(sight.levels) == below.sum()
            held += below.sum()
            # The way of capsules is that of joints which brake.
            braking = clearance.braking
            way = speed * (braking.lag(0.5) + 0.5 * speed / (0.5 * braking.acceleration))
            assert sight.around == pytest.approx(travel(sight.lever, way) + BESIDE + margin)
    assert held > 0


def test_an_arm_that_stands_keeps_what_it_can_however_old_news_is(pa10, clear):
    """What may have come near since it was told of is no reason to refuse every motion."""
    clearance, scene = clear
    age = np.full(3, 0.6)
    grown = evolve(scene, speed=np.array([0.25, 0.0, 0.25]), age=age, still_after=np.full(3, 9.0))
    q, none = pa10.posture("ready"), np.zeros(7)
    sight = clearance.look(q, np.full(7, 1.0), none, grown, 1.0, {})
    late = sight.near.gap - sight.needed - HORIZON_S * sight.near.speed
    assert ((late > 0.0) & (sight.room < 0.0)).any()
    assert clearance.violation(sight, 0.1, none, lambda t: np.tile(q, (len(t), 1))) == 0.0


def test_what_stands_counts_as_standing_only_while_a_promise_is_broken(pa10, clear):
    clearance, scene = clear
    moving = evolve(scene, speed=np.full(3, 0.3), still_after=np.full(3, np.inf))
    q, none, far = pa10.posture("ready"), np.zeros(7), np.full(7, 3.0)
    near = clearance.look(q, far, none, moving, 1.0, {}).near
    others = near.obstacle >= 0
    k, j, i = np.flatnonzero(others)[:3]
    rows = np.zeros_like(near.rows)
    rows[:, :3] = 1.0
    seen = near._replace(gap=near.promise + 0.05, rows=rows, approach=np.zeros(near.size))
    assert not standing(seen, moving).any()
    # One that is nearer than promised: all others of the same joints stand.
    expected, broken = others.copy(), seen.gap.copy()
    expected[k], broken[k] = False, near.promise[k] - 1e-6
    seen = seen._replace(gap=broken)
    np.testing.assert_array_equal(standing(seen, moving), expected)
    # None does while anything comes.
    seen.approach[i] = 0.02
    assert not standing(seen, moving).any()
    seen.approach[i] = 0.0
    # Nor what other joints move, nor what news is old of.
    rows[j], expected[j] = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0], False
    np.testing.assert_array_equal(standing(seen, moving), expected)
    aged = evolve(moving, age=np.where(np.arange(3) == near.obstacle[i], 0.0, 0.21))
    expected &= near.obstacle == near.obstacle[i]
    np.testing.assert_array_equal(standing(seen, aged), expected)
    # A promise to what never moves, and one between links, are no reason.
    broken[others] = near.promise[others] + 0.05
    broken[~others] = near.promise[~others] - 0.01
    assert not standing(seen, moving).any()


def test_what_stands_is_approached_to_what_its_gap_needs(pa10, clear):
    """The ball is nearer than promised: nothing is kept for where the pole might go to."""
    clearance, scene = clear
    assert scene.names[:2] == ("ball", "pole")
    moving = evolve(scene, speed=np.array([0.3, 0.3, 0.0]), still_after=np.full(3, np.inf))

    def seen(wider):
        around = evolve(moving, clearance=scene.clearance + np.array([wider, 0.0, 0.0]))
        sight = clearance.look(pa10.posture("ready"), np.full(7, 3.0), np.zeros(7), around, 1.0, {})
        moved = sight.near.rows.any(axis=1)
        return sight, *(moved & (sight.near.obstacle == thing) for thing in (0, 1))

    kept, ball, pole = seen(0.0)
    assert (kept.near.speed[ball | pole] == 0.3).all()
    sight, ball, stands = seen(float(kept.near.gap[ball].min()))
    assert (sight.near.speed[ball] == 0.3).any()
    assert (sight.near.speed[stands] == 0.0).all()
    assert sight.room[stands] == pytest.approx(kept.room[pole] + 0.3 * 0.03)
    assert (sight.near.gap[stands] > sight.needed[stands]).all()
    assert sight.floor[stands] == pytest.approx(sight.needed[stands])


@pytest.mark.parametrize("looks", [1, 4])
def test_a_stop_keeps_what_pairs_need_and_dip_by_but_no_more_than_their_floors(rng, looks):
    k, pairs = 12, np.array([0, 3, 4, 9])
    needed, promise, radii = rng.uniform(0.0, 0.1, (3, k))
    radii[3] = promise[3] = 0.0
    floor = np.where(np.arange(k) == 4, 0.01, np.inf)
    closer, nearer = rng.uniform(0.0, 0.2, 4), rng.uniform(0.0, 0.1, (looks + 1, k))
    curved = np.maximum(radii + promise, ROUNDEST)[pairs]
    bound = needed[pairs] + (closer / looks) ** 2 / (8.0 * curved)
    for comes, more in ((np.zeros((0, 0)), 0.0), (nearer, nearer[:, pairs])):
        found = wanted(looks, pairs, closer, needed, promise, radii, floor, comes)
        expected = np.minimum(bound + np.zeros((looks + 1, 1)) + more, floor[pairs]) + radii[pairs]
        assert found == pytest.approx(expected, abs=1e-12)


def test_the_nearest_pairs_are_told_nearest_first(pa10, clear, rng):
    clearance, scene = clear
    none, fast = np.zeros(7), np.full(7, 2.0)
    for _ in range(20):
        sight = clearance.look(pa10.random_posture(rng), fast, none, scene, 1.0, {})
        # Of equal ones, the first is told first.
        gap = np.round(sight.near.gap, 1)
        sight = sight._replace(near=sight.near._replace(gap=gap))
        active = rng.uniform(size=len(gap)) < 0.4
        order = np.argsort(gap, kind="stable")
        for only, which in ((False, order[:4]), (True, order[active[order]][:4])):
            found = Shown(sight.near, scene, clearance.capsules.links, active).gaps(
                only_active=only
            )
            assert [g.gap for g in found] == gap[which].tolist()
            assert [g.active for g in found] == active[which].tolist()
            names = [clearance.capsules.links[i] for i in sight.near.first[which]]
            assert [g.link for g in found] == names


def floors(clearance, near, scene, gap, speed, levels):
    """Return the floor of one pair that may move at 0.3 m/s, inside its bound, and levels."""
    k = int(np.flatnonzero(near.obstacle >= 0)[0])
    gaps, speeds = near.gap.copy(), np.zeros(near.size)
    gaps[k], speeds[k] = gap, speed
    seen, floor = near._replace(gap=gaps, speed=speeds), np.full(near.size, np.inf)
    bounded = evolve(scene, speed=np.full(len(scene.speed), 0.3))
    levels = clearance._floors(seen, floor, np.array([k]), bounded, levels)
    return float(floor[k]), levels


def test_what_may_move_and_stands_is_left_like_what_never_moves(pa10, clear):
    clearance, scene = clear
    none, far = np.zeros(7), np.full(7, 3.0)
    near = clearance.look(pa10.posture("ready"), far, none, scene, 1.0, {}, None).near
    # Standing, it takes no more than once what it takes in a period while it comes nearer.
    first, levels = floors(clearance, near, scene, 0.010, 0.3, {})
    assert first == pytest.approx(0.010 - CREEP)
    lower, levels = floors(clearance, near, scene, first, 0.3, levels)
    assert lower == pytest.approx(first)
    # Widened, the gap may give back what any other may.
    wide, levels = floors(clearance, near, scene, 0.012, 0.3, levels)
    assert wide == pytest.approx(0.012 - SLACK)
    # Coming nearer, it keeps what it is now.
    coming, _ = floors(clearance, near, scene, 0.012, 0.4, levels)
    assert coming == pytest.approx(0.012 - CREEP)
