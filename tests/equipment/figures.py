"""Figures of recorded runs for the guides: an arm in its tunnels, a rover before a bridge.

python -m laboratory.equipment.figures tunnel RUN.mcap --out snake.png
python -m laboratory.equipment.figures contour RUN.mcap --out rover_bridge.png --at 12.5
"""

import argparse
import base64
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator
from telerobot.config.errors import ConfigError
from telerobot.config.schema.mechanism import BackboneSection
from telerobot.config.schema.surroundings import ContourReflexSection
from telerobot.protocols.messages.perception import NOTHING
from telerobot.server.control.backbone.curve import centre_line, told_section
from telerobot.server.control.backbone.insertion import Backbone
from telerobot.server.control.inputs import ToldTunnel
from telerobot.server.control.spatial import Pose
from telerobot.server.perception.scanning.contour import CellPlane
from telerobot.server.perception.scanning.reflex import CriticalPoints
from telerobot.tools.recording.plot.figure import Array, RecordedRun, load_recording

from ..papers.lwa3 import cell_of, crossed
from .alone import run_alone

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
        i, j = cell_of(plane, *goal[-1, 1:].tolist())
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


# --- The command ----------------------------------------------------------------------------------
def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add which figure of which run, and where it is written."""
    parser.add_argument("figure", choices=("tunnel", "contour"), help="which one")
    parser.add_argument("run_file", metavar="RUN.mcap", type=Path, help="a recorded run")
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help=".png or .svg")
    parser.add_argument("--at", type=float, metavar="S", help="moment of a contour [s]")


def run(args: argparse.Namespace) -> int:
    """Draw; return 0. Raises `ConfigError` for a run that has no such figure."""
    recorded = load_recording(args.run_file)
    figure = slithering(recorded) if args.figure == "tunnel" else ducking(recorded, args.at)
    figure.savefig(args.out, dpi=100)
    return 0


def main(argv: list[str] | None = None) -> int:
    return run_alone("laboratory.equipment.figures", add_arguments, run, argv)


if __name__ == "__main__":
    sys.exit(main())
