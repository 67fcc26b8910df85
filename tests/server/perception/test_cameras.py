"""Pictures with the arm at known poses: what is believed, kept, lost and told."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from telerobot.config.load import Cell, altered, load_cell
from telerobot.config.schema.surroundings import CameraSection
from telerobot.protocols.messages.perception import Sighting
from telerobot.server.control.spatial import Pose, rotation_exp, rotation_log, rotation_rpy
from telerobot.server.events import Events
from telerobot.server.perception.cameras import VisionTracker
from telerobot.server.refusals import Refused

TARGET = Pose(rotation_rpy(1.5708, 0.3, -1.4), np.array([1.2, 0.1, 0.5]))
BASE = Pose.identity()
WRIST = Pose(rotation_rpy(0.0, 1.5708, 0.0), np.array([0.6, 0.0, 0.4]))


SQUARE = 0.05 * np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])
BESIDE = 0.8 * SQUARE + [0.13, -0.02, 0.0]
"""A second tag of a board, in the axes of the first."""


def corners(T_lens_board: Pose, tags: dict[int, np.ndarray]) -> tuple:
    """Return what a sighting says of the corners of tags, given in the board's axes."""
    found = []
    for tag, points in tags.items():
        P = points @ T_lens_board.R.T + T_lens_board.p
        found.append((tag, tuple((P[:, :2] / P[:, 2:]).ravel().tolist())))
    return tuple(found)


@pytest.fixture(scope="module")
def cell() -> Cell:
    loaded = load_cell("pa10_vision")
    return altered(loaded, {"sources.vision.smoothing_s": 0.0})


@dataclass
class Watching:
    """A watch, the arm that carries its camera, and the events that came of it."""

    cell: Cell
    target: Pose = TARGET
    tick: int = 1000
    wrists: dict[int, Pose] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.events = Events()
        self.watch = VisionTracker.from_cell(self.cell, self.events)
        place = self.cell.config.cameras[0].T_wrist_lens
        self.lens = Pose.from_xyz_rpy(place.xyz, place.rpy)

    def go(self, ticks: int, twist=(0.0,) * 6) -> None:
        """Let time pass; the Wrist moves by a twist in World axes at its origin."""
        v, w = np.array(twist[:3]), np.array(twist[3:])
        for _ in range(ticks):
            self.tick += 1
            last = self.wrists.get(self.tick - 1, WRIST)
            self.wrists[self.tick] = Pose(rotation_exp(0.01 * w) @ last.R, last.p + 0.01 * v)
            self.events.at(self.tick, 0.01 * self.tick)
            self.watch.remember(self.tick, self.wrists[self.tick], BASE)
            self.watch.update(self.tick)

    def sighting(self, tick: int, **changes) -> Sighting:
        seen = (self.wrists[tick] @ self.lens).inverse() @ self.target
        fields = {
            "camera": "wrist",
            "tick": tick,
            "poses": (seen.to_xyz_rpy(),),
            "errors_px": (0.1,),
            "seen": corners(seen, {7: SQUARE}),
            "quality": 0.9,
        }
        return Sighting(**{**fields, **changes})

    def see(self, late: int = 0, **changes) -> None:
        self.watch.take(self.sighting(self.tick - late, **changes), self.tick)

    def told(self) -> list[tuple[str, object]]:
        return [(e.name, e.values.get("reason")) for e in self.events.take()]


@pytest.fixture
def watching(cell) -> Watching:
    watching = Watching(cell)
    watching.go(5)
    return watching


def test_a_late_picture_from_a_moving_arm_puts_the_target_where_it_is(cell):
    watching = Watching(altered(cell, {"sources.vision.view": {"xyz": (0.0, 0.0, 0.0)}}))
    watching.go(30, (0.2, -0.1, 0.1, 0.3, 0.5, -0.4))
    watching.see(late=20)
    goal = watching.watch.goal(BASE)
    # With the view "tag and Lens are one" the goal is the target itself.
    np.testing.assert_allclose(goal.T_world_goal.p, TARGET.p, atol=1e-12)
    np.testing.assert_allclose(goal.T_world_goal.R, TARGET.R, atol=1e-12)


def test_the_stored_view_is_the_one_of_now_and_not_of_the_pictures_instant(watching):
    watching.see()
    watching.go(10, (0.2, 0.0, 0.1, 0.0, 0.2, 0.0))
    stored = watching.watch.store(None)
    truth = (watching.wrists[watching.tick] @ watching.lens).inverse() @ TARGET
    np.testing.assert_allclose(list(stored.values()), truth.to_xyz_rpy(), atol=1e-12)
    goal = watching.watch.goal(BASE)
    lens_now = watching.wrists[watching.tick] @ watching.lens
    np.testing.assert_allclose(goal.T_world_goal.p, lens_now.p, atol=1e-12)


def test_news_that_stops_is_a_view_that_is_lost_and_the_first_picture_finds_it(watching):
    watching.see()
    watching.watch.store("wrist")
    assert watching.told() == [("view_found", None)]
    watching.go(25)
    assert watching.watch.goal(BASE) is not None
    watching.go(1)
    assert watching.watch.goal(BASE) is None
    assert watching.watch.view is None
    assert watching.watch.age(watching.tick) is None
    assert watching.told() == [("view_lost", "no_picture")]
    watching.see()
    assert watching.told() == [("view_found", None)]
    assert watching.watch.goal(BASE) is not None


def test_a_covered_tag_is_told_once_and_then_the_view_is_lost_for_that_reason(watching):
    watching.see()
    watching.told()
    for _ in range(10):
        watching.go(5)
        watching.see(poses=(), errors_px=(), quality=0.0)
    assert watching.told() == [("picture_rejected", "no_tag"), ("view_lost", "no_tag")]


def test_a_target_that_jumps_is_refused_until_the_old_one_is_forgotten(watching):
    watching.see()
    watching.watch.store(None)
    before = watching.watch.goal(BASE)
    watching.target = Pose(TARGET.R, TARGET.p + np.array([0.0, 0.3, 0.0]))
    watching.told()
    watching.go(5)
    watching.see()
    assert watching.told() == [("picture_rejected", "jump")]
    np.testing.assert_allclose(watching.watch.goal(BASE).T_world_goal.p, before.T_world_goal.p)
    for _ in range(5):
        watching.go(5)
        watching.see()
    assert watching.told() == [("view_lost", "jump"), ("view_found", None)]
    assert watching.watch.goal(BASE).T_world_goal.p[1] == pytest.approx(
        before.T_world_goal.p[1] + 0.3
    )


def test_of_two_poses_the_one_that_agrees_with_the_last_picture_is_kept(watching):
    watching.see()
    watching.go(5)
    truth = watching.sighting(watching.tick).poses[0]
    wrong = (*truth[:3], truth[3] + 0.6, *truth[4:])
    watching.see(poses=(wrong, truth), errors_px=(0.4, 0.5))
    seen = watching.watch.view
    right = Pose.from_xyz_rpy(truth[:3], truth[3:])
    assert np.linalg.norm(rotation_log(seen.R.T @ right.R)) < 1e-9


def test_two_poses_with_nothing_to_compare_them_to_are_refused_by_name(watching):
    truth = watching.sighting(watching.tick).poses[0]
    wrong = (*truth[:3], truth[3] + 0.6, *truth[4:])
    watching.see(poses=(truth, wrong), errors_px=(0.4, 0.5))
    assert watching.told() == [("picture_rejected", "ambiguous")]
    assert watching.watch.goal(BASE) is None


def test_poor_late_and_repeated_pictures_are_refused_by_name(watching):
    watching.see(quality=0.1)
    assert watching.told() == [("picture_rejected", "quality")]
    watching.go(1)
    watching.see()
    watching.see()
    assert watching.told() == [("view_found", None), ("picture_rejected", "out_of_order")]
    newest = watching.sighting(watching.tick)
    watching.go(40)
    watching.watch.take(newest.model_copy(update={"tick": newest.tick + 1}), watching.tick)
    assert ("picture_rejected", "late") in watching.told()


def test_a_picture_from_the_future_and_one_of_no_camera_are_refused(watching):
    with pytest.raises(Refused, match="this is tick"):
        watching.watch.take(
            watching.sighting(watching.tick).model_copy(update={"tick": watching.tick + 1}),
            watching.tick,
        )
    with pytest.raises(Refused, match="'ceiling' is none of wrist, beside"):
        watching.see(camera="ceiling")


def test_a_view_is_stored_only_of_a_camera_that_sees_something(watching):
    with pytest.raises(Refused, match="camera wrist sees no tag now"):
        watching.watch.store(None)
    with pytest.raises(Refused, match="'ceiling' is none of"):
        watching.watch.store("ceiling")
    with pytest.raises(Refused, match="no view is stored yet"):
        watching.watch.require_view()
    watching.see()
    watching.watch.store(None)
    watching.watch.require_view()


def test_each_camera_has_a_stored_view_of_its_own_to_go_back_to(watching):
    carried = Pose(rotation_rpy(1.5708, 1.5708, 0.0), np.array([0.0, -0.06, 0.02]))
    place = watching.cell.config.cameras[1].T_world_lens
    lens = Pose.from_xyz_rpy(place.xyz, place.rpy)
    watching.see()
    with pytest.raises(Refused, match="no view of camera beside is stored yet"):
        watching.watch.store("beside", again=True)
    first = watching.watch.store("wrist")
    watching.go(20, (0.1, 0.0, 0.0, 0.0, 0.0, 0.2))
    seen = lens.inverse() @ watching.wrists[watching.tick] @ carried
    watching.see(camera="beside", poses=(seen.to_xyz_rpy(),))
    second = watching.watch.store("beside")
    watching.go(20, (0.1, 0.0, 0.0, 0.0, 0.0, 0.2))
    assert watching.watch.store("wrist", again=True) == first
    assert watching.watch.store("beside", again=True) == second
    assert watching.watch.store(None, again=True) == second


def test_a_view_is_kept_again_while_its_camera_sees_nothing(watching):
    watching.see()
    stored = watching.watch.store("wrist")
    watching.go(100)
    assert watching.watch.view is None
    assert watching.watch.store("wrist", again=True) == stored


def test_a_cell_without_cameras_has_no_view():
    watch = VisionTracker.from_cell(load_cell("pa10"), Events())
    assert not watch.watching
    assert watch.goal(BASE) is None
    with pytest.raises(Refused, match="the cell has no camera"):
        watch.require_view()


def test_a_camera_beside_the_arm_moves_what_the_arm_carries(watching):
    carried = Pose(rotation_rpy(1.5708, 1.5708, 0.0), np.array([0.0, -0.06, 0.02]))
    place = watching.cell.config.cameras[1].T_world_lens
    lens = Pose.from_xyz_rpy(place.xyz, place.rpy)

    def see():
        seen = lens.inverse() @ watching.wrists[watching.tick] @ carried
        watching.see(camera="beside", poses=(seen.to_xyz_rpy(),))

    see()
    watching.watch.store("beside")
    there = watching.wrists[watching.tick] @ carried
    watching.go(20, (0.3, 0.1, 0.0, 0.0, 0.4, 0.0))
    see()
    goal = watching.watch.goal(BASE)
    np.testing.assert_allclose(goal.T_wrist_point.p, carried.p, atol=1e-12)
    np.testing.assert_allclose(goal.T_world_goal.p, there.p, atol=1e-12)
    np.testing.assert_allclose(goal.T_world_lens.R, lens.R)


def servo(watching, late, stamped_late, gain=4.0, seconds=12.0):
    """Drive the Lens with pictures `late` ticks old; return its distances to the desired view."""
    watching.go(40)
    watching.see()
    watching.watch.store(None)
    home = watching.wrists[watching.tick] @ watching.lens
    watching.go(40, (0.2, 0.3, 0.0, 0.0, 0.0, 0.0))
    away = []
    for i in range(round(seconds * 100)):
        lens = watching.wrists[watching.tick] @ watching.lens
        away.append(float(np.linalg.norm(lens.p - home.p)))
        if i % 5 == 0:
            seen = watching.sighting(watching.tick - late)
            stamp = watching.tick - (late if stamped_late else 0)
            watching.watch.take(seen.model_copy(update={"tick": stamp}), watching.tick)
        goal = watching.watch.goal(BASE)
        rate = np.zeros(3) if goal is None else gain * (goal.T_world_goal.p - lens.p)
        rate *= min(1.0, 0.4 / max(1e-12, float(np.linalg.norm(rate))))
        watching.go(1, (*rate, 0.0, 0.0, 0.0))
    return np.array(away)


def test_however_late_pictures_are_the_view_is_reached_without_swinging(watching):
    # The exact pose at the picture's instant takes the arm's own motion out of the loop.
    away = servo(watching, late=20, stamped_late=True)
    assert (np.diff(away) <= 1e-9).all()
    assert away[-1] < 1e-6


def test_pictures_stamped_when_they_came_would_swing_for_ever(watching):
    # The same loop, its pictures' lateness not told: 0.2 s at 4 /s is past what is stable.
    away = servo(watching, late=20, stamped_late=False, gain=12.0)
    assert away[-100:].max() > 0.02


def test_a_camera_on_a_base_that_moves_places_what_it_sees_by_the_base_of_its_tick(cell):
    """The carried target is seen at tick 1000, from where Base was then; now it is elsewhere."""
    beside = cell.config.cameras[1]
    T_base_lens = beside.T_world_lens
    moved = beside.model_copy(update={"T_world_lens": None, "T_base_lens": T_base_lens})
    watch = VisionTracker.from_cell(altered(cell, {"cameras": (moved,)}), Events())
    lens = Pose.from_xyz_rpy(T_base_lens.xyz, T_base_lens.rpy)
    then = Pose(rotation_rpy(0.0, 0.0, 0.2), np.array([0.1, -0.05, 0.0]))
    T_wrist_target = Pose(rotation_rpy(0.3, 0.0, 0.0), np.array([0.0, -0.06, 0.02]))
    watch.remember(1000, WRIST, then)
    watch.remember(1001, WRIST, BASE)
    seen = (then @ lens).inverse() @ WRIST @ T_wrist_target
    fields = {"poses": (seen.to_xyz_rpy(),), "errors_px": (0.1,), "quality": 0.9}
    watch.take(Sighting(camera=moved.name, tick=1000, **fields), 1001)
    watch.store(moved.name)
    assert watch.lens().on == "base"
    goal = watch.goal(then)
    np.testing.assert_allclose(goal.T_wrist_point.p, T_wrist_target.p, atol=1e-9)
    # The view was stored with Base where it is now; with Base where it was, the goal goes along.
    expected = then @ WRIST @ T_wrist_target
    np.testing.assert_allclose(goal.T_world_goal.p, expected.p, atol=1e-9)
    np.testing.assert_allclose(goal.T_world_goal.R, expected.R, atol=1e-9)


# --- Stored pictures ------------------------------------------------------------------------------


@pytest.fixture
def board(cell) -> Watching:
    """A camera whose picture is kept, before a board of two tags."""
    tags = ({"tag": 9, "size": 0.08, "T_board_tag": {"xyz": (0.13, -0.02, 0.0)}},)
    watching = Watching(altered(cell, {"cameras.0.board": tags, "cameras.0.law": "image"}))
    watching.go(5)
    return watching


def lens_of(watching):
    return watching.wrists[watching.tick] @ watching.lens


def see(watching, tags):
    """Let some tags of the board be seen."""
    watching.see(seen=corners(lens_of(watching).inverse() @ watching.target, tags))


def pictured(watching, points=SQUARE):
    P = points @ watching.target.R.T + watching.target.p
    P = (P - lens_of(watching).p) @ lens_of(watching).R
    return P[:, :2] / P[:, 2:]


def test_a_stored_picture_is_the_one_of_now_and_is_kept_by_the_corners_that_are_seen(board):
    see(board, {7: SQUARE, 9: BESIDE})
    board.go(8, (0.2, 0.0, 0.1, 0.0, 0.2, 0.0))
    assert board.watch.law == "image"
    board.watch.store(None)
    wanted = np.concatenate([pictured(board), pictured(board, BESIDE)])
    board.go(10, (0.1, 0.2, 0.0, 0.0, 0.0, 0.3))
    see(board, {9: BESIDE, 7: SQUARE})
    board.go(4, (0.1, 0.0, 0.0, 0.0, 0.0, 0.0))
    points, found = board.watch.goal(BASE).picture
    there = np.concatenate([each @ TARGET.R.T + TARGET.p for each in (SQUARE, BESIDE)])
    np.testing.assert_allclose(points, there, atol=1e-9)
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    now = np.concatenate([pictured(board), pictured(board, BESIDE)])
    off = 420.0 * np.linalg.norm(now - wanted, axis=1)
    assert board.watch.error_px == pytest.approx(np.sqrt(np.mean(off**2)), abs=1e-6)


def test_only_tags_that_are_in_both_pictures_count_and_without_any_the_view_is_lost(board):
    see(board, {7: SQUARE, 9: BESIDE})
    board.watch.store(None)
    board.told()
    for _ in range(6):
        board.go(5)
        see(board, {9: BESIDE})
    assert len(board.watch.goal(BASE).picture.points) == 4
    assert board.told() == []
    for _ in range(6):
        board.go(5)
        see(board, {})
    assert board.watch.goal(BASE) is None
    assert board.watch.error_px is None
    assert board.told() == [("view_lost", "nothing_stored_is_seen")]
    board.go(5)
    see(board, {7: SQUARE})
    board.go(1)
    assert board.watch.goal(BASE) is not None
    assert board.told() == [("view_found", None)]


def test_a_tag_that_is_hidden_for_less_than_a_picture_may_be_old_still_counts(board):
    see(board, {7: SQUARE, 9: BESIDE})
    board.watch.store(None)
    board.go(20)
    see(board, {9: BESIDE})
    assert len(board.watch.goal(BASE).picture.points) == 8


def test_too_few_corners_are_no_picture_to_store_and_the_view_of_before_stays(board):
    see(board, {7: SQUARE})
    board.watch.store(None)
    before = board.watch.goal(BASE).picture.wanted
    board.go(30)
    see(board, {})
    with pytest.raises(Refused, match="camera wrist sees too few corners"):
        board.watch.store(None)
    board.go(5)
    see(board, {7: SQUARE})
    np.testing.assert_array_equal(board.watch.goal(BASE).picture.wanted, before)


def test_corners_that_the_pose_does_not_explain_are_passed_over(board):
    see(board, {7: SQUARE, 9: BESIDE})
    board.watch.store(None)
    board.go(5)
    # 30 mm are more than is noise between two pictures, 20 mm; 12 mm are a board that is told badly
    aside = Pose(np.eye(3), np.array([0.012, 0.0, 0.0]))
    far = Pose(np.eye(3), np.array([0.03, 0.0, 0.0]))
    here = lens_of(board).inverse() @ TARGET
    board.see(seen=corners(here @ aside, {7: SQUARE}) + corners(here @ far, {9: BESIDE}))
    points = board.watch.goal(BASE).picture.points
    moved = (SQUARE + aside.p) @ TARGET.R.T + TARGET.p
    assert np.abs(points[:4] - moved).max() < 2e-3
    np.testing.assert_allclose(points[4:], BESIDE @ TARGET.R.T + TARGET.p, atol=1e-9)


def test_a_request_changes_the_law_of_a_stored_view_and_the_picture_travels_with_it(watching):
    watching.see()
    watching.watch.store("wrist")
    wanted = pictured(watching)
    assert watching.watch.goal(BASE).picture.points.size == 0
    watching.go(20, (0.1, 0.0, 0.0, 0.0, 0.0, 0.2))
    watching.see()
    watching.watch.store("wrist", again=True, law="image")
    assert watching.watch.law == "image"
    np.testing.assert_allclose(watching.watch.goal(BASE).picture.wanted, wanted, atol=1e-9)
    watching.watch.store("wrist", again=True)
    assert watching.watch.law == "image"
    watching.watch.store("wrist", again=True, law="pose")
    assert watching.watch.goal(BASE).picture.points.size == 0
    assert watching.watch.error_px > 1.0


def test_a_view_that_the_cell_tells_is_a_picture_too(cell):
    view = {"xyz": (0.01, 0.02, 0.5), "rpy": (3.1, 0.0, 0.1)}
    watching = Watching(altered(cell, {"sources.vision.view": view, "cameras.0.law": "image"}))
    watching.go(5)
    watching.see()
    P = SQUARE @ rotation_rpy(*view["rpy"]).T + view["xyz"]
    np.testing.assert_allclose(
        watching.watch.goal(BASE).picture.wanted, P[:, :2] / P[:, 2:], atol=1e-9
    )


def test_before_a_camera_beside_the_arm_or_on_its_base_corners_are_those_of_the_carried_tag(cell):
    carried = Pose(rotation_rpy(1.5708, 1.5708, 0.0), np.array([0.0, -0.06, 0.02]))
    base = Pose(rotation_rpy(0.0, 0.0, 0.4), np.array([0.1, -0.2, 0.0]))
    place = cell.config.cameras[1].T_world_lens
    for on, T_world in (("T_world_lens", Pose.identity()), ("T_base_lens", base)):
        there = {"name": "beside", on: place, "tag": 3, "tag_size": 0.07, "law": "image"}
        eye = CameraSection.model_validate(there)
        watching = Watching(altered(cell, {"cameras.1": eye}))
        watching.go(5)
        watching.watch.remember(watching.tick, watching.wrists[watching.tick], base)
        lens = T_world @ Pose.from_xyz_rpy(place.xyz, place.rpy)
        tag = {3: 0.7 * SQUARE}
        seen = lens.inverse() @ watching.wrists[watching.tick] @ carried
        watching.watch.remember(watching.tick + 1, watching.wrists[watching.tick], base)
        watching.tick += 1
        sighting = Sighting(
            camera="beside", tick=watching.tick, poses=(seen.to_xyz_rpy(),), errors_px=(0.1,),
            seen=corners(seen, tag), quality=0.9,
        )  # fmt: skip
        watching.watch.take(sighting, watching.tick)
        watching.watch.store("beside")
        goal = watching.watch.goal(base)
        np.testing.assert_allclose(goal.picture.points, tag[3], atol=1e-9)
        np.testing.assert_allclose(goal.T_world_lens.p, lens.p, atol=1e-12)
        assert watching.watch.error_px == pytest.approx(0.0, abs=1e-6)
