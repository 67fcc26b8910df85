"""One style for all pictures: our curves in colour, on top of what is printed, in black."""

import io
import re
from contextlib import AbstractContextManager
from typing import Any, Final

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLOURS: Final = ("#1f6fb4", "#c8502d", "#3c8d5a", "#8a5fb0", "#b8860b", "#5f6b76")
PRINTED: Final[dict[str, Any]] = {
    "color": "black", "ls": "none", "marker": "o", "ms": 3.4, "mfc": "none", "mew": 0.8,
}  # fmt: skip
"""Points that a paper prints, or that follow from its printed equations."""
BOUND: Final[dict[str, Any]] = {"color": "black", "lw": 0.9, "ls": (0, (4, 3))}
"""A value that a paper prints, as a line."""
BODY: Final = "#d9dde1"
"""Fill of obstacles and walls."""
RC: Final[Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#5f6b76",
    "axes.grid": True,
    "axes.labelsize": 9,
    "axes.linewidth": 0.7,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 9.5,
    "figure.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "grid.color": "#e4e7ea",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "path.simplify_threshold": 0.3,
    "svg.fonttype": "none",
    "svg.hashsalt": "papers",
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
}
WIDTH_IN: Final = 7.6
PATH, LONG = re.compile(r' d="[^"]*"'), re.compile(r"(\d\.\d\d)\d+")


def applied() -> AbstractContextManager[None]:
    """Return a context in which pictures have this style."""
    return rc_context(RC)


def above(figure: Figure, ax: Axes) -> None:
    """Place a panel's legend above all panels."""
    figure.legend(*ax.get_legend_handles_labels(), loc="outside upper right", ncols=6)


def panels(rows: int, columns: int, height: float, **options: Any) -> tuple[Figure, list[Axes]]:
    """Return a figure of panels, row by row, each of the same size; its height in inches."""
    figure = Figure(figsize=(WIDTH_IN, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, list(axes.ravel())


def label(ax: Axes, x: str, y: str, title: str = "") -> None:
    """Name the axes, with their units, and the panel."""
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    if title:
        ax.set_title(title, loc="left")


def svg(figure: Figure) -> str:
    """Return a figure as SVG: the same bytes for the same numbers, to a hundredth of a point."""
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None})
    text = PATH.sub(lambda path: LONG.sub(r"\1", path.group()), file.getvalue())
    return "\n".join(line.rstrip() for line in text.splitlines()) + "\n"
