"""Postures that pass below a bridge, and the reflex that leads there and back."""

import math
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from laboratory.papers.lwa3 import PLANE, START, bridge, search
from telerobot.server.control.spatial import Array, Pose
from telerobot.server.perception.scanning.contour import Contour, Obstacles, clearance
from telerobot.server.perception.scanning.reflex import (
    ARCS,
    AT_ONCE,
    DECELERATION,
    REACTS_S,
    PassagePhase,
    PassageReflex,
    Search,
    Steering,
    speed_within,
)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Search:
    return search(tmp_path_factory.mktemp("lwa3"))


@pytest.mark.parametrize("height", [0.45, 0.5, 0.6])
@pytest.mark.parametrize("width", [1.4, 0.9])
def test_the_posture_that_is_found_passes_and_so_does_the_way_there(
    found: Search, height: float, width: float
) -> None:
    obstacles = bridge(height, 1.5, width)
    assert clearance(found.points.of(START[None])[0], obstacles) < found.reach.trigger
    answer = found.posture(START, obstacles)
    assert answer.q is not None
    assert clearance(found.points.of(answer.q[None])[0], obstacles) >= found.reach.choose - 0.005
    assert (answer.q >= found.points.lower).all()
    assert (answer.q <= found.points.upper).all()
    assert found.way_is_free(START, answer.q, obstacles, found.reach.trigger)


def test_an_arm_passes_where_its_column_does(found: Search) -> None:
    """The shoulder stands still: nothing is gained by asking for more room there than below."""
    obstacles = bridge(0.40, 1.5)
    answer = found.posture(START, obstacles)
    assert answer.q is not None
    elbow, *_, tool = found.points.of(answer.q[None])[0][1:]
    assert max(elbow[2], tool[2]) <= 0.40 - found.reach.choose + 0.005


@pytest.mark.parametrize(
    ("obstacles", "reason"),
    [
        (bridge(0.35, 1.5), "column_blocked"),
        (bridge(0.40, 1.5, 0.2), "no_posture"),
        (bridge(0.6, 1.5, 0.1), "column_blocked"),
        (bridge(0.5, 0.15), "no_way"),
    ],
)
def test_what_cannot_be_passed_is_refused_by_name(
    found: Search, obstacles: Obstacles, reason: str
) -> None:
    answer = found.posture(START, obstacles)
    assert (answer.q, answer.reason) == (None, reason)


def test_the_papers_order_moves_the_tool_before_the_elbow(found: Search) -> None:
    q, obstacles, heights = START, bridge(0.6, 1.5), []
    for _ in range(4):
        answer = found.sequence(q, obstacles)
        if answer.q is None or answer.q is q:
            break
        q = answer.q
        points = found.points.of(q[None])[0]
        heights.append((points[1, 2], points[-1, 2]))
    start = found.points.of(START[None])[0]
    assert heights[0][1] < 0.6 < start[-1, 2]


def apart(points: Array, obstacles: Obstacles, begin: float = 0.06) -> float:
    """Distance of links from cells by points 1 mm apart, from where the upper arm can move on."""
    found = []
    for a, b in pairwise(points):
        length = float(np.linalg.norm(b - a))
        at = (a + np.arange(begin / length, 1.0, 1e-3 / length)[:, None] * (b - a))[:, None, 1:]
        off = np.maximum(np.maximum(obstacles.low - at, at - obstacles.high), 0.0)
        found.append(float(np.linalg.norm(off, axis=2).min()))
        begin = 0.0
    return min(found)


@pytest.mark.parametrize(
    ("height", "width", "y"),
    [
        (0.45, 1.0, 0.0),
        (0.65, 0.9, 0.0),
        (0.47, 1.42, 0.08),
        (0.82, 0.79, 0.14),
        (0.65, 1.68, 0.01),
        (0.6, 1.4, 0.0),
    ],
)
def test_the_papers_order_moves_the_tool_then_the_elbow_on_its_circle_and_is_through(
    found: Search, height: float, width: float, y: float
) -> None:
    """Where F2 took any posture of a grid, F1 and F2, or F3 and itself, undid each other."""
    obstacles = bridge(height, 1.5, width, y)
    first = found.sequence(START, obstacles).q
    assert first is not None
    at = found.points.of(first[None])[0]
    second = found.sequence(first, obstacles).q
    assert second is not None
    after = found.points.of(second[None])[0]
    np.testing.assert_allclose(after[-1], at[-1], atol=1e-3)  # the tool stands
    np.testing.assert_array_equal(first[found.points.lead :], second[found.points.lead :])
    # On a circle about the line from shoulder to tool nothing comes nearer to its ends.
    for end in (at[0], at[-1]):
        assert np.linalg.norm(after[1] - end) == pytest.approx(
            np.linalg.norm(at[1] - end), abs=2e-3
        )
    assert found.sequence(second, obstacles).q is second
    assert apart(after, obstacles) >= found.reach.trigger - 1e-3


def test_the_papers_order_is_through_below_random_bridges_or_refuses_by_name(found: Search) -> None:
    draw, reasons = np.random.default_rng(3), []
    while len(reasons) < 40:
        height, width = draw.uniform(0.38, 0.9), draw.uniform(0.6, 1.7)
        obstacles = bridge(height, 1.5, width, draw.uniform(-0.15, 0.15))
        if found.blocked(obstacles):
            continue
        q, answer = START, found.sequence(START, obstacles)
        for _ in range(3):
            if answer.q is None or answer.q is q:
                break
            q = answer.q
            answer = found.sequence(q, obstacles)
        reasons.append(answer.reason)
        if answer.q is not None:
            assert answer.q is q, "it goes round in circles"
            assert apart(found.points.of(q[None])[0], obstacles) >= found.reach.trigger - 1e-3
    assert reasons.count("") >= 38
    assert set(reasons) <= {"", "sequence_f2"}


@pytest.mark.parametrize(
    "q",
    [(-0.2, 0.98, -2.06, 1.64), (0.58, 0.78, -2.49, 1.54), (-1.58, 0.75, 0.32, -1.91)],
)
def test_the_papers_order_brings_the_tool_onto_the_line_only_where_that_is_free(
    found: Search, q: tuple[float, ...]
) -> None:
    """F3 alone: a post hangs down between elbow and tool; 27 and 51 mm were left of it."""
    post = Obstacles(np.array([[-0.03, 0.58]]), np.array([[0.03, 1.0]]), np.array([1.5]))
    start = np.array([*q, 0.0, 0.0, 0.0])
    now = found.points.of(start[None])[0]
    least = [apart(now[[0, k]], post) for k in (-1, 1)] + [apart(now[1:], post, 0.0)]
    assert [d > found.reach.trigger for d in least] == [True, True, False]
    answer = found.sequence(start, post)
    assert answer.q is not None
    after = found.points.of(answer.q[None])[0]
    assert apart(after, post) >= found.reach.trigger
    assert np.linalg.norm(after[1] - now[1]) < 0.06  # the elbow stands
    along, off = (now[1] - now[0])[1:], (after[-1] - now[0])[1:]
    assert abs(along[0] * off[1] - along[1] * off[0]) < 0.06 * np.linalg.norm(along)


class Drive:
    """A base that drives as it may, an arm that folds as it should, in steps of 0.1 s."""

    def __init__(
        self,
        found: Search,
        height: float,
        speed: float,
        ahead: float = 2.5,
        width: float = 1.4,
        *,
        in_sequence: bool = False,
    ) -> None:
        self.reflex = PassageReflex(found, 4.0, in_sequence=in_sequence, silent_s=0.2)
        self.height, self.speed, self.ahead, self.width = height, speed, ahead, width
        self.q, self.time_s, self.points = START, 0.0, found.points
        self.phases: list[PassagePhase] = []
        self.least = math.inf
        self.reason = ""

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            obstacles = bridge(self.height, self.ahead, self.width).within(-3.0, 3.0)
            answer = self.reflex.step(self.time_s, self.q, obstacles)
            if not self.phases or self.phases[-1] is not answer.phase:
                self.phases.append(answer.phase)
            self.reason = answer.reason
            self.ahead -= 0.1 * min(self.speed, answer.most_speed)
            self.time_s += 0.1
            if answer.posture is not None:
                way = answer.posture - self.q
                self.q = self.q + way * min(1.0, 0.05 / max(np.abs(way).max(), 1e-9))
            points = self.points.of(self.q[None])[0]
            if self.ahead < points[:, 0].max() and self.ahead + 0.1 > points[:, 0].min():
                self.least = min(self.least, clearance(points, obstacles))


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.3])
def test_the_arm_folds_passes_and_unfolds(found: Search, speed: float) -> None:
    drive = Drive(found, 0.45, speed)
    drive.run(80 if speed < 0.1 else 50)
    assert drive.phases == [
        PassagePhase.CLEAR,
        PassagePhase.UNDECIDED,
        PassagePhase.FOLDING,
        PassagePhase.FOLDED,
        PassagePhase.RETURNING,
        PassagePhase.CLEAR,
    ]
    assert drive.least > 0.07
    np.testing.assert_allclose(drive.q, START, atol=0.03)


def test_the_papers_order_passes_where_the_tool_alone_has_to_move(found: Search) -> None:
    drive = Drive(found, 0.55, 0.3, in_sequence=True)
    drive.run(40)
    assert drive.phases[-3:] == [PassagePhase.FOLDED, PassagePhase.RETURNING, PassagePhase.CLEAR]
    assert drive.ahead < -0.5
    assert drive.least > 0.07


def test_the_papers_order_passes_where_a_grid_went_round_in_circles(found: Search) -> None:
    drive = Drive(found, 0.65, 0.3, width=0.9, in_sequence=True)
    drive.run(40)
    assert drive.phases[-3:] == [PassagePhase.FOLDED, PassagePhase.RETURNING, PassagePhase.CLEAR]
    assert drive.ahead < -0.5
    assert drive.least > 0.07


def test_the_papers_order_that_comes_back_to_a_posture_is_refused_and_stands(found: Search) -> None:
    """A bridge that goes to and fro: without a memory the arm folds after it for ever."""
    reflex, q = PassageReflex(found, 0.0, in_sequence=True, silent_s=0.2), START
    goals: list[Array] = []
    for k in range(60):
        side = 0.3 if len(goals) % 2 else -0.3
        answer = reflex.step(0.1 * k, q, bridge(0.65, 1.5, 0.9, side))
        if answer.posture is not None and answer.posture is not q:
            q = answer.posture
            goals.append(q)
    assert (answer.phase, answer.reason) == (PassagePhase.REFUSED, "sequence_stuck")
    assert answer.posture is None
    assert len(goals) == 3
    for k in range(30):
        answer = reflex.step(6.0 + 0.1 * k, q, bridge(0.65, 1.5, 0.9, 0.3))
    assert (answer.phase, answer.reason) == (PassagePhase.REFUSED, "sequence_stuck")


def test_nothing_is_decided_before_two_sweeps(found: Search) -> None:
    drive = Drive(found, 0.45, 0.1, ahead=2.05)
    drive.run(1.0)
    assert drive.phases == [PassagePhase.CLEAR, PassagePhase.UNDECIDED]
    drive.run(3.4)
    assert drive.phases == [PassagePhase.CLEAR, PassagePhase.UNDECIDED]
    drive.run(0.8)
    assert drive.phases[-1] is PassagePhase.FOLDING


def test_the_base_stands_before_a_bridge_that_is_too_low_and_may_back_out(found: Search) -> None:
    drive = Drive(found, 0.35, 0.3)
    drive.run(30)
    assert drive.phases[-1] is PassagePhase.REFUSED
    assert drive.reason == "column_blocked"
    assert 0.90 < drive.ahead < 1.0  # 0.80 stretched ahead, and 0.15
    drive.speed = -0.3
    drive.run(8)
    assert drive.phases[-1] is PassagePhase.CLEAR
    assert drive.reason == ""


def test_what_turns_out_lower_than_it_seemed_is_not_waited_for_for_ever(found: Search) -> None:
    drive = Drive(found, 0.45, 0.0, ahead=1.5)
    drive.run(20)
    assert drive.phases[-1] is PassagePhase.FOLDED
    drive.height = 0.35  # nearer than the column may pass
    drive.run(5)
    assert drive.phases[-1] is PassagePhase.REFUSED
    assert drive.reason == "column_blocked"


def test_it_stays_folded_while_the_next_bridge_is_in_sight(found: Search) -> None:
    drive = Drive(found, 0.45, 0.0, ahead=1.5)
    drive.run(20)
    assert drive.phases[-1] is PassagePhase.FOLDED
    drive.ahead = 2.5  # backed away, yet it is still ahead
    drive.run(5)
    assert drive.phases[-1] is PassagePhase.FOLDED
    drive.ahead = -1.0
    drive.run(15)
    assert drive.phases[-2:] == [PassagePhase.RETURNING, PassagePhase.CLEAR]


def test_an_arm_that_swings_back_as_it_unfolds_waits_until_it_is_clear_of_the_bridge(
    found: Search,
) -> None:
    folded = np.array([-0.35, -1.05, -1.74, -1.87, 0.0, 0.0, 0.0])
    rear = min(
        found.points.of((folded + t * (START - folded))[None])[0, :, 0].min()
        for t in np.linspace(0, 1, 50)
    )
    assert rear < -0.6  # farther back than folded or at home
    nothing = Obstacles.of(Contour(np.full((20, 40), np.nan), np.full((20, 40), np.nan)), PLANE)
    for behind, phase in ((0.5, PassagePhase.FOLDED), (0.8, PassagePhase.RETURNING)):
        reflex = PassageReflex(found, 0.0, silent_s=0.2)
        seen = bridge(0.6, 1.5)
        reflex.step(0.0, START, seen)
        assert reflex.step(0.1, START, seen).posture is not None
        reflex.goal = folded
        assert reflex.step(3.0, folded, seen).phase is PassagePhase.FOLDED
        passed = bridge(0.6, 1.5)._replace(near=np.full(len(bridge(0.6, 1.5).near), -behind))
        for k in range(30):
            answer = reflex.step(3.1 + 0.1 * k, folded, nothing, passed)
        assert answer.phase is phase
        # Driven back meanwhile, it stops where it is.
        if phase is PassagePhase.RETURNING:
            nearer = passed._replace(near=passed.near + 0.4)
            assert reflex.step(6.1, folded, nothing, nearer).phase is PassagePhase.UNDECIDED


HALF = 0.35
"""Of a base that steers, with what it keeps free [m]."""


def meets(wall: Array, base: Pose, curvature: float) -> bool:
    """Whether a base that drives 2 m on an arc comes too near to points of a wall (k, 2)."""
    ways = np.linspace(0.0, 2.0, 60)
    a = curvature * ways
    x, y = ways * np.sinc(a / np.pi), 0.5 * a * ways * np.sinc(0.5 * a / np.pi) ** 2
    middles = np.stack([x, y], axis=1) @ base.R[:2, :2].T + base.p[:2]
    return bool(np.linalg.norm(wall[None] - middles[:, None], axis=2).min() < HALF)


def drive(low: float, high: float, obeys: float = 1.0) -> tuple[list[Pose], Steering]:
    """Drive a base without dynamics at a wall 2 m ahead, from `low` to `high` across [m].

    It turns by a part `obeys` of what it is told.
    """
    steering, base, poses = Steering(0.8), Pose.from_xyz_rpy((0.0,) * 3, (0.0,) * 3), []
    wall = np.stack([np.full(40, 2.0), np.linspace(low, high, 40)], axis=1)
    for k in range(500):
        curvature = steering.step(0.04 * k, base, partial(meets, wall, base))
        turn = obeys * curvature * 0.01
        base = base @ Pose.from_xyz_rpy((0.01, 0.0, 0.0), (0.0, 0.0, turn))
        poses.append(base)
    return poses, steering


def heading(pose: Pose) -> float:
    return math.atan2(pose.R[1, 0], pose.R[0, 0])


@pytest.mark.parametrize(
    ("low", "high", "side"), [(-1.0, 0.2, 1), (-0.2, 1.0, -1), (-0.1, 0.3, -1)]
)
def test_a_base_passes_a_wall_on_the_near_side_and_is_on_its_heading_again(
    low: float, high: float, side: int
) -> None:
    poses, steering = drive(low, high)
    places = np.array([pose.p[:2] for pose in poses])
    wall = np.stack([np.full(40, 2.0), np.linspace(low, high, 40)], axis=1)
    assert np.linalg.norm(places[:, None] - wall[None], axis=2).min() > HALF - 0.02
    end = high + HALF if side > 0 else low - HALF
    assert side * places[-1, 1] > side * end - 0.02
    assert side * places[-1, 1] < side * end + 0.5
    assert max(abs(heading(pose)) for pose in poses) > 0.1
    assert abs(heading(poses[-1])) < 0.05
    assert steering.curvature == pytest.approx(0.0, abs=0.05)


def test_one_that_somebody_else_turns_is_not_turned_back_later() -> None:
    poses, steering = drive(-1.0, 0.2, obeys=0.0)
    assert np.abs([pose.p[1] for pose in poses]).max() == 0.0
    assert steering._owed == 0.0
    assert steering.step(100.0, poses[-1], lambda _: False) == 0.0


def test_where_no_arc_is_free_it_goes_straight_on_so_that_the_reflex_stops_it() -> None:
    tried: list[float] = []

    def blocked(curvature: float) -> bool:
        tried.append(curvature)
        return True

    at, steering = Pose.from_xyz_rpy((0.0,) * 3, (0.0,) * 3), Steering(0.8)
    looks = []
    for k in range(10):
        assert steering.step(0.02 * k, at, blocked) == 0.0
        looks.append(len(tried))
        tried.clear()
    # A look costs much: never many in one contour, and none while nothing can have changed.
    assert max(looks) == 1 + AT_ONCE
    assert sum(looks) == 10 + 2 * ARCS + 1
    assert looks[-1] == 1


def test_a_search_of_arcs_goes_on_where_it_was_in_the_next_contour() -> None:
    at, steering = Pose.from_xyz_rpy((0.0,) * 3, (0.0,) * 3), Steering(0.8)
    told = [steering.step(0.02 * k, at, lambda c: abs(c) < 0.65) for k in range(9)]
    first = next(k for k, c in enumerate(told) if c)
    assert told[:first] == [0.0] * first
    assert first > 1
    assert abs(told[first]) == pytest.approx(0.7)


def test_one_that_may_not_steer_looks_at_nothing() -> None:
    at, tried = Pose.from_xyz_rpy((0.0,) * 3, (0.0,) * 3), []

    def blocked(curvature: float) -> bool:
        tried.append(curvature)
        return True

    assert Steering(0.0).step(0.0, at, blocked) == 0.0
    assert tried == []


def test_a_base_that_hears_late_of_a_bridge_still_stands_off_it(found: Search) -> None:
    """Of a contour as old as may be, and the rest that it takes to react, with its braking."""
    for silent_s in (0.2, 1.0):
        for room in np.linspace(0.0, 2.0, 21):
            speed = speed_within(room, silent_s)
            way = speed * (silent_s + REACTS_S) + speed**2 / (2.0 * DECELERATION)
            assert way == pytest.approx(room, abs=1e-12)
    speeds = []
    for silent_s in (0.2, 1.0):
        reflex = PassageReflex(found, 4.0, silent_s=silent_s)
        for time_s in (0.0, 0.1):
            answer = reflex.step(time_s, START, bridge(0.95, 1.5).within(-3.0, 3.0))
        speeds.append(answer.most_speed)
    assert 0.0 < speeds[1] < 0.8 * speeds[0]
