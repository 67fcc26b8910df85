"""Tick at full load: among obstacles of every kind, for several arms, and for chains of any length.

Obstacles are drawn by seed around where arms move, clear of them at the start; the sight line looks
at a place beside a tool. The chain is made here: links of equal length whose axes alternate, as an
arm's do.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from telerobot.config.load import Cell, altered, load_cell
from telerobot.config.schema.surroundings import AvoidanceSection, ObstacleSection, WorkspaceSection
from telerobot.config.urdf.robot import read_robot
from telerobot.server.control.spatial import Array

from .peers.geometry import PeerGeometry
from .peers.scenes import Thing

OBSTACLES = 16
"""At full load [1]."""
REACH = (0.2, 0.7)
"""Obstacles lie so far from the tool [m]."""
CLEAR = 0.08
"""Kept at the start [m]."""
KINDS = ("sphere", "capsule", "box", "sphere", "capsule", "box", "point", "sight_line")
LENGTH = 1.2
"""Of a made chain, all links together [m]."""
THICKNESS = (0.04, 0.4)
"""Radius of its links [m], and at most so much of their length [1]: else two that have one between
them would meet."""

APART = 1.2
"""Between the bases of two arms, which stand in a row [m]."""

Draw = np.random.Generator


def among(cell: Cell, count: int) -> Cell:
    """Return a cell with so many obstacles, a workspace, and every barrier on."""
    ready = [np.array(part.config.mechanism.postures["ready"]) for part in cell.parts]
    tools = [PeerGeometry(part, ()).tool(q).p for part, q in zip(cell.parts, ready, strict=True)]
    draw = np.random.default_rng(1)
    found: list[ObstacleSection] = []
    while len(found) < count:
        way = draw.normal(0.0, 1.0, 3)
        centre = tools[len(found) % len(tools)] + draw.uniform(*REACH) * way / np.linalg.norm(way)
        obstacle, thing = _drawn(draw, len(found), centre)
        if all(
            PeerGeometry(part, (thing,)).clearance(q).things > CLEAR
            for part, q in zip(cell.parts, ready, strict=True)
        ):
            found.append(obstacle)
    avoidance = AvoidanceSection(
        enabled=True,
        near_speed=0.1,
        workspace=WorkspaceSection(low=(-3.0, -3.0, -1.0), high=(3.0, 3.0, 3.0)),
    )
    told = {"obstacles": tuple(found), "avoidance": avoidance}
    first, *others = (altered(part, told) for part in cell.parts)
    return replace(first, others=tuple(others), joint_tasks=cell.joint_tasks)


def several(cell: Cell, count: int, folder: Path) -> Cell:
    """Return a cell of so many arms like the cell's own, in a row, each with a task of its own.

    Its file is written to `folder`.
    """
    path = folder / f"arms{count}.toml"
    lines = [f'name = "arms{count}"', f'default_script = "{cell.config.default_script}"']
    for i in range(count):
        lines += ["[[buses]]", f'name = "arm{i}"', f'channel = "239.74.163.{100 + i}"']
    for i in range(count):
        y = APART * (i - 0.5 * (count - 1))
        lines += ["[[mechanisms]]", f'name = "arm{i}"', f'bus = "arm{i}"', f'like = "{cell.path}"']
        lines += [f"T_world_base = {{ xyz = [0.0, {y}, 0.0] }}"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return load_cell(path)


def at_period(cell: Cell, period_s: float, folder: Path) -> Cell:
    """Return a cell with another period [s]; its file, of the one bus, is written to `folder`."""
    path = folder / f"{cell.config.name}.toml"
    text = cell.path.read_text(encoding="utf-8")
    path.write_text(text.replace("\n[bus]", f"\n[timing]\nperiod_s = {period_s}\n\n[bus]", 1))
    return load_cell(path)


def on_one_payload() -> Cell:
    """Return the shipped cell of two arms that hold a payload, which weighs nothing here.

    What sensors tell in a benchmark is noise: of a weight they would have to tell.
    """
    cell = load_cell("pa10_pair")
    (task,) = cell.joint_tasks
    light = task.model_copy(update={"payload": task.payload.model_copy(update={"mass": 0.0})})
    return replace(cell, joint_tasks=(light,))


def _drawn(draw: Draw, i: int, centre: Array) -> tuple[ObstacleSection, Thing]:
    """Return an obstacle, and a thing that fills at least the same space."""
    kind, name = KINDS[i % len(KINDS)], f"obstacle_{i}"
    x, y, z = centre.tolist()
    radius = float(draw.uniform(0.03, 0.08))
    match kind:
        case "box":
            a, b, c = draw.uniform(0.03, 0.08, 3).tolist()
            obstacle = ObstacleSection(name=name, shape="box", xyz=(x, y, z), half_size=(a, b, c))
            return obstacle, Thing(name=name, shape="box", xyz=(x, y, z), half_size=(a, b, c))
        case "capsule" | "sight_line":
            half = float(draw.uniform(0.05, 0.2))
            radius = radius if kind == "capsule" else 0.005
            ends = {"xyz": (x, y, z - half), "to": (x, y, z + half), "radius": radius}
            thing = Thing(
                name=name, shape="capsule", xyz=(x, y, z), radius=radius, half_length=half
            )
            return ObstacleSection.model_validate({"name": name, "shape": kind, **ends}), thing
        case _:
            radius = radius if kind == "sphere" else 0.001
            told: dict[str, object] = {"name": name, "shape": kind, "xyz": (x, y, z)}
            if kind == "sphere":
                told["radius"] = radius
            thing = Thing(name=name, shape="sphere", xyz=(x, y, z), radius=radius)
            return ObstacleSection.model_validate(told), thing


def chain(cell: Cell, joints: int, folder: Path) -> Cell:
    """Return a cell with a made chain of so many joints in place of its arm.

    Its URDF is written to `folder`; the drives are copies of the cell's own.
    """
    path = folder / f"chain{joints}.urdf"
    path.write_text(_urdf(joints), encoding="utf-8")
    names = [f"joint{i}" for i in range(joints)]
    mechanism = cell.config.mechanism
    drives = tuple(
        mechanism.drives[i % len(mechanism.drives)].model_copy(
            update={"joint": name, "node": i + 1}
        )
        for i, name in enumerate(names)
    )
    ready = tuple(0.0 if i % 2 == 0 else 2.4 / (joints // 2) for i in range(joints))
    made = altered(
        cell,
        {
            "mechanism.urdf": str(path),
            "mechanism.tip_link": "tip",
            "mechanism.drives": drives,
            "mechanism.postures": dict.fromkeys(mechanism.postures, ready),
        },
    )
    return Cell(path=path, config=made.config, robot=read_robot(path, "tip", str(path)))


def _urdf(joints: int) -> str:
    step = LENGTH / joints
    radius = min(THICKNESS[0], THICKNESS[1] * step)
    parts = ['<link name="link0"/>']
    for i in range(joints):
        last = i + 1 == joints
        child = "tip" if last else f"link{i + 1}"
        axis = "0 0 1" if i % 2 == 0 else "0 1 0"
        parts.append(
            f'<joint name="joint{i}" type="revolute"><parent link="link{i}"/>'
            f'<child link="{child}"/><origin xyz="0 0 {step if i else 0.3}"/><axis xyz="{axis}"/>'
            '<limit lower="-2.8" upper="2.8" effort="100" velocity="2"/></joint>'
            f'<link name="{child}"><inertial><origin xyz="0 0 {step / 2}"/><mass value="2"/>'
            '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial>'
            f'<collision><origin xyz="0 0 {step / 2}"/><geometry>'
            f'<cylinder radius="{radius}" length="{step * 0.8}"/></geometry></collision></link>'
        )
    return f'<robot name="chain{joints}">{"".join(parts)}</robot>'
