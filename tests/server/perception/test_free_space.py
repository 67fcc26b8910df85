"""A tunnel is found between obstacles, or refused with its narrowest place."""

import re

import numpy as np
import pytest
from laboratory.oracle.tunnel import Tunnel
from telerobot.config.load import load_cell
from telerobot.config.schema.surroundings import ObstacleSection
from telerobot.server.control.backbone.curve import told_section
from telerobot.server.control.inputs import ToldTunnel
from telerobot.server.control.proximity.distance import apart
from telerobot.server.events import Events
from telerobot.server.perception.free_space import NoTunnelError, find_tunnel, standing
from telerobot.server.perception.obstacle_map import ObstacleMap

END = (0.05, 1.3, 0.0)


def box(name, xyz, half_size, **more):
    return ObstacleSection(name=name, shape="box", xyz=xyz, half_size=half_size, **more)


def sphere(name, xyz, radius, **more):
    return ObstacleSection(name=name, shape="sphere", xyz=xyz, radius=radius, **more)


def scene_of(obstacles, clearance=0.02):
    return ObstacleMap(tuple(obstacles), (), clearance, 0.01, Events()).scene(0)


def found_in(cell, to, obstacles=None):
    """Return a tunnel between obstacles: those of the cell unless others are given."""
    known = cell.config.obstacles if obstacles is None else obstacles
    return find_tunnel(cell, to, scene_of(known, cell.config.avoidance.clearance))


def line_of(cell, found):
    """Return the centre line (k, 3) of a tunnel, integrated by the oracle."""
    section = told_section(cell.config.mechanism.backbone, ToldTunnel(found.pieces))
    return Tunnel(section).points


def off_boxes(points, boxes):
    """Return the distances of points (m, 3) from boxes along World's axes [m]."""
    each = [np.maximum(np.abs(points - o.xyz) - o.half_size, 0.0) for o in boxes]
    return np.min([np.linalg.norm(off, axis=1) for off in each], axis=0)


@pytest.fixture(scope="module")
def boxes():
    return load_cell("snake_boxes")


def moved(cell, **places):
    """Return the obstacles of a cell, some of them elsewhere along x [m]."""
    return [
        o.model_copy(update={"xyz": (places.get(o.name, o.xyz[0]), *o.xyz[1:])})
        for o in cell.config.obstacles
    ]


def test_between_shelves_it_has_room_for_its_walls_everywhere_and_ends_at_the_place(boxes):
    found = found_in(boxes, END)
    line = line_of(boxes, found)
    assert found.narrowest >= boxes.config.mechanism.backbone.half_width
    # Links are promised 2 mm more than what they keep from walls.
    assert off_boxes(line, boxes.config.obstacles).min() == pytest.approx(
        found.narrowest + 0.002, abs=5e-4
    )
    assert np.linalg.norm(line[-1] - END) < 0.03
    assert np.linalg.norm(line[-1] - found.end) < 1e-5
    assert found.clearance > 0.02
    assert found.nearest in {o.name for o in boxes.config.obstacles}


def test_where_it_is_too_narrow_it_names_the_narrowest_place_and_its_room(boxes):
    # The first opening is 0.05 m wide: 23 mm from either side, less what is promised more.
    with pytest.raises(NoTunnelError) as refused:
        found_in(boxes, END, moved(boxes, first_right=0.29))
    told = re.search(r"is (\S+) m from obstacles at \((.*), (.*), .*\): a tunnel needs 0.03 m",
                     str(refused.value))  # fmt: skip
    room, x, y = (float(number) for number in told.groups())
    assert room == pytest.approx(0.023, abs=0.004)
    assert -0.01 < x < 0.04
    assert 0.73 < y < 0.79


def test_an_opening_that_is_hardly_wider_is_passed_and_one_that_is_hardly_narrower_is_not(boxes):
    # Tunnel and clearance need 64 mm; the opening is 70 mm wide, then 62.
    obstacles = moved(boxes, first_right=0.31)
    line = line_of(boxes, found_in(boxes, END, obstacles))
    assert off_boxes(line, obstacles).min() >= 0.032 - 1e-4
    with pytest.raises(NoTunnelError, match=r"is 0\.02\d+ m from obstacles at .*; no curve of"):
        found_in(boxes, END, moved(boxes, first_right=0.302))


@pytest.mark.parametrize(
    ("to", "words"),
    [
        ((0.05, 0.5, 0.0), "must lie in the arm's plane, ahead of the entrance"),
        ((0.05, 1.0, 0.2), "must lie in the arm's plane, ahead of the entrance"),
        ((0.05, 1.6, 0.0), "it is 1.001 m from the entrance: the arm goes in by at most 0.870 m"),
        ((0.30, 1.3, 0.0), "leads there within 0.870 m, which is how far the arm goes in"),
        ((0.25, 0.97, 0.0), "it lies in 'second_right', 0.0300 m from its surface"),
    ],
)
def test_a_place_that_no_tunnel_leads_to_is_refused_with_the_reason(boxes, to, words):
    with pytest.raises(NoTunnelError, match=re.escape(words)):
        found_in(boxes, to)


def test_an_arm_without_a_backbone_has_no_tunnel():
    with pytest.raises(NoTunnelError, match="no backbone"):
        found_in(load_cell("pa10"), END)


def test_an_obstacle_that_the_free_part_bows_out_to_is_seen(boxes):
    # The free part bows out beside the way to the entrance, by up to 0.4 m with the tip inside.
    beside = [box(f"post_{side}", (x, 0.3, 0.0), (0.02, 0.02, 0.05))
              for side, x in (("left", -0.36), ("right", 0.36))]  # fmt: skip
    with pytest.raises(NoTunnelError, match=r"links would come to .* of 'post_.*' with the tip"):
        found_in(boxes, END, [*boxes.config.obstacles, *beside])


def test_in_space_it_leaves_the_plane_for_what_lies_across_it():
    cell = load_cell("snake_told")
    across = [
        sphere("ball", (0.02, 0.85, 0.0), 0.1, clearance=0.005),
        ObstacleSection(name="bar", shape="capsule", xyz=(-0.3, 1.05, 0.1), to=(0.3, 1.05, 0.1),
                        radius=0.08, clearance=0.005),
    ]  # fmt: skip
    found = found_in(cell, (0.0, 1.28, 0.05), across)
    line = line_of(cell, found)
    assert any(climb for _, _, climb, _ in found.pieces)
    assert (np.linalg.norm(line - across[0].xyz, axis=1) - 0.1).min() >= 0.03
    ahead = np.abs(line[:, 0]) < 0.3
    assert (np.hypot(line[ahead, 1] - 1.05, line[ahead, 2] - 0.1) - 0.08).min() >= 0.03
    assert found.clearance > 0.005


def test_distances_are_those_of_the_surfaces():
    turned = box("box", (0.1, -0.2, 0.3), (0.3, 0.1, 0.2), rpy=(0.4, -0.7, 1.1))
    rod = ObstacleSection(
        name="rod", shape="capsule", xyz=(0.0, 0.0, 0.0), to=(0.3, 0.4, 0.1), radius=0.05
    )
    soft = sphere("soft", (0.0, 0.0, 0.0), 9.0, hard=False)
    sight = ObstacleSection(name="sight", shape="sight_line", xyz=(0, 0, 0), to=(1, 0, 0))
    solid = standing(scene_of([turned, rod, soft, sight]))
    assert solid.names == ("rod", "box")
    random = np.random.default_rng(4)
    points = random.uniform(-1.0, 1.0, (40, 3))
    R = _rotation(0.4, -0.7, 1.1)
    faces = np.clip(random.uniform(-1.4, 1.4, (60_000, 3)), -1.0, 1.0)
    inside = faces * turned.half_size @ R.T + turned.xyz
    line = np.linspace(rod.xyz, rod.to, 4001)
    for point, (to_rod, to_box) in zip(points, apart(points, solid).distance, strict=True):
        sampled = float(np.linalg.norm(inside - point, axis=1).min())
        assert abs(to_box) == pytest.approx(sampled, abs=0.01)
        assert to_rod == pytest.approx(np.linalg.norm(line - point, axis=1).min() - 0.05, abs=1e-5)
    assert apart(np.array([turned.xyz]), solid).distance[0, 1] == pytest.approx(-0.1)


def test_a_sight_line_that_is_hard_and_what_may_move_are_solids_where_they_are_now():
    line = ObstacleSection(
        name="line", shape="sight_line", xyz=(0, 0, 0), to=(1, 0, 0), radius=0.1, hard=True
    )
    solid = standing(scene_of([line, sphere("mover", (0.0, 2.0, 0.0), 0.3, max_speed=1.0)]))
    off = dict(zip(solid.names, apart(np.array([[0.5, 1.0, 0.0]]), solid).distance[0], strict=True))
    assert off == pytest.approx({"line": 0.9, "mover": 5**0.5 / 2 - 0.3})


def _rotation(roll, pitch, yaw):
    def about(axis, angle):
        K = np.cross(np.eye(3), axis)
        return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K

    x, y, z = np.eye(3)
    return about(z, yaw) @ about(y, pitch) @ about(x, roll)
