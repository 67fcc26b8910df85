"""A stand-in for Zhang's arm: Schunk's LWA3, its lengths between shoulder, elbow, wrist, tool."""

from pathlib import Path

import numpy as np
from telerobot.config.load import Cell, load_cell
from telerobot.server.control.scene import Flags
from telerobot.server.control.spatial import Array
from telerobot.server.perception.scanning.contour import CellPlane, Contour, Obstacles
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


def bridge(height: float, ahead: float, width: float = 1.4, y: float = 0.0) -> Obstacles:
    """Occupied cells of a bridge with beam and pillars of 100 mm, 100 mm thick."""
    rows, columns = PLANE.shape
    j, i = np.meshgrid(np.arange(columns), np.arange(rows))
    off, z = np.abs((j + 0.5) * 0.05 - 1.0 - y), (i + 0.5) * 0.05
    beam = (z > height) & (z < height + 0.1) & (off < width / 2 + 0.1)
    pillar = (off > width / 2) & (off < width / 2 + 0.1) & (z < height + 0.1)
    filled = np.where(beam | pillar, ahead, np.nan)
    behind = filled if ahead > -0.4 else np.full_like(filled, np.nan)
    return Obstacles.of(Contour(behind, behind + 0.1), PLANE)


def touched(start: Array, end: Array) -> Flags:
    """Cells that points of a segment are in, looked at a tenth of a cell apart; eq. 12."""
    found = np.zeros((22, 42), dtype=bool)
    for t in np.linspace(0, 1, 10 * int(np.ceil(np.linalg.norm(end - start) / 0.05)) + 1):
        y, z = start + t * (end - start)
        i, j = int(np.floor(z / 0.05 + 1e-9)), int(np.floor((y + 1) / 0.05 + 1e-9))
        for di in (0, 1, 2):
            for dj in (0, 1, 2):
                if 0 <= i + di < 22 and 0 <= j + dj < 42:
                    found[i + di, j + dj] = True
    return found[1:-1, 1:-1]


def cell_of(plane: CellPlane, y: float, z: float) -> tuple[int, int]:
    """Return row and column of a point, from 0; they may be outside of the plane."""
    # A point on a border is in the cell above, whatever its last bit says.
    return (
        int(np.floor(z / plane.cell + 1e-9)),
        int(np.floor((y + 0.5 * plane.width) / plane.cell + 1e-9)),
    )


def crossed(start: Array, end: Array, plane: CellPlane) -> Flags:
    """Return the cells (rows, columns) that a projected segment touches, and their neighbours.

    From y, z (2,) to y, z (2,) [m] (eq. 12).
    """
    rows, columns = plane.shape
    wide = np.zeros((rows + 2, columns + 2), dtype=bool)
    cuts = [0.0, 1.0]
    way = end - start
    for axis, origin in ((0, -0.5 * plane.width), (1, 0.0)):
        if abs(way[axis]) > 1e-12:
            ends = np.sort([start[axis] - origin, end[axis] - origin]) / plane.cell
            borders = np.arange(np.ceil(ends[0] - 1e-9), np.floor(ends[1] + 1e-9) + 1)
            cuts += ((borders * plane.cell + origin - start[axis]) / way[axis]).tolist()
    at = np.unique(np.clip(cuts, 0.0, 1.0))
    # The middle between two borders is inside of a cell; ends and borders belong to the cell above.
    for t in np.concatenate([at, 0.5 * (at[:-1] + at[1:])]).tolist():
        y, z = (start + t * way).tolist()
        i, j = cell_of(plane, y, z)
        if -1 <= i <= rows and -1 <= j <= columns:
            wide[i + 1, j + 1] = True
    grown = np.zeros_like(wide)
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            grown |= np.roll(np.roll(wide, di, axis=0), dj, axis=1) if di or dj else wide
    return grown[1:-1, 1:-1]


def interference(contour: Contour, area: Flags) -> Array:
    """Return the contour where cells are forbidden, NaN elsewhere (eq. 13)."""
    return np.where(area, contour.nearest, np.nan)
