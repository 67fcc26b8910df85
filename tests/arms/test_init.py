"""Any serial URDF becomes a cell that moves, as it is."""

import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from laboratory.campaign.urdfs import trial
from laboratory.campaign.urdfs.collection import published
from laboratory.campaign.urdfs.trial import try_arm
from laboratory.equipment.arms import read_arm
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell
from telerobot.config.urdf.shapes import LinkMesh, hull_of, link_shape
from telerobot.tools.cli import main
from telerobot.tools.init.capsules import fit
from telerobot.tools.init.draft import bound, path_from, range_of
from telerobot.tools.init.make import make
from telerobot.tools.init.robot import carried_mass
from telerobot.tools.scripts.script import Expected
from telerobot.tools.simulation.simulation import Result


def refusal(urdf, tip=None):
    with pytest.raises(ConfigError) as caught:
        read_arm(urdf, tip, {})
    return caught.value.messages


def test_an_odd_arm_goes_from_its_urdf_to_motion(odd):
    """Capitals, slashes, dots and blanks; a floating root; mimic fingers; no inertia of a link; no
    limits of a joint; meshes in millimetres: a push, a clearance and a pose, without an edit."""
    odd.replace('<mass value="0.8"/>', '<mass value="0"/>')
    odd.replace('lower="-3.0" upper="3.0" velocity="2" effort="150"', "")
    found = try_arm("odd", odd.write())
    assert found.reasons == []
    assert found.joints == 6


def test_a_run_that_misses_what_its_script_expects_speaks_against_the_arm(odd, monkeypatch):
    figures = {
        "failure": None, "limit_violations": 0, "own_contact_n": 0.0, "events": [],
        "contact_force_n": 10.0, "tool_error_m": 0.0, "min_clearance_m": trial.CLEARANCE,
    }  # fmt: skip
    refused = Expected("refused", "at most 0", 3, met=False)
    run = Result(figures, (SimpleNamespace(limits=()),), (), (refused,))
    monkeypatch.setattr(trial, "simulate", lambda *_: run)
    found = try_arm("odd", odd.write()).reasons
    assert "push: refused: 3, at most 0 is expected" in found


# The first is strong, friction takes much of what the second has, and the third has below 1 N·m.
@pytest.mark.parametrize(
    "name", ["iiwa", "z1", "hextilt"]
)  # all of them: make campaign ARGS="--only urdf"
def test_a_published_arm_goes_from_its_urdf_to_motion(name):
    urdf = next((arm.urdf for arm in published() if arm.name == name), None)
    if urdf is None:
        pytest.skip(f"{name}: its description is not installed: pip install 'telerobot[arms]'")
    assert try_arm(name, urdf).reasons == []


def test_init_writes_a_cell_that_says_what_must_be_confirmed(odd, tmp_path, capsys):
    urdf, out = (
        odd.replace('<mass value="0.8"/>', '<mass value="0"/>').write(),
        tmp_path / "my.toml",
    )
    assert main(["init", str(urdf), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "Link_5: mass" in said
    assert "a gripper, no joints of the arm: left_finger_joint, right_finger_joint" in said
    text = out.read_text()
    for confirmed in ("tip_link", "T_wrist_mrf", "[mechanism.postures]", "[[mechanism.inertials]]"):
        before = text[: text.index(confirmed)].splitlines()[-4:]
        assert any("CONFIRM" in line for line in before) or confirmed.startswith("[mechanism.p")
    cell = load_cell(out)
    assert cell.joints == (
        "Shoulder/Pan",
        "Link_2",
        "elbow.flex",
        "Forearm Roll",
        "WRIST-pitch",
        "j6",
    )
    assert main(["init", str(urdf), "--out", str(out)]) == 2
    assert "is there already" in capsys.readouterr().err


def test_every_mesh_that_is_missing_is_named_with_its_link(odd):
    urdf = odd.write()
    for path in (odd.folder / "meshes").iterdir():
        path.unlink()
    told = refusal(urdf)
    assert len(told) == 6
    assert all(f"link 'Link_{i}'" in line for i, line in enumerate(told, start=1))
    assert "value 'package://odd_description/meshes/link1.stl': no such file" in told[0]


def test_a_package_elsewhere_is_found_where_it_is_said(odd, tmp_path, monkeypatch):
    urdf = odd.write()
    (odd.folder / "meshes").rename(tmp_path / "meshes")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "meshes").rename(tmp_path / "elsewhere" / "meshes")
    assert read_arm(urdf, None, {"odd_description": tmp_path / "elsewhere"}).fits
    (tmp_path / "ws").mkdir()
    (tmp_path / "elsewhere").rename(tmp_path / "ws" / "odd_description")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ws"))
    assert read_arm(urdf, None, {}).fits


@pytest.mark.parametrize("suffix", ["stl", "obj", "dae"])
def test_meshes_of_all_formats_are_read_in_metres(odd, suffix):
    odd.mesh, odd.scale = f"../meshes/link{{i}}.{suffix}", 1.0
    arm = read_arm(odd.write(), None, {})
    link = next(e for e in arm.root.findall("link") if e.get("name") == "Link_2")
    shape = link_shape(link, arm.urdf, {})
    assert shape is not None
    assert np.ptp(shape.triangles.reshape(-1, 3), axis=0) == pytest.approx([0.06, 0.05, 0.3])


def test_meshes_in_millimetres_without_their_scale_are_told(odd):
    odd.replace('scale="0.001 0.001 0.001"', "")
    assert all("meshes in millimetres have" in line for line in refusal(odd.write()))


def test_xacro_is_refused_with_what_to_run(odd):
    odd.replace(
        '<robot name="odd">', '<robot name="odd" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    )
    odd.replace('<link name="Flange"/>', '<link name="Flange"/><xacro:include filename="a"/>')
    assert "expand them first, with `xacro Odd Arm.urdf > " in refusal(odd.write())[0]


def test_fingers_are_no_part_of_the_arm_and_the_tip_can_be_said(odd):
    urdf = odd.write()
    assert read_arm(urdf, None, {}).tip == "Flange"
    assert [j.get("name") for j in read_arm(urdf, "Link_3", {}).chain][-1] == "elbow.flex"
    assert "did you mean 'Link_3'?" in refusal(urdf, "Link3")[0]


def test_two_arms_in_one_file_ask_for_the_tip(odd):
    joint = (
        '<joint name="b{i}" type="revolute"><parent link="{above}"/><child link="B_{i}"/></joint>'
    )
    second = [joint.format(i=i, above="Base" if i == 0 else f"B_{i - 1}") for i in range(4)]
    second += [f'<link name="B_{i}"/>' for i in range(4)]
    odd.replace('<link name="Flange"/>', '<link name="Flange"/>' + "".join(second))
    told = refusal(odd.write())[0]
    assert "link 'Base' carries 2 chains of joints" in told
    assert "--tip LINK: one of B_3, " in told


def _blob(seed, count=60):
    """Return triangles (t, 3, 3) of no particular shape: an L of scattered corners."""
    draw = np.random.default_rng(seed)
    size = draw.uniform(0.02, 0.4, 3)
    corners = draw.uniform(-0.5, 0.5, (count, 3, 3)) * size
    corners[: count // 2] += [size[0], 0.0, draw.uniform(0.0, 0.3)]
    return corners


@pytest.mark.parametrize("seed", range(4))
def test_capsules_hold_every_point_of_the_shape(seed):
    triangles = _blob(seed)
    found = fit(LinkMesh("link", triangles, False))
    assert 1 <= len(found.tubes) <= 3
    part = np.random.default_rng(seed).dirichlet([0.3, 0.3, 0.3], (len(triangles), 200))
    points = np.einsum("tsk,tkx->tsx", part, triangles).reshape(-1, 3)
    assert np.any([tube.holds(points) for tube in found.tubes], axis=0).all()


PRIMITIVES = {
    "capsule": '<capsule radius="0.05" length="0.3"/>',
    "cylinder": '<cylinder radius="0.2" length="0.02"/>',
    "sphere": '<sphere radius="0.1"/>',
    "plate": '<box size="0.3 0.2 0.03"/>',
}


def looked_at(primitive):
    """Return the shape of a link that only has that to look at, tilted."""
    link = ET.fromstring(
        '<link name="link"><visual><origin xyz="0.1 0 0.2" rpy="0.3 0.9 -0.4"/><geometry>'
        f"{PRIMITIVES[primitive]}</geometry></visual></link>"
    )
    shape = link_shape(link, Path("arm.urdf"), {})
    assert shape is not None
    return shape


@pytest.mark.parametrize("primitive", PRIMITIVES)
def test_capsules_hold_the_whole_surface_of_a_primitive(primitive):
    """Cut into pieces, it must not lose what lies between corners."""
    triangles = looked_at(primitive).triangles
    found = fit(LinkMesh("link", triangles, True))
    part = np.random.default_rng(0).dirichlet([0.6, 0.6, 0.6], (len(triangles), 100))
    points = np.einsum("tsk,tkx->tsx", part, triangles).reshape(-1, 3)
    assert np.any([tube.holds(points) for tube in found.tubes], axis=0).all()
    # The surface is closed: its signed volume is the solid's.
    a, b, c = np.moveaxis(triangles - triangles.mean(axis=(0, 1)), 1, 0)
    solid = np.abs(np.einsum("ti,ti->t", a, np.cross(b, c))).sum() / 6.0
    hull = hull_of(triangles.reshape(-1, 3))
    assert hull is not None
    assert solid == pytest.approx(hull.volume, rel=1e-6)


def test_a_capsule_is_found_as_tight_as_it_is():
    found = fit(looked_at("capsule"))
    assert len(found.tubes) == 1
    assert found.tubes[0].radius == pytest.approx(0.051, abs=1e-3)
    assert found.ratio < 1.15


def test_a_third_capsule_is_looked_for_where_a_second_does_not_pay():
    found = fit(looked_at("plate"))
    assert len(found.tubes) == 3
    assert found.ratio < 3.5  # one alone: 7.4


@pytest.mark.parametrize("value", [147.6999, 12.0, 0.43217, 99999.0, 3.0])
def test_a_bound_is_never_rounded_up(value):
    assert 0.999 * value < float(bound(value)) <= value


def test_a_cell_names_its_urdf_from_where_it_stands_so_that_both_can_move(tmp_path):
    urdf = tmp_path / "robots" / "arm.urdf"
    cells = tmp_path / "cells"
    for folder in (urdf.parent, cells):
        folder.mkdir()
    urdf.touch()
    assert path_from(cells, urdf) == "../robots/arm.urdf"
    assert path_from(tmp_path, urdf) == "./robots/arm.urdf"
    assert path_from(Path("/proc"), urdf) == str(urdf)


def test_postures_keep_away_from_the_ends_of_joints_and_payloads_follow_the_drives(odd, tmp_path):
    """A torque that no arm of this weight can mean is doubted, and rates no payload beyond it."""
    odd.replace('effort="150"', 'effort="1e4"')
    arm = read_arm(odd.write(), None, {})
    made = make(arm, tmp_path / "odd.toml")
    for q in made.draft.postures.values():
        for angle, joint, drive in zip(q, arm.chain, made.draft.drives, strict=True):
            endless = joint.get("type") == "continuous"
            low, high = (-np.pi, np.pi) if endless else range_of(joint, drive)
            low, high = max(low, -np.pi), min(high, np.pi)
            assert abs(angle - 0.5 * (low + high)) < 0.85 * 0.5 * (high - low)
    doubted = [note for drive in made.draft.drives for note in drive.notes if "is it meant" in note]
    assert doubted
    assert made.draft.payload <= made.draft.rated <= carried_mass(arm)
