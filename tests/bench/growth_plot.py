"""Plot of the tick's growth: two panels, p50 and p99.

Whole lines are of ticks after pauses, the slower of both phases; dashed ones of ticks back to back.
"""

from pathlib import Path
from typing import Final

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from telerobot.tools.bench.figures import Figures
from telerobot.tools.bench.tick import TARGET_US

COLOURS: Final = {"p50": "#1f6fb4", "p99": "#c8502d"}
APART: Final = 0.06
"""Counts closer than this part of the axis share a label [1]."""


def draw(grown: Figures, file: Path) -> None:
    """Write the picture of what `growth` measured."""
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "growth"}):
        drawn(grown).savefig(file, metadata={"Date": None})


def drawn(grown: Figures) -> Figure:
    """Return the picture of what `growth` measured, a panel for each thing that was counted."""
    figure = Figure(figsize=(7.6, 2.8), layout="constrained")
    for ax, (of, rows) in zip(
        figure.subplots(1, len(grown), squeeze=False)[0], grown.items(), strict=True
    ):
        _panel(ax, of, rows)
    return figure


def _panel(ax: Axes, of: str, rows: Figures) -> None:
    """Draw the times of one tick against one count."""
    counts = [int(count) for count in rows]
    for name, colour in COLOURS.items():
        paused = [max(row["free_us"][name], row["limited_us"][name]) for row in rows.values()]
        warm = [row["back_to_back_us"][name] for row in rows.values()]
        ax.plot(counts, paused, color=colour, label=name)
        ax.plot(counts, warm, "--", color=colour, label=f"{name}, back to back")
    ax.axhline(TARGET_US, color="0.6", lw=0.8, ls=":")
    ax.set_title(f"one tick [µs] against {of}", fontsize="medium")
    ax.set_ylim(0.0, 100.0 * (1 + max(TARGET_US, ax.get_ylim()[1]) // 100))
    ax.set_xticks(_labels(counts))
    ax.legend(fontsize="x-small")


def _labels(counts: list[int]) -> list[int]:
    """Return the counts that have a label: those of small counts would lie on each other."""
    found: list[int] = []
    for count in counts:
        if not found or count - found[-1] >= APART * (counts[-1] - counts[0]):
            found.append(count)
    return found
