"""An arm in its tunnels at the free lengths of Chirikjian and Burdick's figures 4 and 5."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ....config.errors import ConfigError
from ....config.schema.mechanism import BackboneSection
from ....server.control.backbone.curve import centre_line
from ....server.control.backbone.insertion import Backbone
from .reader import Array, RecordedRun

PAPER = (1.00, 0.94, 0.83, 0.68, 0.54, 0.44)
"""Free lengths of the paper, in lengths of the arm [1]."""
NEAR = 0.01
"""A moment of the run counts for a free length within this [m]."""
SIZE_IN, SPACE_IN = 2.3, 3.0
"""Size of one moment, planar and in space [inch]."""
LINK_PT = 2.6
STEP = 0.004
"""The centre line is drawn by points at most so far apart [m]."""


def slithering(run: RecordedRun) -> Figure:
    """Return the curve (figure 4) and the true links (figure 5) of a run, in the paper's order.

    At its free lengths, and where the run did not come near one of these, at the nearest to it that
    it had. Raises `ConfigError` for a cell without a backbone.
    """
    section, backbone = run.cell.config.mechanism.backbone, Backbone.from_cell(run.cell)
    if backbone is None or section is None:
        raise ConfigError(f"{run.cell.path}: mechanism.backbone: missing: there is no tunnel")
    moments = _moments(run, backbone)
    planar = section.axes == "planar"
    centre = np.array([T.p for row in centre_line(section, STEP) for T in row])
    size = SIZE_IN if planar else SPACE_IN
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
