"""What the page draws: links, shapes, meshes and surroundings of a cell, as JSON and glTF."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from ....config.drives import joint_bounds
from ....config.load import Cell, ConfigError
from ....config.schema.section import PoseSection
from ....config.schema.sources import SOURCES
from ....config.schema.surroundings import RigTagSection
from ....config.urdf.elements import end_of
from ....config.urdf.meshes import find_mesh, read_mesh
from ....drivers.device import DeviceError
from ....server.control.backbone.curve import centre_line
from ....server.control.forest import Forest
from ....server.control.proximity.capsules import fitted
from ....server.control.spatial import Pose
from ....server.control.task.task import FRAMES

if TYPE_CHECKING:
    import trimesh


# --- Poses as the page has them: `[x, y, z, qx, qy, qz, qw]`, translation and unit quaternion -----
Seven = list[float]  # x, y, z [m] and the unit quaternion qx, qy, qz, qw of one frame in another

IDENTITY: Seven = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


def seven(xyz: Sequence[float], rpy: Sequence[float]) -> Seven:
    """Return the pose of a translation [m] and fixed-axis roll, pitch, yaw [rad]."""
    (a, b, c), (d, e, f) = zip(*((math.cos(x / 2), math.sin(x / 2)) for x in rpy), strict=True)
    return [
        *(float(x) for x in xyz),
        d * b * c - a * e * f,
        a * e * c + d * b * f,
        a * b * f - d * e * c,
        a * b * c + d * e * f,
    ]


def of_pose(pose: PoseSection) -> Seven:
    """Return a pose of the cell file."""
    return seven(pose.xyz, pose.rpy)


def of_origin(element: ET.Element) -> Seven:
    """Return what a URDF element's `<origin>` gives."""
    origin = element.find("origin")
    if origin is None:
        return list(IDENTITY)
    return seven(three(origin, "xyz"), three(origin, "rpy"))


def three(element: ET.Element, name: str, default: str = "0 0 0") -> list[float]:
    """Return the numbers of an attribute."""
    return [float(word) for word in element.get(name, default).split()]


def along(normal: Sequence[float]) -> list[float]:
    """Return the quaternion that takes z to a direction (3,)."""
    length = math.sqrt(sum(x * x for x in normal))
    x, y, z = (component / length for component in normal)
    if z < -1.0 + 1e-9:
        return [1.0, 0.0, 0.0, 0.0]
    w = math.sqrt(0.5 * (1.0 + z))
    return [-y / (2.0 * w), x / (2.0 * w), 0.0, w]


# --- Meshes of a cell as a page loads them: one format, bounded, each asked for by number ---------
PREFIX: Final = "/meshes/"  # addresses of meshes begin so
TRIANGLES: Final = 100_000
"""All meshes of a cell together are coarsened to so many: 1.8 MB, and a picture in time [1]."""
LARGEST: Final = 2_500_000
"""... and to fewer where they take more, as triangles that share no corners do [B]."""
FEWEST: Final = 200  # a part is not coarsened below this [1]
_PASSES: Final = 3  # of coarsening, at most [1]

Colour = tuple[float, ...]


class Missing(NamedTuple):
    """A mesh that cannot be drawn."""

    link: str
    mesh: str  # its name in the URDF
    why: str


class Meshes:
    """The meshes that a cell's URDFs name, as binary glTF: STL, OBJ and COLLADA alike.

    Parts of one colour are one primitive, of a material `own`; parts without a colour have none.
    Textures become their mean colour.
    """

    def __init__(self) -> None:
        self.missing: list[Missing] = []  # those that cannot be drawn, and why
        self._parts: dict[Path, list[trimesh.Trimesh]] = {}
        self._unreadable: dict[Path, str] = {}

    def address(self, link: str, urdf: Path, name: str) -> str | None:
        """Return the address `/meshes/NUMBER.glb` of a mesh that a URDF names for a link.

        None, and a row of `missing`, for one that is not found or cannot be read. Addresses hold
        nothing of the URDF's own text.
        """
        file = find_mesh(name, urdf, {})
        why = "not found" if file is None else None
        if file is not None:
            file = file.resolve()
            if file not in self._parts and file not in self._unreadable:
                try:
                    self._parts[file] = read_mesh(file)
                except ConfigError as error:
                    self._unreadable[file] = str(error)
            why = self._unreadable.get(file)
        if file is None or why is not None:
            self.missing.append(Missing(link, name, why or ""))
            return None
        return f"{PREFIX}{list(self._parts).index(file)}.glb"

    def files(self) -> dict[str, bytes]:
        """Return what is at each address."""
        each = list(self._parts.values())
        kept = min(
            1.0, TRIANGLES / max(1, sum(len(part.faces) for parts in each for part in parts))
        )
        for _ in range(_PASSES):
            found = {f"{PREFIX}{i}.glb": _encoded(parts, kept) for i, parts in enumerate(each)}
            size = sum(len(mesh) for mesh in found.values())
            if size <= LARGEST:
                break
            kept *= 0.95 * LARGEST / size
        return found


def _encoded(parts: "list[trimesh.Trimesh]", kept: float) -> bytes:
    """Return parts as binary glTF, with about that part of their triangles `kept`."""
    import trimesh
    from trimesh.visual.material import PBRMaterial

    scene = trimesh.Scene()
    for colour, each in _by_colour(parts):
        mesh = trimesh.Trimesh(each.vertices, each.faces)  # equal corners become one
        goal = max(FEWEST, int(kept * len(mesh.faces)))
        if goal < len(mesh.faces):
            mesh = mesh.simplify_quadric_decimation(face_count=goal)
        if colour is not None:  # else no material: an empty one would bring an image along
            own = PBRMaterial("own", baseColorFactor=colour)
            mesh.visual = trimesh.visual.TextureVisuals(material=own)
        scene.add_geometry(mesh)
    return bytes(scene.export(file_type="glb"))


def _by_colour(
    parts: "list[trimesh.Trimesh]",
) -> "Iterator[tuple[Colour | None, trimesh.Trimesh]]":
    import trimesh

    groups: dict[Colour | None, list[trimesh.Trimesh]] = {}
    for part in parts:
        groups.setdefault(_colour(part), []).append(part)
    for colour, each in groups.items():
        corners = [part.vertices for part in each]
        first = np.cumsum([0, *map(len, corners)])
        faces = [part.faces + start for part, start in zip(each, first, strict=False)]
        yield colour, trimesh.Trimesh(np.concatenate(corners), np.concatenate(faces), process=False)


def _colour(part: "trimesh.Trimesh") -> Colour | None:
    """Return the mean colour (4,) of a part, 0 to 1; None for one that its file gives none."""
    if not part.visual.defined:
        return None
    if part.visual.kind == "texture":
        material = part.visual.material
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        one = image.convert("RGBA").resize((1, 1)).getpixel((0, 0)) if image else None
        mean = np.asarray(material.main_color if one is None else one, dtype=float)
    else:
        mean = np.asarray(part.visual.main_color, dtype=float)
    return tuple(float(x) for x in (mean / 255.0).round(3))


# --- Shapes of a link, as its URDF has them: boxes, cylinders, spheres, capsules and meshes -------
Colours = Mapping[str, list[float]]


def colours_of(root: ET.Element) -> dict[str, list[float]]:
    """Return the colours (4,) that a URDF names for all links, by name."""
    named = {m.get("name", ""): m.find("color") for m in root.findall("material")}
    return {name: three(c, "rgba") for name, c in named.items() if c is not None and c.get("rgba")}


def shapes_of(
    link: ET.Element, name: str, urdf: Path, meshes: Meshes, colours: Colours
) -> list[dict[str, Any]]:
    """Return the visual shapes of a link of that name, or its collision shapes if it has none."""
    for kind in ("visual", "collision"):
        each = [_shape(element, name, urdf, meshes, colours) for element in link.findall(kind)]
        found = [shape for shape in each if shape is not None]
        if found:
            return found
    return []


def _shape(
    element: ET.Element, link: str, urdf: Path, meshes: Meshes, colours: Colours
) -> dict[str, Any] | None:
    geometry = element.find("geometry")
    if geometry is None or not len(geometry):
        return None
    form = geometry[0]
    shape: dict[str, Any] = {"kind": form.tag, "pose": of_origin(element)}
    match form.tag:
        case "box":
            shape["half_size"] = [0.5 * side for side in three(form, "size")]
        case "cylinder" | "capsule":
            shape |= {"radius": float(form.get("radius", "0"))}
            shape |= {"length": float(form.get("length", "0"))}
        case "sphere":
            shape["radius"] = float(form.get("radius", "0"))
        case "mesh":
            address = meshes.address(link, urdf, form.get("filename", ""))
            if address is None:
                return None
            shape |= {"url": address, "scale": three(form, "scale", "1 1 1")}
    colour = _material_colour(element, colours)
    return shape if colour is None else {**shape, "colour": colour}


def _material_colour(element: ET.Element, colours: Colours) -> list[float] | None:
    material = element.find("material")
    if material is None:
        return None
    colour = material.find("color")
    if colour is not None and colour.get("rgba"):
        return three(colour, "rgba")
    return colours.get(material.get("name", ""))


# --- Links and joints of a cell's mechanisms, parents before children, for the page's kinematics
def described_links(cell: Cell, meshes: Meshes) -> list[dict[str, Any]]:
    """Return the links of all mechanisms; `parent` is an index among them, −1 for a Base.

    A link whose meshes cannot be drawn has its collision shapes, or its capsules, in their place. A
    link's `pose` is its joint's in the parent at zero (in World, of a Base), `axis` the joint's
    in the link itself, and `joint` its index in State's joint vectors, −1 where nothing moves it.
    """
    links: list[dict[str, Any]] = []
    first = 0
    for part in cell.parts:
        links += _tree(part, len(links), first, meshes)
        first += len(part.robot.joints)
    _add_capsules(cell, links)
    _add_lost_shapes(links, {row.link for row in meshes.missing})
    return links


def _tree(part: Cell, before: int, first: int, meshes: Meshes) -> list[dict[str, Any]]:
    root = ET.fromstring(part.robot.description(looks=True))
    colours = colours_of(root)
    index = {joint.name: first + i for i, joint in enumerate(part.robot.joints)}
    by_name = {link.get("name", ""): link for link in root.findall("link")}
    waiting = {end_of(joint, "child"): joint for joint in root.findall("joint")}
    base = next(name for name in by_name if name not in waiting)
    number: dict[str, int] = {}
    links: list[dict[str, Any]] = []

    def add(name: str, told: dict[str, Any]) -> None:
        number[name] = before + len(links)
        shapes = shapes_of(by_name[name], part.prefix + name, part.robot.urdf, meshes, colours)
        links.append({"name": part.prefix + name, **told, "shapes": shapes, "capsules": []})

    place = of_pose(part.config.mechanism.T_world_base)
    add(base, {"parent": -1, "pose": place, **_FIXED})
    while waiting:
        name = next(n for n, joint in waiting.items() if end_of(joint, "parent") in number)
        joint = waiting.pop(name)
        told = {"parent": number[end_of(joint, "parent")], "pose": of_origin(joint)}
        add(name, {**told, **_joint(joint, index)})
    return links


_FIXED: dict[str, Any] = {"kind": "fixed", "joint": -1, "axis": [0.0, 0.0, 1.0]}


def _joint(element: ET.Element, index: Mapping[str, int]) -> dict[str, Any]:
    """Return how a link moves in its parent; joints outside of the chain stand at zero."""
    joint = index.get(element.get("name", ""), -1)
    if joint < 0:
        return _FIXED
    axis = element.find("axis")
    direction = [1.0, 0.0, 0.0] if axis is None else three(axis, "xyz")
    length = math.sqrt(sum(x * x for x in direction))
    kind = "prismatic" if element.get("type") == "prismatic" else "revolute"
    return {"kind": kind, "joint": joint, "axis": [x / length for x in direction]}


def _add_capsules(cell: Cell, links: list[dict[str, Any]]) -> None:
    """Add the capsules that clearances are kept by, each to the link that its joint moves."""
    try:
        capsules = fitted(cell, Forest(cell))
    except ConfigError:
        return  # a mesh without capsules: this cell keeps no clearances
    moved = {link["joint"]: link for link in links if link["joint"] >= 0}
    roots = [link for link in links if link["parent"] < 0]
    for capsule in capsules:
        carrier = moved[capsule.body - 1] if capsule.body > 0 else roots[-capsule.body]
        carrier["capsules"].append(
            {
                "of": capsule.link,
                "start": capsule.start.tolist(),
                "end": capsule.end.tolist(),
                "radius": capsule.radius,
            }
        )


def _add_lost_shapes(links: list[dict[str, Any]], lost: set[str]) -> None:
    """Draw the capsules of links that lost all their meshes."""
    bare = {link["name"] for link in links if not link["shapes"]} & lost
    for link in links:
        link["shapes"] += [_drawn(c) for c in link["capsules"] if c["of"] in bare]


def _drawn(capsule: dict[str, Any]) -> dict[str, Any]:
    """Return a capsule as a shape of the link that it is fixed to."""
    start, end = np.array(capsule["start"]), np.array(capsule["end"])
    length = float(np.linalg.norm(end - start))
    turn = along(end - start) if length > 0.0 else [0.0, 0.0, 0.0, 1.0]
    pose = [*(0.5 * (start + end)).tolist(), *turn]
    return {"kind": "capsule", "pose": pose, "radius": capsule["radius"], "length": length}


# --- Tunnels of a cell's snakes: frames along the centre line of what has walls -------------------
STEP = 0.0075  # frames are at most so far apart [m]


def described_tunnels(cell: Cell) -> list[dict[str, Any]]:
    """Return the tunnel of each mechanism that has one."""
    found = []
    for part in cell.parts:
        backbone = part.config.mechanism.backbone
        if backbone is None:
            continue
        rig = part.config.rig
        found.append(
            {
                "mechanism": part.config.mechanism.name,
                "task": part.task,
                "step": STEP,
                "planar": backbone.axes == "planar",
                "half_width": backbone.half_width,
                "thickness": 0.01 if rig is None else rig.tunnel.thickness,
                "half_height": 0.05 if rig is None else rig.tunnel.half_height,
                "pieces": [[_nine(T) for T in row] for row in centre_line(backbone, STEP)],
            }
        )
    return found


def _nine(T: Pose) -> list[float]:
    """Return a frame's origin, its y (to the left) and its z, in World."""
    return [round(x, 6) for x in (*T.p.tolist(), *T.R[:, 1].tolist(), *T.R[:, 2].tolist())]


# --- Surroundings of a cell: what the arms keep away from, and what the virtual world holds -------
def described_obstacles(cell: Cell) -> list[dict[str, Any]]:
    """Return what arms keep away from, with the distance to keep [m]."""
    default = cell.config.avoidance.clearance
    told = {"name", "shape", "xyz", "to", "rpy", "half_size", "camera"}
    return [
        obstacle.model_dump(include=told)
        | {
            "radius": obstacle.radius or 0.0,
            "clearance": default if obstacle.clearance is None else obstacle.clearance,
            "hard": obstacle.shape != "sight_line" if obstacle.hard is None else obstacle.hard,
            "moves": obstacle.max_speed > 0.0,
        }
        for obstacle in cell.config.obstacles
    ]


def described_rig(cell: Cell) -> dict[str, Any] | None:
    """Return the bodies of the virtual world; None for a cell of real hardware."""
    rig = cell.config.rig
    if rig is None:
        return None
    boxes = [(box.name, box.xyz, box.rpy, box.half_size) for box in rig.boxes]
    if rig.bridge is not None:
        turned = (0.0, 0.0, rig.bridge.skew)
        boxes += [(name, at, turned, half) for name, (at, half) in rig.bridge.blocks.items()]
    return {
        "boxes": [
            {"name": name, "pose": seven(xyz, rpy), "half_size": half}
            for name, xyz, rpy, half in boxes
        ],
        "wall": None
        if rig.wall is None
        else {"pose": [*rig.wall.xyz, *along(rig.wall.normal)], "half_size": rig.wall.half_size},
        "holes": [
            {
                "name": hole.name,
                "pose": of_pose(hole.T_world_hole),
                **hole.model_dump(include={"radius", "chamfer", "depth", "half_size"}),
            }
            for hole in rig.holes
        ],
        "tags": [_tag(tag) for tag in rig.tags],
        "peg": None if rig.peg is None else rig.peg.model_dump(include={"radius", "length"}),
        "beam": None
        if rig.beam is None
        else {
            "half_size": rig.beam.half_size,
            "pegs": [of_pose(peg) for peg in rig.beam.pegs],
            "peg": rig.beam.peg.model_dump(include={"radius", "length"}),
        },
        "tool_radius": rig.tool_radius,
    }


def _tag(tag: RigTagSection) -> dict[str, Any]:
    place = tag.T_world_tag if tag.T_world_tag is not None else tag.T_wrist_tag
    return tag.model_dump(include={"name", "mechanism", "size", "colour"}) | {
        "on": "world" if tag.T_world_tag is not None else "wrist",
        "pose": None if place is None else of_pose(place),
        "cells": _cells(tag),
    }


def _cells(tag: RigTagSection) -> list[list[int]] | None:
    """Return the tag's picture with its white margin, rows of 0 (black) and 1; None unless OpenCV
    is installed."""
    try:
        from ....drivers.vision.opencv import marker
    except DeviceError:
        return None
    found: list[list[int]] = (marker(tag.family, tag.tag, 1) > 127).astype(int).tolist()
    return found


# --- Description of a cell for the page: all that does not change while it runs, as JSON ----------
BOUNDLESS: Final = 1e6  # joints that may turn this far turn for ever [rad]


class Scene(NamedTuple):
    """All that a page needs to draw a cell."""

    description: dict[str, Any]  # what `describe` returns
    files: dict[str, bytes]  # meshes as binary glTF, by the addresses that the description has


def scene_of(cell: Cell) -> Scene:
    """Return a cell's description and its meshes; reads them, which may take seconds."""
    meshes = Meshes()
    description = describe(cell, meshes)
    return Scene(description, meshes.files())


def describe(cell: Cell, meshes: Meshes | None = None) -> dict[str, Any]:
    """Return a cell's frames, shapes and surroundings.

    Joint vectors are in the order of State. Poses are `[x, y, z, qx, qy, qz, qw]`, SI throughout;
    shapes have addresses of `meshes`, and `missing` those that cannot be drawn. Names are as files
    have them, those of a URDF's links any text at all: whoever shows them must escape them.
    """
    meshes = Meshes() if meshes is None else meshes
    config, links = cell.config, described_links(cell, meshes)
    workspace = config.avoidance.workspace
    return {
        "cell": config.name,
        "description": config.description,
        "period_s": config.timing.period_s,
        "joints": _joints(cell),
        "links": links,
        "missing": [row._asdict() for row in meshes.missing],
        "tasks": _tasks(cell, {link["name"]: i for i, link in enumerate(links)}),
        "sources": [*SOURCES, FRAMES],
        "cameras": [
            camera.model_dump(include={"name", "size", "focal"})
            | {"task": part.task, "on": camera.on, "pose": of_pose(camera.place)}
            for part in cell.parts
            for camera in part.config.cameras
        ],
        "obstacles": described_obstacles(cell),
        "avoidance": {
            "told": config.keeps_clear,
            "clearance": config.avoidance.clearance,
            "self_clearance": config.avoidance.self_clearance,
            "near": config.avoidance.near_distance,
        },
        "tool_planes": [
            {"point": plane.point, "normal": plane.normal} for plane in config.avoidance.tool_planes
        ],
        "workspace": None if workspace is None else {"low": workspace.low, "high": workspace.high},
        "tunnels": described_tunnels(cell),
        "T_world_carrier": of_pose(config.frames.T_world_carrier),
        "moving": sorted(config.frames.moving),
        "rig": described_rig(cell),
        "foot": None if config.contour is None else config.contour.foot,
    }


def _joints(cell: Cell) -> list[dict[str, Any]]:
    """Return name, kind, bounds and start of all joints, bounds as the daemon keeps them.

    Wheels turn for ever: their bounds are none.
    """
    found = []
    for part in cell.parts:
        drives, joints = part.config.mechanism.drives, part.robot.joints
        bounds = joint_bounds(joints, drives)
        start = part.config.mechanism.postures["start"]
        found += [
            {
                "name": f"{part.prefix}{joint.name}",
                "kind": joint.kind,
                "lower": _bound(bounds.lower[i]),
                "upper": _bound(bounds.upper[i]),
                "max_velocity": drives[i].max_velocity,
                "max_torque": drives[i].max_torque,
                "start": start[i],
            }
            for i, joint in enumerate(joints)
        ]
    return found


def _bound(angle: float) -> float | None:
    return None if abs(angle) >= BOUNDLESS else angle


def _tasks(cell: Cell, links: dict[str, int]) -> list[dict[str, Any]]:
    """Return the tasks of all arms, then those that several hold together."""
    tasks, first = [], 0
    for part in cell.parts:
        mechanism, count = part.config.mechanism, len(part.robot.joints)
        tip = links[part.prefix + mechanism.tip_link]
        tasks.append(
            {
                "name": part.task,
                "mechanism": mechanism.name,
                "by": [mechanism.name],
                "first_joint": first,
                "joints": count,
                "tip": tip,
                "T_wrist_mrf": of_pose(mechanism.T_wrist_mrf),
                "force": mechanism.force_torque is not None,
            }
        )
        first += count
    for task in cell.joint_tasks:
        holder = next(t for t in tasks if t["mechanism"] == task.by[0])
        shared = {"name": task.name, "by": list(task.by), "force": False}
        tasks.append({**holder, **shared, "T_wrist_mrf": of_pose(task.T_wrist_mrf[0])})
    return tasks
