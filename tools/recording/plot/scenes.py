"""Shapes of links and the capsules around them, measured and drawn: `telerobot check --picture`."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.urdf.shapes import Tube, extreme, hull_of, link_shape, union
from ....server.control.proximity.capsules import Capsules
from ....server.control.spatial import Pose
from .figure import Array

WIDTH_IN: Final = 11.0
ROW_IN: Final = 2.3
IN_A_ROW: Final = 2  # links, each with two views
_DRAWN: Final = 4000
"""Triangles that are drawn of a shape, the greatest; of the others, corners [1]."""
_LOOKED_AT: Final = 3000
_ARC: Final = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 24)
_AXES: Final = "xyz"


class LinkCover(NamedTuple):
    """A link's shape and its capsules, in its frame."""

    link: str
    triangles: Array  # (t, 3, 3) [m]
    tubes: tuple[Tube, ...]
    ratio: float
    """Volume of the capsules' union by that of the shape's convex hull [1]; inf if it is flat."""
    outside: float
    """Distance by which the shape stands out of its capsules, 0 for one that they hold [m]."""
    at_ready: Pose  # the link's at `ready`, in World

    def text(self) -> str:
        """Return a line that states how tight the capsules are, and whether they hold the shape."""
        count = f"{len(self.tubes)} capsule" + "s" * (len(self.tubes) != 1)
        tight = "flat" if math.isinf(self.ratio) else f"{self.ratio:.2f} × its hull"
        held = "" if self.outside == 0.0 else f", stands out {1e3 * self.outside:.3g} mm"
        return f"{count}, {tight}{held}"


def covers(cell: Cell, packages: Mapping[str, Path]) -> list[LinkCover]:
    """Return every link of a cell that has a shape, with the capsules that the daemon uses.

    Of a link whose capsules all lie inside those of others on its body, these. Raises
    `ConfigError` for a mesh that is not found, or cannot be read, all of them at once.
    """
    capsules, found = Capsules(cell), []
    wrong: list[str] = []
    ready = [part.config.mechanism.postures["ready"] for part in cell.parts]
    frames = capsules.place(np.concatenate(ready)[None]).frames[0]
    for part in cell.parts:
        base = part.config.mechanism.T_world_base
        for element in part.robot.tree().findall("link"):
            name = f"{part.prefix}{element.get('name', '')}"
            try:
                shape = link_shape(element, part.robot.urdf, packages, around=False)
            except ConfigError as error:
                wrong += error.messages
                continue
            if shape is None:
                continue
            body, T = capsules.forest.body_of(name)
            same = [c for c in capsules.each if c.body == body]
            own = [c for c in same if c.link == name] or same
            tubes = tuple(Tube(c.start, c.end, c.radius).seen_from(T.R, T.p) for c in own)
            carrier = Pose.from_xyz_rpy(base.xyz, base.rpy)
            if body > 0:
                carrier = Pose(frames[body - 1][:, :3], frames[body - 1][:, 3])
            found.append(_cover(name, shape.triangles, tubes, carrier @ T))
    if wrong:
        raise ConfigError(*wrong)
    return found


def drawn(title: str, links: Sequence[LinkCover]) -> Figure:
    """Return the arm at `ready` from three sides, then each link from two, with its capsules."""
    rows = math.ceil(len(links) / IN_A_ROW)
    figure = Figure(figsize=(WIDTH_IN, 3.6 + ROW_IN * rows), layout="constrained")
    figure.suptitle(title, fontsize="medium")
    grid = figure.add_gridspec(1 + rows, 1, height_ratios=[3.6, *([ROW_IN] * rows)])
    top = grid[0].subgridspec(1, 3)
    for column, (across, up) in enumerate(((0, 2), (1, 2), (0, 1))):
        ax = figure.add_subplot(top[column])
        for link in links:
            R, p = link.at_ready
            moved = tuple(tube.placed(R, p) for tube in link.tubes)
            _view(ax, link.triangles @ R.T + p, moved, (across, up))
        ax.set_title(f"at `ready`, World {_AXES[across]}{_AXES[up]} [m]", fontsize="small")
    for row in range(rows):
        inner = grid[1 + row].subgridspec(1, 2 * IN_A_ROW)
        for k, link in enumerate(links[IN_A_ROW * row : IN_A_ROW * (row + 1)]):
            extent = np.ptp(link.triangles.reshape(-1, 3), axis=0)
            longest, middle, least = np.argsort(-extent).tolist()
            for side, other in enumerate((middle, least)):
                ax = figure.add_subplot(inner[2 * k + side])
                _view(ax, link.triangles, link.tubes, (longest, other))
                words = link.text() if side else link.link
                ax.set_title(f"{words}\n{_AXES[longest]}{_AXES[other]} [m]", fontsize="x-small")
    return figure


def _cover(name: str, triangles: Array, tubes: tuple[Tube, ...], at: Pose) -> LinkCover:
    points = triangles.reshape(-1, 3)
    hull = hull_of(extreme(points, 1000))
    ratio = math.inf if hull is None or not tubes else union(tubes) / hull.volume
    far = extreme(points, _LOOKED_AT)
    apart = np.min([t.distance(far) for t in tubes], axis=0) if tubes else np.full(1, math.inf)
    outside = float(apart.max())
    return LinkCover(name, triangles, tubes, ratio, outside if outside > 1e-6 else 0.0, at)


def _view(ax: Axes, triangles: Array, tubes: Sequence[Tube], axes: tuple[int, int]) -> None:
    flat = triangles[:, :, list(axes)]
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    order = np.argsort(-np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), kind="stable")
    ax.add_collection(PolyCollection(list(flat[order[:_DRAWN]]), facecolors="0.65", linewidths=0))
    rest = flat[order[_DRAWN:], 0][:20_000]
    ax.plot(rest[:, 0], rest[:, 1], ",", color="0.65")
    for tube in tubes:
        outline = _outline(tube.start[list(axes)], tube.end[list(axes)], tube.radius)
        ax.plot(outline[:, 0], outline[:, 1], color="tab:red", linewidth=0.8)
    ax.set_aspect("equal", adjustable="datalim")
    ax.autoscale_view()
    ax.xaxis.set_major_locator(MaxNLocator(4))
    ax.yaxis.set_major_locator(MaxNLocator(5))
    ax.tick_params(labelsize="xx-small")


def _outline(a: Array, b: Array, radius: float) -> Array:
    """Return the edge (k, 2) of a capsule's projection: two half circles and what joins them."""
    turn = math.atan2(b[1] - a[1], b[0] - a[0])
    first = b + radius * np.stack([np.cos(_ARC + turn), np.sin(_ARC + turn)], axis=1)
    second = a - radius * np.stack([np.cos(_ARC + turn), np.sin(_ARC + turn)], axis=1)
    return np.concatenate([first, second, first[:1]])
