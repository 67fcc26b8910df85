"""The description of a cell for the console's page: frames, shapes, tunnels and meshes."""

import json
from io import BytesIO
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from laboratory.oracle.poses import Array
from laboratory.oracle.tunnel import Tunnel
from telerobot.config.load import load_cell, shipped
from telerobot.tools.operator.web.scene import TRIANGLES, describe, scene_of
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation


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


@pytest.mark.parametrize("name", ["snake", "snake_space", "snake_helix", "snake_gap"])
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


def test_planes_that_a_tool_stays_above_are_told_for_drawing(tmp_path):
    file = tmp_path / "planes.toml"
    file.write_text(
        'extends = "pa10"\nname = "planes"\n[avoidance]\nenabled = true\n'
        "tool_planes = [{ point = [0.5, 0.0, 0.3], normal = [0.0, 1.0, 2.0] }]\n"
    )
    (plane,) = describe(load_cell(file))["tool_planes"]
    assert plane == {"point": (0.5, 0.0, 0.3), "normal": (0.0, 1.0, 2.0)}


def test_names_of_links_stay_data(small):
    text = "<script>alert(1)</script>"
    escaped = text.replace("<", "&lt;").replace(">", "&gt;")
    small.replace_in_urdf('"finger"', f'"{escaped}"')
    names = [link["name"] for link in describe(load_cell(small.cell))["links"]]
    assert text in names


BALL = (
    '<collision><geometry><sphere radius="0.05"/></geometry></collision></link>\n<link name="l1">'
)
WEDGE = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.1]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def visual(small, filename, scale="1 1 1"):
    mesh = f'<visual><geometry><mesh filename="{filename}" scale="{scale}"/></geometry></visual>'
    return load_cell(small.replace_in_urdf(BALL, mesh + BALL))


def stored(small, name, mesh):
    path = small.urdf.parent / name
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh.export(path)
    return path


def parts_of(data):
    """Return corners (p, 3), triangles and own colour of each primitive that a page loads."""
    assert b'"images"' not in data, "a page's policy does not load the images of a mesh"
    found = []
    for part in trimesh.load_scene(BytesIO(data), file_type="glb").dump():
        material = getattr(part.visual, "material", None)
        own = material is not None and material.name == "own"
        colour = tuple(material.baseColorFactor[:3]) if own else None
        found.append((part.vertices, part.faces, colour))
    return found


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
    mesh = stored(small, "arm_description/meshes/a b.STL", trimesh.Trimesh(WEDGE, FACES))
    mesh.with_suffix(".step").write_text("solid a")
    scene = scene_of(visual(small, filename, "2 2 2"))
    (shape,) = scene.description["links"][0]["shapes"]
    if found:
        assert (shape["url"], shape["scale"]) == ("/meshes/0.glb", [2.0, 2.0, 2.0])
        ((corners, triangles, colour),) = parts_of(scene.files["/meshes/0.glb"])
        assert np.ptp(corners, axis=0) == pytest.approx([0.2, 0.2, 0.1])
        assert (len(triangles), colour) == (4, None)
        assert scene.description["missing"] == []
    else:
        assert shape["kind"] == "sphere", "the collision shape is drawn in its place"
        (missing,) = scene.description["missing"]
        assert (missing["link"], missing["mesh"]) == ("base", filename)
        assert missing["why"] == "not found" or "no mesh" in missing["why"]
        assert scene.files == {}


def collada(unit, parts):
    """Return a COLLADA file of wedges, each of a colour and at an x in the file's unit."""

    def effect(name, colour):
        phong = f"<diffuse><color>{colour} 1</color></diffuse>"
        return (
            f'<effect id="e{name}"><profile_COMMON><technique sid="t"><phong>{phong}</phong>'
            "</technique></profile_COMMON></effect>"
        )

    def geometry(name, x):
        corners = WEDGE / unit + [x, 0, 0]
        numbers = " ".join(map(str, corners.ravel()))
        axes = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
        corner = f'<input semantic="VERTEX" source="#v{name}" offset="0"/>'
        return (
            f'<geometry id="g{name}"><mesh><source id="p{name}">'
            f'<float_array id="a{name}" count="12">{numbers}</float_array><technique_common>'
            f'<accessor source="#a{name}" count="4" stride="3">{axes}</accessor>'
            f'</technique_common></source><vertices id="v{name}">'
            f'<input semantic="POSITION" source="#p{name}"/></vertices>'
            f'<triangles count="4" material="m">{corner}<p>{" ".join(map(str, FACES.ravel()))}</p>'
            "</triangles></mesh></geometry>"
        )

    def node(name):
        bound = f'<instance_material symbol="m" target="#m{name}"/>'
        return (
            f'<node id="n{name}"><instance_geometry url="#g{name}"><bind_material>'
            f"<technique_common>{bound}</technique_common></bind_material></instance_geometry></node>"
        )

    named = list(enumerate(parts))
    effects = "".join(effect(i, colour) for i, (colour, _) in named)
    materials = "".join(
        f'<material id="m{i}"><instance_effect url="#e{i}"/></material>' for i, _ in named
    )
    return (
        '<?xml version="1.0"?>'
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f'<asset><unit meter="{unit}"/><up_axis>Y_UP</up_axis></asset>'
        f"<library_effects>{effects}</library_effects>"
        f"<library_materials>{materials}</library_materials><library_geometries>"
        f"{''.join(geometry(i, x) for i, (_, x) in named)}</library_geometries>"
        f'<library_visual_scenes><visual_scene id="s">{"".join(node(i) for i, _ in named)}'
        '</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>'
        "</COLLADA>"
    )


def test_a_collada_mesh_keeps_its_unit_and_its_colours_and_is_not_turned(small):
    text = collada(0.001, [("1 0 0", 0.0), ("0 0 1", 1000.0)])
    (small.urdf.parent / "link.dae").write_text(text)
    scene = scene_of(visual(small, "link.dae"))
    found = {colour: corners for corners, _, colour in parts_of(scene.files["/meshes/0.glb"])}
    assert found.keys() == {(255, 0, 0), (0, 0, 255)}
    least, most = (pick(found[0, 0, 255], axis=0) for pick in (np.min, np.max))
    assert least == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)
    assert most == pytest.approx([1.2, 0.2, 0.1], abs=1e-6)


def test_meshes_of_a_cell_are_coarsened_to_a_bound_together(small):
    ball = trimesh.creation.icosphere(subdivisions=7, radius=0.1)
    stored(small, "ball.stl", ball)
    assert len(ball.faces) > TRIANGLES
    ((corners, triangles, _),) = parts_of(
        scene_of(visual(small, "ball.stl")).files["/meshes/0.glb"]
    )
    assert 0.9 * TRIANGLES < len(triangles) <= TRIANGLES
    assert np.linalg.norm(corners, axis=1) == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize("whole", [True, False], ids=["whole", "in pieces"])
def test_a_recording_of_an_arm_with_meshes_is_at_most_three_megabytes_larger(
    small, tmp_path, whole
):
    """However fine they are: the run's messages are the same, so that any length shows it."""
    ball = trimesh.creation.icosphere(subdivisions=7, radius=0.1)
    if not whole:  # no two triangles share a corner, as in many a CAD export
        ball = trimesh.Trimesh(ball.vertices[ball.faces].reshape(-1, 3), process=False,
                               faces=np.arange(3 * len(ball.faces)).reshape(-1, 3))  # fmt: skip
        ball.vertices += 1e-6 * np.repeat(np.arange(len(ball.faces)) % 7, 3)[:, None]
    stored(small, "ball.stl", ball)

    def recorded(cell):
        Simulation(cell, Script(duration_s=0.3), tmp_path / "run.mcap").run()
        return (tmp_path / "run.mcap").stat().st_size

    bare = recorded(load_cell(small.cell))
    assert 0.5e6 < recorded(visual(small, "ball.stl")) - bare <= 3.0e6


def test_capsules_stand_for_a_link_that_has_nothing_else_to_draw(small):
    mesh = '<visual><geometry><mesh filename="none.stl"/></geometry></visual>'
    small.replace_in_urdf(BALL, mesh + '</link>\n<link name="l1">')
    capsule = 'link = "base"\nstart = [0, 0, 0.1]\nend = [0.2, 0, 0.1]\nradius = 0.04\n'
    text = small.cell.read_text()
    small.cell.write_text(f"{text}\n[[avoidance.capsules]]\n{capsule}")
    (shape,) = describe(load_cell(small.cell))["links"][0]["shapes"]
    assert (shape["kind"], shape["radius"], shape["length"]) == ("capsule", 0.04, 0.2)
    assert shape["pose"][:3] == pytest.approx([0.1, 0.0, 0.1])


def test_a_contours_plane_begins_at_the_arms_foot(described):
    assert list(described("rover_bridge")["foot"]) == [0.2, 0.0, 0.5]
    assert described("pa10")["foot"] is None


def _farthest(points: Array, line: Array) -> float:
    return max(float(np.linalg.norm(line - point, axis=1).min()) for point in points)
