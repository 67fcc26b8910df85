"""A stand-in for Zhang's arm: Schunk's LWA3, its lengths between shoulder, elbow, wrist, tool."""

from pathlib import Path

import numpy as np
from telerobot.config.load import Cell, load_cell
from telerobot.server.perception.scanning.contour import CellPlane
from telerobot.server.perception.scanning.reflex import CriticalPoints, Reach, Search

PLANE = CellPlane()
REACH = Reach(choose=0.11, trigger=0.10, give_up=0.07, column=0.08)
START = np.array([0.0, -np.pi / 4, 0.0, np.pi / 2, 0.0, 0.0, 0.0])
"""The posture of eq. 15."""
UP = ("z", "y", "z", "y", "z", "y", "z")
ABOVE = (0.12, 0.18, 0.0, 0.328, 0.0, 0.276, 0.0)
MOST = (2.9, 2.0, 2.9, 2.094, 2.9, 2.0, 2.9)


def urdf() -> str:
    links = ['<link name="foot"/>']
    for i, (axis, above, most) in enumerate(zip(UP, ABOVE, MOST, strict=True), start=1):
        parent = f"link{i - 1}" if i > 1 else "foot"
        xyz = "0 1 0" if axis == "y" else "0 0 1"
        links.append(
            f'<joint name="j{i}" type="revolute"><parent link="{parent}"/><child link="link{i}"/>'
            f'<origin xyz="0 0 {above}"/><axis xyz="{xyz}"/>'
            f'<limit lower="-{most}" upper="{most}" effort="100" velocity="1.2"/></joint>'
            f'<link name="link{i}"><inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" '
            'iyy="0.01" iyz="0" izz="0.01"/></inertial></link>'
        )
    return f'<robot name="lwa3">{"".join(links)}</robot>'


def cell(folder: Path) -> Cell:
    (folder / "arm.urdf").write_text(urdf())
    drives = "".join(
        f'[[mechanism.drives]]\njoint = "j{i}"\nnode = {i}\ncounts_per_radian = 1e6\n'
        "rated_torque = 50.0\nmax_torque = 100.0\nmax_velocity = 1.2\nmax_acceleration = 4.0\n"
        "max_jerk = 100.0\n"
        for i in range(1, 8)
    )
    start = START.tolist()
    (folder / "arm.toml").write_text(
        'name = "lwa3"\ndefault_script = "pa10_tour"\n[mechanism]\nname = "arm"\n'
        'urdf = "arm.urdf"\ntip_link = "link7"\nT_wrist_mrf = { xyz = [0.0, 0.0, 0.2192] }\n'
        f"[mechanism.postures]\nstart = {start}\nready = {start}\n{drives}"
    )
    return load_cell(folder / "arm.toml")


def search(folder: Path) -> Search:
    return Search(CriticalPoints(cell(folder), "j2", "j4"), PLANE, REACH)
