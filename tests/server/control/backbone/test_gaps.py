"""A gap between two tunnels is crossed by a curve of its length that meets both, or is refused."""

import math

import numpy as np
import pytest
from telerobot.server.control.backbone.tunnels import Arcs, completed, solve_gap
from telerobot.server.control.spatial import Pose

HERE = Pose.from_xyz_rpy((0.1, 0.2, 0.3), (0.0, 0.0, 0.7))


def there(*way):
    return HERE @ Pose.from_xyz_rpy(way[:3], way[3:])


@pytest.mark.parametrize(
    ("way", "length", "planar"),
    [
        ((0.2, 0.05, 0, 0, 0, 0.4), 0.24, True),
        ((0.0, 0.2, 0, 0, 0, math.pi), 0.30, True),
        ((0.2, 0, 0, 0, 0, 0), 0.22, True),
        ((0.2, 0.05, 0, 0, 0, 0.4), 0.24, False),
        ((0.2, 0.03, 0.05, 0, -0.5, 0.3), 0.24, False),
    ],
)
def test_the_curve_meets_place_and_tangent_of_the_next_tunnel(way, length, planar):
    to = there(*way)
    turns = completed(solve_gap(HERE, to, length, planar, 40.0))
    end = Arcs.from_entrance(HERE, turns).end
    assert sum(t.length for t in turns) == pytest.approx(length, abs=1e-12)
    assert end.p == pytest.approx(to.p, abs=1e-9)
    assert end.R[:, 0] == pytest.approx(to.R[:, 0], abs=1e-8)
    if planar:
        assert not any(t.climb for t in turns)


def test_of_all_curves_it_is_one_that_bends_little():
    # The arc of a circle meets this gap, too, and bends least of all.
    radius, angle = 0.2, 1.2
    way = (radius * math.sin(angle), radius * (1 - math.cos(angle)), 0, 0, 0, angle)
    turns = completed(solve_gap(HERE, there(*way), radius * angle, True, 40.0))
    bends = np.array([t.bend for t in turns])
    assert bends == pytest.approx(np.full(len(turns), angle / len(turns)), abs=1e-4)


@pytest.mark.parametrize(
    ("way", "length", "planar", "words"),
    [
        ((0.2, 0, 0, 0, 0, 0), 0.2, True, "no more than its chord, 0.2000 m"),
        ((0.2, 0, 0.01, 0, 0, 0), 0.3, True, "cannot leave its plane"),
        ((0.2, 0.05, 0, 0, 0, 0.4), 0.24, True, "at most 5.00 can be followed"),
    ],
)
def test_a_gap_without_a_curve_is_refused_with_the_reason(way, length, planar, words):
    with pytest.raises(ValueError, match=words):
        completed(solve_gap(HERE, there(*way), length, planar, 5.0))


def test_a_gap_that_is_hard_to_solve_is_tried_from_more_starts():
    # With 3 % of slack in space most starts lead nowhere.
    to = there(0.37336094, -0.00335817, -0.09478011, -0.25818161, 0.77766373, -0.6136965)
    turns = completed(solve_gap(HERE, to, 0.395606, False, 10.4))
    end = Arcs.from_entrance(HERE, turns).end
    assert end.p == pytest.approx(to.p, abs=1e-9)
    assert max(math.hypot(t.bend, t.climb) / t.length for t in turns) < 10.4


def test_a_curve_of_least_bending_that_is_too_sharp_is_made_blunter():
    # With 3 % of slack its curvature is 21.5 1/m at the end, and little elsewhere.
    to, length = there(0.27519347, -0.05956401, 0, 0, 0, 0.68590562), 0.28993098
    turns = completed(solve_gap(HERE, to, length, True, 20.0))
    end = Arcs.from_entrance(HERE, turns).end
    assert end.p == pytest.approx(to.p, abs=1e-9)
    assert end.R[:, 0] == pytest.approx(to.R[:, 0], abs=1e-8)
    assert max(abs(t.bend) / t.length for t in turns) <= 20.0
