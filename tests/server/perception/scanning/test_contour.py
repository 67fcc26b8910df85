"""Cells of the plane, what is forbidden in it, and boxes around what is in them."""

from pathlib import Path

import numpy as np
import pytest
from laboratory.papers.lwa3 import (
    PLANE,
    START,
    cell_of,
    crossed,
    interference,
    search,
    touched,
)
from numpy.typing import NDArray
from telerobot.server.perception.scanning.contour import (
    Contour,
    Obstacles,
    along_arc,
    boxes_of,
    clearance,
    contour_of,
    forbidden,
)
from telerobot.server.perception.scanning.placing import PointMemory

Array = NDArray[np.float64]


def test_shoulder_elbow_and_tool_of_the_papers_posture_are_in_its_cells(tmp_path: Path) -> None:
    shoulder, elbow, *_, tool = search(tmp_path).points.of(START[None])[0]
    cells = [cell_of(PLANE, p[1], p[2]) for p in (shoulder, elbow, tool)]
    assert [(i + 1, j + 1) for i, j in cells] == [(7, 21), (11, 21), (18, 21)]


FOOT = np.array([0.2, 0.0, 0.5])


def on_arc(way: float, curvature: float, part: Array) -> Array:
    """Where a part of a base, seen from Base, is once that has driven a way on an arc."""
    a = way * curvature
    R = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    return R @ part + np.array([np.sin(a), 1.0 - np.cos(a)]) / curvature


@pytest.mark.parametrize("curvature", [-0.8, -0.1, 0.3, 0.8])
def test_along_an_arc_points_are_where_a_base_that_drives_there_has_them_beside_it(
    curvature: float,
) -> None:
    draw = np.random.default_rng(4)
    for way, left, up in draw.uniform((-0.4, -0.9, 0.0), (3.0, 0.9, 1.0), (50, 3)):
        x, y = on_arc(way, curvature, np.array([0.0, left]))
        seen = np.array([[x, y, up]]) - FOOT
        np.testing.assert_allclose(
            along_arc(seen, FOOT, curvature)[0], np.array([way, left, up]) - FOOT, atol=1e-12
        )
    np.testing.assert_array_equal(along_arc(seen, FOOT, 0.0), seen)


@pytest.mark.parametrize("curvature", [-0.8, 0.3, 0.8])
def test_what_the_nose_or_the_tail_of_a_base_sweeps_is_within_what_obstacles_are_wider_by(
    curvature: float,
) -> None:
    most = 0.5 * curvature * 0.45**2
    for part in np.random.default_rng(5).uniform((-0.35, -0.3), (0.45, 0.3), (50, 2)):
        x, y = on_arc(1.2, curvature, part)
        met = along_arc(np.array([[x, y, 0.0]]) - FOOT, FOOT, curvature)[0, 1]
        point = Obstacles(np.array([[met, 0.0]]), np.array([[met, 0.0]]), np.array([1.0]))
        wide = point.wider(max(0.0, -most), max(0.0, most))
        assert wide.low[0, 0] - 0.03 <= part[1] <= wide.high[0, 0] + 0.03


def test_forbidden_cells_are_those_of_a_grid_ten_times_as_fine(tmp_path: Path) -> None:
    points = search(tmp_path).points.of(START[None])[0]
    for a, b in ((points[0], points[-1]), (points[0], points[1]), (points[1], points[-1])):
        np.testing.assert_array_equal(crossed(a[1:], b[1:], PLANE), touched(a[1:], b[1:]))


def test_slanting_links_forbid_no_cell_less_than_a_fine_grid() -> None:
    draw = np.random.default_rng(2)
    for _ in range(30):
        a, b = draw.uniform((-0.8, 0.1), (0.8, 0.9), (2, 2))
        assert not (touched(a, b) & ~crossed(a, b, PLANE)).any()


def test_cells_within_reach_are_those_of_a_grid_ten_times_as_fine() -> None:
    draw = np.random.default_rng(3)
    fine = (np.arange(200) + 0.5) * 0.005
    for _ in range(5):
        a, b = draw.uniform((-0.8, 0.1), (0.8, 0.9), (2, 2))
        y, z = np.meshgrid((np.arange(400) + 0.5) * 0.005 - 1.0, fine)
        t = np.clip(((y - a[0]) * (b - a)[0] + (z - a[1]) * (b - a)[1]) / ((b - a) @ (b - a)), 0, 1)
        off = np.hypot(y - a[0] - t * (b - a)[0], z - a[1] - t * (b - a)[1])
        least = off.reshape(20, 10, 40, 10).min(axis=(1, 3))
        found = forbidden(a, b, PLANE, 0.10)
        assert found[least <= 0.10].all()
        assert not found[least > 0.10 + 0.0036].any()  # half a diagonal of the fine grid


def test_what_is_forbidden_and_occupied_interferes() -> None:
    nearest = np.full((20, 40), np.nan)
    nearest[10, 20], nearest[3, 3] = 0.0, 1.0
    area = crossed(np.array([0.0, 0.3]), np.array([0.0, 0.6]), PLANE)
    met = interference(Contour(nearest, nearest), area)
    assert met[10, 20] == 0.0  # an obstacle right at the shoulder is one, not nothing
    assert np.isnan(met[3, 3])
    assert np.count_nonzero(~np.isnan(met)) == 1


def test_a_cell_needs_two_hits_one_of_them_well_inside() -> None:
    middle = np.array([1.0, 0.025, 0.525])
    points = middle + np.array([[0, 0, 0], [0.2, 0.6, 0], [0, 0.3, 0.024]])
    nearest = contour_of(points, np.array([2.0, 1.0, 5.0]), PLANE, -0.5).nearest
    assert np.argwhere(~np.isnan(nearest)).tolist() == [[10, 20]]
    assert nearest[10, 20] == 1.0


def test_tails_of_noise_beside_a_full_cell_are_nothing() -> None:
    points = np.array([[1.0, 0.025, 0.525], [1.0, 0.025, 0.565]])
    for tail, filled in ((10.0, 1), (20.0, 2)):
        nearest = contour_of(points, np.array([100.0, tail]), PLANE, -0.5).nearest
        assert np.count_nonzero(~np.isnan(nearest)) == filled


def test_what_is_passed_or_too_far_is_nothing() -> None:
    middle = np.array([1.0, 0.025, 0.525])
    points = middle + np.array([[-2, 0, 0], [2.5, 0, 0], [0, 2, 0]])
    assert np.isnan(contour_of(points, np.full(3, 9.0), PLANE, -0.5).nearest).all()


def scene() -> Contour:
    draw, nearest = np.random.default_rng(5), np.full((20, 40), np.nan)
    nearest[9:11, 4:36] = 2.0
    nearest[0:9, 4:6] = nearest[0:9, 34:36] = 2.0
    nearest[10, 11] = np.nan
    nearest[draw.random((20, 40)) < 0.02] = 1.5
    return Contour(nearest, nearest + 0.2)


def test_boxes_hold_every_cell_and_few_more() -> None:
    contour = scene()
    boxes = boxes_of(contour)
    assert len(boxes) <= 16
    held = np.zeros((20, 40), dtype=bool)
    for box in boxes:
        inside = contour.nearest[slice(*box.rows), slice(*box.columns)]
        assert box.near <= np.nanmin(inside)
        assert box.far >= np.nanmin(inside) + 0.05
        held[slice(*box.rows), slice(*box.columns)] = True
    filled = ~np.isnan(contour.nearest)
    assert held[filled].all()
    assert np.count_nonzero(held) < 1.3 * np.count_nonzero(filled)


def test_clearance_is_the_distance_of_the_nearest_cell_from_projected_links() -> None:
    nearest = np.full((20, 40), np.nan)
    nearest[10, 24] = 1.0  # y 0.20 to 0.25, z 0.50 to 0.55
    obstacles = Obstacles.of(Contour(nearest, nearest), PLANE)
    links = np.array([[0.0, 0.0, 0.3], [0.1, 0.0, 0.6]])
    assert abs(clearance(links, obstacles) - 0.20) < 1e-9
    assert clearance(np.array([[0, 0, 0.52], [0, 0.5, 0.52]]), obstacles) == 0.0
    assert clearance(links, obstacles.within(1.2, 3.0)) == np.inf


def test_memory_keeps_what_is_hidden_and_forgets_what_is_seen_through() -> None:
    memory, n = PointMemory(), 541
    first, step = np.radians(-45), np.radians(0.5)
    pole = np.array([[1.5, 0.0, 0.0]] * 20 + [[1.0, 0.8, 0.0]] * 20)
    memory.add(pole)
    assert memory.hits.tolist() == [20.0, 20.0]
    hidden = np.full(n, np.nan)
    for _ in range(20):
        memory.see_through(np.eye(3), np.zeros(3), first, step, hidden)
    assert len(memory.points) == 2
    away = np.full(n, np.nan)
    away[265:276] = 5.0  # straight ahead, rays go on to 5 m now
    for _ in range(8):
        memory.see_through(np.eye(3), np.zeros(3), first, step, away)
    assert memory.points.round(3).tolist() == [[1.0, 0.8, 0.0]]


def test_memory_forgets_what_has_been_passed() -> None:
    memory = PointMemory()
    memory.add(np.array([[1.5, 0.0, 0.0], [0.2, 0.5, 0.0]]))
    memory.pass_by(np.eye(3), np.array([0.5, 0.0, 0.0]), -0.1, 3.0)
    assert memory.points.tolist() == [[1.5, 0.0, 0.0]]


@pytest.mark.parametrize("underside", [0.43, 0.41, 0.403])
def test_an_edge_within_a_cell_is_known_to_a_centimetre(underside: float) -> None:
    """Cells are 50 mm wide: a bridge seemed lower by as much, and openings narrower."""
    draw = np.random.default_rng(6)
    y, x = draw.uniform(-0.33, 0.28, 8000), draw.uniform(1.0, 1.1, 8000)
    below = np.stack([x, y, underside + draw.normal(0.0, 0.004, 8000)], axis=1)
    face = np.stack([1.0 + 0 * y, y, draw.uniform(underside, underside + 0.1, 8000)], axis=1)
    points = np.concatenate([below, face])
    contour = contour_of(points, np.ones(len(points)), PLANE, -0.5)
    obstacles = Obstacles.of(contour, PLANE)
    middle = np.abs(obstacles.low[:, 0] + 0.025) < 0.25
    lowest = obstacles.low[middle, 1].min()
    assert underside - 0.02 < lowest <= underside
    assert -0.345 < obstacles.low[:, 0].min() <= -0.325
    assert 0.275 <= obstacles.high[:, 0].max() < 0.295
    # Cells of one surface leave no gap.
    row = obstacles.low[(obstacles.low[:, 1] >= 0.45 - 1e-9)]
    assert np.unique(row[:, 0]).size >= 12


def test_a_cell_with_few_hits_is_full() -> None:
    points = np.array([[1.0, 0.025, 0.525]])
    contour = contour_of(points, np.array([5.0]), PLANE, -0.5)
    obstacles = Obstacles.of(contour, PLANE)
    np.testing.assert_allclose(obstacles.high - obstacles.low, 0.05)


@pytest.mark.parametrize(("underside", "lowest_row"), [(0.45, 9), (0.438, 8), (0.425, 8)])
def test_a_surface_that_is_seen_from_below_is_in_the_cell_that_it_is_in(
    underside: float, lowest_row: int
) -> None:
    draw = np.random.default_rng(6)
    y, x = draw.uniform(-0.3, 0.3, 4000), draw.uniform(1.0, 1.1, 4000)
    below = np.stack([x, y, underside + draw.normal(0.0, 0.012, 4000)], axis=1)
    z = draw.uniform(underside, underside + 0.1, 4000)
    face = np.stack([1.0 + draw.normal(0, 0.012, 4000), y, z], axis=1)
    points = np.concatenate([below, face])
    nearest = contour_of(points, np.ones(len(points)), PLANE, -0.5).nearest
    found = ~np.isnan(nearest[:, 15:25])
    assert np.nonzero(found.any(axis=1))[0].min() == lowest_row
    assert found[9].all()
