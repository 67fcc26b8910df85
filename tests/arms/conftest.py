"""Robot descriptions with the quirks that published ones have, small enough to write down."""

from pathlib import Path

import pytest

CORNERS = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.0, 1.0)]
FACES = [
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
]  # fmt: skip


def write_stl(path: Path, size: tuple[float, float, float]) -> None:
    """Write a box that stands on z = 0, as ASCII STL."""
    lines = ["solid box"]
    for face in FACES:
        corners = [tuple(c * s for c, s in zip(CORNERS[i], size, strict=True)) for i in face]
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in corners]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid box", ""]))


def write_obj(path: Path, size: tuple[float, float, float]) -> None:
    """Write the same box as OBJ."""
    corners = [" ".join(str(c * s) for c, s in zip(p, size, strict=True)) for p in CORNERS]
    faces = [" ".join(str(i + 1) for i in face) for face in FACES]
    path.write_text("\n".join([*(f"v {c}" for c in corners), *(f"f {f}" for f in faces), ""]))


def write_dae(path: Path, size: tuple[float, float, float]) -> None:
    """Write the same box as COLLADA in centimetres."""
    numbers = " ".join(str(100 * c * s) for p in CORNERS for c, s in zip(p, size, strict=True))
    index = " ".join(str(i) for face in FACES for i in face)
    path.write_text(
        f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="centimeter" meter="0.01"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="box"><mesh>
<source id="p"><float_array id="pa" count="{3 * len(CORNERS)}">{numbers}</float_array>
<technique_common><accessor source="#pa" count="{len(CORNERS)}" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="{len(FACES)}"><input semantic="VERTEX" source="#v" offset="0"/><p>{index}</p>
</triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#box"/></node>
</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""
    )


WRITERS = {".stl": write_stl, ".obj": write_obj, ".dae": write_dae}
JOINTS = [
    # name, type, axis, from the last joint [m], lower, upper, mass
    ("Shoulder/Pan", "revolute", "0 0 1", 0.10, -2.9, 2.9, 3.0),
    ("Link_2", "revolute", "0 1 0", 0.12, -2.0, 2.0, 3.0),
    ("elbow.flex", "revolute", "0 1 0", 0.30, -2.4, 2.4, 2.0),
    ("Forearm Roll", "continuous", "0 0 1", 0.14, 0.0, 0.0, 1.0),
    ("WRIST-pitch", "revolute", "0 1 0", 0.14, -2.0, 2.0, 0.8),
    ("j6", "revolute", "0 0 1", 0.08, -3.0, 3.0, 0.4),
]


class OddArm:
    """Files of one arm; what is asked for is changed in the text."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.urdf = folder / "robots" / "Odd Arm.urdf"
        self.urdf.parent.mkdir()
        (folder / "meshes").mkdir()
        self.mesh = "package://odd_description/meshes/link{i}.stl"
        self.joints = list(JOINTS)
        self.scale = 0.001
        self.changes: list[tuple[str, str]] = []

    def replace(self, old: str, new: str) -> "OddArm":
        """Replace a text of the URDF; it has to be there."""
        self.changes.append((old, new))
        return self

    def write(self) -> Path:
        """Write URDF and meshes, as `odd_description/robots` and `odd_description/meshes`."""
        parts = ['<robot name="odd"><link name="world"/>']
        parts += ['<joint name="to_base" type="floating"><parent link="world"/>']
        parts += ['<child link="Base"/></joint>', _link("Base", None, 4.0, 1.0, 0.1)]
        above = "Base"
        for i, (name, kind, axis, up, lower, upper, mass) in enumerate(self.joints, start=1):
            link = f"Link_{i}"
            long = self.joints[i][3] if i < len(self.joints) else 0.05
            path = self.folder / self.mesh.format(i=i).removeprefix("package://odd_description/")
            path = path if "package" in self.mesh else self.urdf.parent / self.mesh.format(i=i)
            size = tuple(s / self.scale for s in (0.06, 0.05, long))
            WRITERS[path.suffix](path, size)
            limit = f'<limit lower="{lower}" upper="{upper}" velocity="2" effort="150"/>'
            parts += [
                f'<joint name="{name}" type="{kind}"><parent link="{above}"/><child link="{link}"/>'
                f'<origin xyz="0 0 {up}"/><axis xyz="{axis}"/>{limit}</joint>',
                _link(link, self.mesh.format(i=i), mass, self.scale, long),
            ]
            above = link
        parts += ['<joint name="flange_joint" type="fixed"><parent link="Link_6"/>']
        parts += ['<child link="Flange"/><origin xyz="0 0 0.05"/></joint><link name="Flange"/>']
        for side, sign in (("left", 1), ("right", -1)):
            mimic = '<mimic joint="left_finger_joint"/>' if side == "right" else ""
            parts += [
                f'<joint name="{side}_finger_joint" type="prismatic"><parent link="Flange"/>'
                f'<child link="{side}_finger"/><origin xyz="0 {0.02 * sign} 0.02"/>'
                f'<axis xyz="0 {sign} 0"/>{mimic}<limit lower="0" upper="0.02" velocity="0.1" '
                f'effort="20"/></joint>',
                f'<link name="{side}_finger">{_inertial(0.05, 0.02)}<collision><geometry>'
                '<box size="0.01 0.01 0.04"/></geometry></collision></link>',
            ]
        text = "\n".join([*parts, "</robot>"])
        for old, new in self.changes:
            assert old in text, old
            text = text.replace(old, new)
        self.urdf.write_text(text)
        return self.urdf


def _inertial(mass: float, long: float) -> str:
    moment = mass * (long**2 / 12 + 0.001)
    return (
        f'<inertial><origin xyz="0 0 {long / 2}"/><mass value="{mass}"/><inertia ixx="{moment}" '
        f'ixy="0" ixz="0" iyy="{moment}" iyz="0" izz="{mass * 0.001}"/></inertial>'
    )


def _link(name: str, mesh: str | None, mass: float, scale: float, long: float) -> str:
    if mesh is None:
        shape = '<cylinder radius="0.06" length="0.1"/>'
    else:
        shape = f'<mesh filename="{mesh}" scale="{scale} {scale} {scale}"/>'
    collision = f"<collision><geometry>{shape}</geometry></collision>"
    return f'<link name="{name}">{_inertial(mass, long)}{collision}</link>'


@pytest.fixture
def odd(tmp_path: Path) -> OddArm:
    """Return an arm with capitals, slashes, dots, a floating root, mimic fingers, mm meshes."""
    folder = tmp_path / "odd_description"
    folder.mkdir()
    return OddArm(folder)
