"""Pictures of a run's scene: bridge, grasps, tunnels, links and their capsules."""

import base64
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator

from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.schema.mechanism import BackboneSection
from ....config.schema.surroundings import ContourReflexSection
from ....config.urdf.links import link_shape
from ....protocols.messages.perception import NOTHING
from ....server.control.backbone.curve import centre_line, told_section
from ....server.control.backbone.insertion import Backbone
from ....server.control.inputs import ToldTunnel
from ....server.control.proximity.capsules import Capsules
from ....server.control.spatial import Pose
from ....server.perception.scanning.contour import CellPlane, crossed
from ....server.perception.scanning.reflex import CriticalPoints
from ...init.capsules import Tube, extreme, hull_of, union
from .figure import Array, RecordedRun

# --- Shapes of links and the capsules around them, measured and drawn: `telerobot check --picture`
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
    """Draw a shape and its capsules as seen along the third axis."""
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


# --- A rover before a bridge, as in Zhang et al. 2013: scan, contour, tool and elbow over time ----
#
# Figures 9 and 11 (points of the scans, contour with F1 to F3 and the target cell) at one
# moment, and 13 to 15 (tool and elbow) over the whole run.
BRIDGE_SIZE_IN: Final = (11.0, 7.4)
COLLECT_S: Final = 4.0  # scans that are drawn are no older than this: two sweeps [s]
PIECES: Final = (("F1", "tab:orange"), ("F2", "tab:green"), ("F3", "tab:purple"))
POINTS_PER_M: Final = 75.0
"""Scale of the view from the side: links are drawn nearly as thick as they are [pt/m]."""
BEHIND: Final = 0.6  # so much of the way behind the arm's foot is drawn [m]


class _Moment:
    """Everything at one moment of a run."""

    def __init__(self, run: RecordedRun, section: ContourReflexSection, at_s: float | None) -> None:
        self.run, self.section = run, section
        self.news = _chosen(run, at_s)
        self.time_s = float(self.news["time_s"])
        self.truth = run.truth_at(self.time_s)
        x, y, z, *rpy = self.truth["frames"]["base"]
        self.base = Pose.from_xyz_rpy((x, y, z), (rpy[0], rpy[1], rpy[2]))
        self.points = CriticalPoints(run.cell, section.shoulder, section.elbow, section.foot)
        self.plane = CellPlane(
            section.plane.width, section.plane.height, section.plane.cell, section.plane.collect
        )

    def critical(self, truth: dict[str, Any]) -> Array:
        """Return shoulder, elbow, …, tool (m, 3) at a truth, seen from the foot [m]."""
        found: Array = self.points.of(np.array(truth["q"])[self.points.arm][None])[0]
        return found

    def scanned(self) -> Array:
        """Return the points of the newest scans (n, 3) as the foot sees them [m]."""
        found = [np.empty((0, 3))]
        for row in self.run.scans:
            if self.time_s - COLLECT_S < row["time_s"] <= self.time_s:
                data = np.frombuffer(base64.b64decode(row["points_mm"]), "<i4")
                found.append(1e-3 * data.reshape(-1, 3))
        seen: Array = (np.vstack(found) - self.base.p) @ self.base.R - np.array(self.section.foot)
        return seen


def ducking(run: RecordedRun, at_s: float | None = None) -> Figure:
    """Return scan and contour at a moment, by default when the arm folds, and the whole passage.

    Raises `ConfigError` for a cell without a contour, or a run in which none was recorded.
    """
    section = run.cell.config.contour
    if section is None:
        raise ConfigError(f"{run.cell.path}: contour: missing: nobody looks ahead")
    if not run.contours:
        raise ConfigError(f"{run.path}: holds no contour of a scanner")
    moment = _Moment(run, section, at_s)
    figure = Figure(figsize=BRIDGE_SIZE_IN, layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.25, 1.0), width_ratios=(1.1, 1.2))
    _side(figure.add_subplot(grid[0, 0]), moment)
    _contour(figure, figure.add_subplot(grid[0, 1]), moment)
    _passage(figure.add_subplot(grid[1, :]), moment)
    return figure


def _chosen(run: RecordedRun, at_s: float | None) -> dict[str, Any]:
    """Return the contour nearest to a time; by default the first at which the arm folds."""
    if at_s is not None:
        return min(run.contours, key=lambda news: abs(float(news["time_s"]) - at_s))
    folding = [news for news in run.contours if news["phase"] == "folding"]
    return (folding or run.contours)[0]


def _side(ax: Axes, moment: _Moment) -> None:
    """Draw what the scanner saw from the side, and the arm."""
    seen = moment.scanned()
    inside = (np.abs(seen[:, 1]) < 0.5 * moment.plane.width) & (seen[:, 0] < moment.plane.collect)
    ax.plot(*seen[inside][:, [0, 2]].T, ".", color="tab:blue", ms=1.5, alpha=0.5, zorder=3)
    capsules, foot = moment.run.capsules, np.array(moment.section.foot)
    q = np.array(moment.truth["q"])
    q[[i for i in range(len(q)) if i not in moment.points.arm][:2]] = 0.0  # wheels turn in place
    ends = capsules.place(q[None], Pose.identity()).ends[0] - foot
    for (a, b), radius in zip(ends, capsules.radius, strict=True):
        ax.plot(
            [a[0], b[0]], [a[2], b[2]], color="0.7", lw=2.0 * radius * POINTS_PER_M,
            solid_capstyle="round",
        )  # fmt: skip
    now = moment.critical(moment.truth)
    ax.plot(now[:, 0], now[:, 2], "k.-", lw=1.2, ms=5)
    ax.set_xlim(-BEHIND, moment.plane.collect)
    ax.set_ylim(-foot[2] - 0.05, moment.plane.height + 0.1)
    ax.set_aspect("equal")
    ax.set_xlabel("ahead of the arm's foot [m]")
    ax.set_ylabel("above it [m]")
    ax.set_title(
        f"from the side at {moment.time_s:.1f} s: scans of {COLLECT_S:g} s", fontsize="medium"
    )


def _contour(figure: Figure, ax: Axes, moment: _Moment) -> None:
    """Draw the contour's cells, those that links forbid, and the target cell."""
    news, plane = moment.news, moment.plane
    cells = np.frombuffer(base64.b64decode(news["nearest_mm"]), "<u2").astype(float)
    depth = np.where(cells == NOTHING, np.nan, 1e-3 * cells).reshape(news["rows"], news["columns"])
    half = 0.5 * plane.width
    image = ax.imshow(
        depth, origin="lower", extent=(-half, half, 0.0, plane.height), cmap="cividis_r",
        vmin=0.0, vmax=plane.collect,
    )  # fmt: skip
    now = moment.critical(moment.truth)
    legend: list[Any] = []
    for (name, colour), (a, b) in zip(PIECES, ((0, -1), (0, 1), (1, -1)), strict=True):
        area = crossed(now[a, 1:], now[b, 1:], plane)
        for i, j in np.argwhere(area):
            corner = (j * plane.cell - half, i * plane.cell)
            ax.add_patch(
                Rectangle(corner, plane.cell, plane.cell, fc=colour, alpha=0.3, ec=colour, lw=0.3)
            )
        legend.append(Patch(fc=colour, alpha=0.5, label=name))
    ax.plot(now[:, 1], now[:, 2], "k.-", lw=1.2, ms=5)
    legend.append(Line2D([], [], color="k", marker=".", label="arm"))
    if news["posture"] is not None:
        goal = moment.points.of(np.array(news["posture"])[None])[0]
        i, j = plane.cell_of(*goal[-1, 1:].tolist())
        corner = (j * plane.cell - half, i * plane.cell)
        ax.add_patch(Rectangle(corner, plane.cell, plane.cell, fill=False, ec="tab:red", lw=2.2))
        ax.plot(goal[:, 1], goal[:, 2], "--", color="tab:red", lw=1.2)
        legend.append(
            Line2D([], [], color="tab:red", ls="--", marker="s", mfc="none", label="target")
        )
    ax.set_xlim(half, -half)  # left is left
    ax.set_xlabel("to the left [m]")
    ax.set_ylabel("above the foot [m]")
    ax.set_title(f"contour at {moment.time_s:.1f} s: {news['phase']}", fontsize="medium")
    ax.legend(
        handles=legend, fontsize="x-small", ncols=5, loc="upper center", bbox_to_anchor=(0.5, -0.2)
    )
    figure.colorbar(image, ax=ax, label="nearest [m]", shrink=0.8)


def _passage(ax: Axes, moment: _Moment) -> None:
    """Draw tool and elbow over time, and the phases of the passage."""
    run, foot = moment.run, moment.section.foot[2]
    at = np.array([moment.critical(truth) for truth in run.truths[::5]])
    time_s = run.true_time[::5]
    ax.plot(time_s, at[:, -1, 2] + foot, color="tab:red", label="tool")
    ax.plot(time_s, at[:, 1, 2] + foot, color="tab:blue", label="elbow")
    rig = run.cell.config.rig
    if rig is not None and rig.bridge is not None:
        ax.axhline(rig.bridge.height, color="k", ls=":", label="underside of the beam")
    began = [run.contours[0]]
    for news in run.contours:
        if news["phase"] != began[-1]["phase"]:
            began.append(news)
    ends = [*(news["time_s"] for news in began[1:]), float(time_s[-1])]
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.18 * (high - low))
    for k, (news, end) in enumerate(zip(began, ends, strict=True)):
        if k % 2:
            ax.axvspan(news["time_s"], end, color="0.93", zorder=0)
        if end - news["time_s"] > 0.05 * float(time_s[-1]):
            middle = 0.5 * (news["time_s"] + end)
            ax.text(
                middle, high + 0.06 * (high - low), news["phase"], ha="center", fontsize="small"
            )
    ax.axvline(moment.time_s, color="0.5", lw=0.8)
    ax.margins(x=0.0)
    ax.set_xlabel("time [s]")
    ax.set_ylabel("height above the floor [m]")
    ax.legend(fontsize="small", ncols=3, loc="lower right")


# --- An arm in its tunnels at the free lengths of Chirikjian and Burdick's figures 4 and 5 --------
PAPER = (1.00, 0.94, 0.83, 0.68, 0.54, 0.44)  # free lengths of the paper, in lengths of the arm [1]
NEAR = 0.01  # a moment of the run counts for a free length within this [m]
TUNNEL_SIZE_IN, SPACE_IN = 2.3, 3.0  # size of one moment, planar and in space [inch]
LINK_PT = 2.6
STEP = 0.004  # the centre line is drawn by points at most so far apart [m]


def slithering(run: RecordedRun) -> Figure:
    """Return the curve (figure 4) and the true links (figure 5) of a run, in the paper's order.

    At its free lengths, and where the run did not come near one of these, at the nearest to it that
    it had; in the tunnel that was in force at the end. Raises `ConfigError` for a cell without a
    backbone.
    """
    section = run.cell.config.mechanism.backbone
    if section is None:
        raise ConfigError(f"{run.cell.path}: mechanism.backbone: missing: there is no tunnel")
    last = run.states[-1] if run.states else {}
    if told := last.get("tunnel"):
        section = told_section(section, ToldTunnel(tuple(map(tuple, told)), last["tunnel_open"]))
    backbone = Backbone.of(run.cell, section)
    moments = _moments(run, backbone)
    planar = section.axes == "planar"
    centre = np.array([T.p for row in centre_line(section, STEP) for T in row])
    size = TUNNEL_SIZE_IN if planar else SPACE_IN
    figure = Figure(figsize=(size * len(moments), 2.0 * size + 0.5), layout="constrained")
    figure.suptitle(f"{run.cell.config.name}: {run.path.name}", fontsize="medium")
    how: dict[str, Any] = {} if planar else {"projection": "3d"}
    for column, (s1, q) in enumerate(moments):
        stations = np.linspace(0.0, backbone.chain.length, 301)
        curve = backbone.curve.at(s1, stations).points
        links = backbone.chain.points(q[None])[0]
        for row, points in enumerate((curve, links)):
            ax = figure.add_subplot(2, len(moments), row * len(moments) + column + 1, **how)
            _tunnel(ax, section, centre, planar)
            dots = {"marker": ".", "ms": LINK_PT} if row else {}
            _line(ax, points, planar, color="k" if row else "tab:blue", lw=1.4, **dots)
            _line(ax, points[:1], planar, color="k", marker="s", ms=3.0)
            low = _frame(ax, [centre, backbone.chain.points(backbone.fits).reshape(-1, 3)], planar)
            if not planar:
                _shadows(ax, (centre, points), low)
            if not row:
                share = s1 / backbone.chain.length
                ax.set_title(
                    f"$s_1$ = {share:.2f} of {backbone.chain.length:g} m", fontsize="small"
                )
    return figure


def _moments(run: RecordedRun, backbone: Backbone) -> list[tuple[float, Array]]:
    """Return free lengths and the true joints there."""
    inserted = [(s["time_s"], s["insertion"]) for s in run.states if s.get("insertion")]
    if not inserted:
        raise ConfigError(f"{run.path}: the arm was never on its curve")
    lengths = backbone.chain.length - np.array([told["depth"] for _, told in inserted])
    found: list[tuple[float, Array]] = []
    for share in PAPER:
        i = int(np.abs(lengths - share * backbone.chain.length).argmin())
        if all(abs(float(lengths[i]) - s1) > NEAR for s1, _ in found):
            q = np.array(run.truth_at(inserted[i][0])["q"])
            found.append((float(lengths[i]), q))
    return found


def _tunnel(ax: Axes, section: BackboneSection, centre: Array, planar: bool) -> None:
    """Draw the walls of a planar tunnel, or the centre line of one in space."""
    if not planar:
        _line(ax, centre, planar, color="tab:orange", lw=6.0, alpha=0.35, solid_capstyle="butt")
        return
    along = np.gradient(centre, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    left = np.stack((-along[:, 1], along[:, 0]), axis=1)
    for side in (-1.0, 1.0):
        wall = centre[:, :2] + side * section.half_width * left
        ax.plot(*wall.T, color="tab:orange", lw=1.0)


def _line(ax: Axes, points: Array, planar: bool, **how: Any) -> None:
    ax.plot(*points.T[: 2 if planar else 3], **how)


def _frame(ax: Axes, every: list[Array], planar: bool) -> Array:
    """Choose one square, or box, for all moments; return its lowest corner (3,) [m]."""
    points = np.vstack(every)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, half = 0.5 * (low + high), 0.58 * (high - low)
    if planar:
        half[:] = half.max()
    for i, axis in enumerate("xy" if planar else "xyz"):
        getattr(ax, f"set_{axis}lim")(middle[i] - half[i], middle[i] + half[i])
        getattr(ax, f"{axis}axis").set_major_locator(MaxNLocator(4))
        if not planar:
            getattr(ax, f"set_{axis}label")(f"{axis} [m]", fontsize="xx-small")
    ax.set_aspect("equal")
    ax.tick_params(labelsize="xx-small")
    return np.asarray(middle - half)


def _shadows(ax: Axes, lines: tuple[Array, ...], low: Array) -> None:
    """Draw lines on the floor, too: which of two is nearer is not seen otherwise."""
    for points, width in zip(lines, (2.0, 1.0), strict=True):
        on_floor = np.column_stack((points[:, :2], np.full(len(points), low[2])))
        _line(ax, on_floor, planar=False, color="0.8", lw=width, alpha=0.6)
