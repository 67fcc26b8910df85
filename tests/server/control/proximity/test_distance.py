"""Distances in closed form, against coal, against a search, and where things touch."""

import coal
import numpy as np
import pytest
from telerobot.server.control.proximity.distance import NearestPoints, measured, violation
from telerobot.server.control.spatial import rotation_exp

COUNT = 300


NONE = np.zeros((0, 3))
NO_ROUNDS = (NONE, NONE)
NO_BOXES = (np.zeros((0, 3, 3)), NONE, NONE)


def segments(a, b, c, d) -> NearestPoints:
    """Return where each segment a–b is nearest to its c–d, as a round."""
    return things(a, b, (c, d), NO_BOXES)


def segments_boxes(a, b, R, centre, half) -> NearestPoints:
    """Return where each segment a–b is nearest to its box."""
    return things(a, b, NO_ROUNDS, (R, centre, half))


def things(a, b, rounds, boxes) -> NearestPoints:
    first = np.arange(len(a))
    ends = np.stack([a, b], axis=1)[None]
    return NearestPoints(*measured(ends, (first, first + len(a)), (*rounds, *boxes)))


@pytest.fixture
def lines(rng):
    """Segments a–b and c–d of all kinds: free, touching at an end, parallel, and points."""
    a, b, c, d = rng.uniform(-1, 1, (4, COUNT, 3))
    d[:40] = c[:40] + rng.uniform(-1, 1, (40, 1)) * (b - a)[:40]  # parallel
    b[40:60] = a[40:60]
    d[50:70] = c[50:70]
    return a, b, c, d


@pytest.fixture
def boxes(rng):
    R = np.array([rotation_exp(v) for v in rng.uniform(-3, 3, (COUNT, 3))])
    return R, rng.uniform(-1, 1, (COUNT, 3)), rng.uniform(0.05, 0.6, (COUNT, 3))


def test_segments_are_as_far_apart_as_coal_finds_its_capsules(lines):
    near = segments(*lines)
    for i, (a, b, c, d) in enumerate(zip(*lines, strict=True)):
        expected = _coal(_capsule(a, b), _capsule(c, d)) + 2 * THIN
        assert near.distance[i] == pytest.approx(expected, abs=1e-6)


def test_segments_are_as_far_from_boxes_as_coal_finds_them(lines, boxes):
    a, b, _, _ = lines
    near = segments_boxes(a, b, *boxes)
    outside = 0
    for i in range(COUNT):
        box = (coal.Box(*(2 * boxes[2][i])), coal.Transform3s(boxes[0][i], boxes[1][i]))
        expected = _coal(_capsule(a[i], b[i]), box) + THIN
        if near.distance[i] > 0:
            outside += 1
            assert near.distance[i] == pytest.approx(expected, abs=1e-6)
        else:
            assert expected < 1e-6
    assert COUNT / 4 < outside < COUNT


def test_no_point_of_a_segment_is_nearer_than_the_nearest(lines, boxes, rng):
    a, b, _, _ = lines
    R, centre, half = boxes
    near = segments_boxes(a, b, R, centre, half)
    for t in rng.uniform(0, 1, 200):
        x = np.einsum("kji,kj->ki", R, a + t * (b - a) - centre)
        away = np.linalg.norm(x - np.clip(x, -half, half), axis=1)
        assert (away >= near.distance - 1e-12).all()


def test_normals_are_the_slopes_of_the_distance(lines, boxes):
    a, b, c, d = lines
    for measure in (lambda a, b: segments(a, b, c, d), lambda a, b: segments_boxes(a, b, *boxes)):
        near = measure(a, b)
        h = 1e-7
        for i in range(3):
            step = h * np.eye(3)[i]
            slope = (measure(a + step, b + step).distance - near.distance) / h
            free = near.distance > 1e-3
            assert slope[free] == pytest.approx(near.normal[free, i], abs=2e-4)


def test_a_segment_that_cuts_a_box_comes_out_along_the_normal_by_the_distance(lines, boxes):
    a, b, _, _ = lines
    near = segments_boxes(a, b, *boxes)
    cutting = near.distance < 0
    assert cutting.sum() > 20
    way = -near.distance[:, None] * near.normal
    after = segments_boxes(a + way * 1.0001, b + way * 1.0001, *boxes)
    before = segments_boxes(a + way * 0.98, b + way * 0.98, *boxes)
    assert (after.distance[cutting] > 0).all()
    assert (before.distance[cutting] < 0).all()


def test_the_distance_does_not_jump_where_a_segment_enters_a_box():
    R, centre, half = np.eye(3)[None], np.zeros((1, 3)), np.array([[0.3, 0.2, 0.1]])
    found = []
    for z in np.linspace(0.12, 0.08, 41):
        p, q = np.array([[-1.0, 0.1, z]]), np.array([[1.0, 0.0, z]])
        near = segments_boxes(p, q, R, centre, half)
        found.append(float(near.distance[0]))
        assert near.normal[0] == pytest.approx([0, 0, 1])
    assert found == pytest.approx(np.linspace(0.02, -0.02, 41), abs=1e-9)


def test_over_a_face_that_it_is_parallel_to_the_nearest_place_is_in_the_middle():
    half = np.array([[0.3, 0.2, 0.1]])
    p, q = np.array([[-1.0, 0.0, 0.2]]), np.array([[1.0, 0.0, 0.2]])
    near = segments_boxes(p, q, np.eye(3)[None], np.zeros((1, 3)), half)
    assert near.place[0] == pytest.approx([0, 0, 0.2])


def test_crossing_segments_have_a_direction_too():
    p, q = np.array([[-1.0, 0, 0]]), np.array([[1.0, 0, 0]])
    near = segments(p, q, np.array([[0, -1.0, 0]]), np.array([[0, 1.0, 0]]))
    assert near.distance == 0.0
    assert abs(near.normal[0, 2]) == pytest.approx(1.0)
    same = segments(p, q, p, q)
    assert float(np.linalg.norm(same.normal)) == pytest.approx(1.0)


def test_two_segments_of_the_arm_are_measured_as_a_segment_and_a_round(lines):
    a, b, c, d = lines
    ends, i = np.stack([np.r_[a, c], np.r_[b, d]], axis=1)[None], np.arange(COUNT)
    own = measured(ends, (i, i + COUNT), (*NO_ROUNDS, *NO_BOXES))
    for found, expected in zip(own, segments(a, b, c, d), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("far", [-0.2, 0.0, 0.3])
def test_the_shortfall_is_that_of_the_worst_pair_at_the_worst_posture(lines, boxes, rng, far):
    a, b, c, d = lines
    postures = np.stack([a, b], axis=1) + rng.uniform(-0.5, 0.5, (5, 1, 1, 3))
    i, short = np.arange(COUNT), 0
    for _ in range(60):
        pairs = np.sort(rng.choice(COUNT, 7, replace=False))
        for rounds, others in (((c, d), NO_BOXES), (NO_ROUNDS, boxes)):
            distance = np.array(
                [things(*ends.swapaxes(0, 1), rounds, others).distance[pairs] for ends in postures]
            )
            wanted = distance + rng.uniform(-0.2, 0.1, distance.shape) + far
            found = violation(postures, (i, i + COUNT), pairs, wanted, (*rounds, *others))
            expected = max(0.0, float((wanted - distance).max()))
            assert found == pytest.approx(expected, abs=1e-12)
            short += found > 0.0
    assert (short > 0) == (far >= 0.0)


THIN = 0.01


def _capsule(a, b):
    """Return a thin capsule around a segment, as coal has it: along its own z axis."""
    along = b - a
    length = float(np.linalg.norm(along))
    z = along / length if length else np.array([0.0, 0, 1])
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x /= np.linalg.norm(x)
    R = np.column_stack([x, np.cross(z, x), z])
    return coal.Capsule(THIN, length), coal.Transform3s(R, 0.5 * (a + b))


def _coal(first, second) -> float:
    result = coal.DistanceResult()
    return float(coal.distance(*first, *second, coal.DistanceRequest(), result))
