"""The description of a cell for the console's page: frames, shapes, tunnels and meshes."""

import json
from itertools import pairwise

import numpy as np
import pytest
from telerobot.config.load import load_cell, shipped
from telerobot.tools.operator.web.scene import describe, mesh_files
from telerobot.tools.oracle.poses import Array
from telerobot.tools.oracle.tunnel import Tunnel


@pytest.mark.parametrize("name", shipped("cells"))
def test_every_shipped_cell_is_described_in_the_order_of_its_joints(described, name):
    told = json.loads(json.dumps(described(name), allow_nan=False))
    joints = [joint["name"] for joint in told["joints"]]
    assert joints == list(load_cell(name).joints)
    moved = [link["joint"] for link in told["links"] if link["joint"] >= 0]
    assert sorted(moved) == list(range(len(joints)))
    assert all(link["parent"] < i for i, link in enumerate(told["links"]))
    assert any(link["shapes"] for link in told["links"])
    quaternions = [link["pose"][3:] for link in told["links"]]
    assert np.linalg.norm(quaternions, axis=1) == pytest.approx(1.0)


def test_tasks_name_the_links_that_carry_their_tools():
    told = describe(load_cell("pa10_pair"))
    tips = [told["links"][task["tip"]]["name"] for task in told["tasks"]]
    assert [task["name"] for task in told["tasks"]] == ["left", "right", "beam"]
    assert tips == ["left.flange", "right.flange", "left.flange"]


def test_links_have_the_capsules_that_clearances_are_kept_by():
    told = describe(load_cell("ur5e_scene"))
    tool = [c for link in told["links"] for c in link["capsules"] if c["of"] == "flange"]
    assert [capsule["radius"] for capsule in tool] == [0.012]


@pytest.mark.parametrize("name", ["snake", "snake_space", "snake_gap"])
def test_tunnels_are_drawn_where_their_centre_line_is(name):
    cell = load_cell(name)
    (tunnel,) = describe(cell)["tunnels"]
    frames = np.array([frame for piece in tunnel["pieces"] for frame in piece])
    line = Tunnel(cell.config.mechanism.backbone).points
    assert _farthest(frames[:, :3], line) < 0.004  # half of either's steps, along the line
    ends = (line[0], line[-1]) if len(tunnel["pieces"]) == 1 else (line[0],)
    for end in ends:
        assert np.linalg.norm(frames[:, :3] - end, axis=1).min() < 1e-5
    for piece in tunnel["pieces"]:
        for one, after in pairwise(np.array(piece)):
            tangent = np.cross(one[3:6], one[6:9])
            assert (after[:3] - one[:3]) @ tangent > 0.0


def test_a_bridge_stands_where_the_rig_has_it(described):
    bridge = load_cell("rover_bridge").config.rig.bridge
    boxes = {box["name"]: box for box in described("rover_bridge")["rig"]["boxes"]}
    (left, right, beam) = (boxes[f"bridge_{name}"] for name in ("left", "right", "beam"))
    assert beam["pose"][2] - beam["half_size"][2] == pytest.approx(bridge.height)
    assert beam["pose"][0] - beam["half_size"][0] == pytest.approx(bridge.distance)
    inner = left["pose"][1] - left["half_size"][1], right["pose"][1] + right["half_size"][1]
    assert inner[0] - inner[1] == pytest.approx(bridge.width)
    assert left["half_size"][2] == right["half_size"][2] == pytest.approx(0.5 * bridge.height)


def test_names_of_links_stay_data(small):
    text = "<script>alert(1)</script>"
    escaped = text.replace("<", "&lt;").replace(">", "&gt;")
    small.replace_in_urdf('"finger"', f'"{escaped}"')
    names = [link["name"] for link in describe(load_cell(small.cell))["links"]]
    assert text in names


BALL = (
    '<collision><geometry><sphere radius="0.05"/></geometry></collision></link>\n<link name="l1">'
)


@pytest.mark.parametrize(
    ("filename", "found"),
    [
        ("package://arm_description/meshes/a b.STL", True),
        ("meshes/a b.STL", False),
        ("arm_description/meshes/a b.STL", True),
        ("package://arm_description/meshes/a b.step", False),
        ("package://none/a b.STL", False),
    ],
)
def test_meshes_are_asked_for_by_number_and_others_are_not_served(small, filename, found):
    mesh = small.urdf.parent / "arm_description" / "meshes" / "a b.STL"
    mesh.parent.mkdir(parents=True)
    for file in (mesh, mesh.with_suffix(".step")):
        file.write_text("solid a\nendsolid a\n")
    visual = f'<visual><geometry><mesh filename="{filename}" scale="2 2 2"/></geometry></visual>'
    cell = load_cell(small.replace_in_urdf(BALL, visual + BALL))
    (shape,) = describe(cell)["links"][0]["shapes"]
    if found:
        assert (shape["url"], shape["scale"]) == ("/meshes/0.stl", [2.0, 2.0, 2.0])
        assert mesh_files(cell) == {"/meshes/0.stl": mesh.resolve()}
    else:
        assert shape["kind"] == "sphere", "the collision shape is drawn in its place"
        assert mesh_files(cell) == {}


def test_a_contours_plane_begins_at_the_arms_foot(described):
    assert list(described("rover_bridge")["foot"]) == [0.2, 0.0, 0.5]
    assert described("pa10")["foot"] is None


def _farthest(points: Array, line: Array) -> float:
    return max(float(np.linalg.norm(line - point, axis=1).min()) for point in points)
