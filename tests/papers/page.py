"""The page: a section for each paper, in it a table of numbers and a picture for each exhibit."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from .exhibit import Exhibit, Number, Shown
from .exhibits import PAPERS

PAGE: Final = "README.md"
BAR: Final = "\\|"
"""A bar inside a table's cell."""
RESIDUE: Final = 1e-6
"""An upper bound this small is one of rounding and truncation: of what stays below it only the
power of ten is told, since its digits are those of one machine."""
FINEST: Final = 1e-3
"""Part of half a range that is still told."""
HEAD: Final = """# The five papers, computed again

Every table, figure and result that the five papers print, computed by telerobot: our curves in
colour over what is printed, in black. This page and its pictures are written by `make papers`,
which fails when a number leaves the range beside it.

*Allowed* is the printed value with the tolerance of its digits or of its drawing. Where a paper
prints a picture or an inequality only, the range is that inequality, or an independent
computation, or, with *left open*, what we got when the row was written. Of what only rounding
leaves, the power of ten is told that it stays below.

"""


def write(folder: Path, shown: Mapping[str, Shown]) -> None:
    """Write the pictures that were made, and the page if all exhibits were shown."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, found in shown.items():
        (folder / f"{name}.svg").write_text(found.picture, encoding="utf-8")
    if all(name in shown for paper in PAPERS for name in paper.exhibits):
        (folder / PAGE).write_text(text(shown), encoding="utf-8")


def text(shown: Mapping[str, Shown]) -> str:
    """Return the page as Markdown."""
    parts = [HEAD]
    for paper in PAPERS:
        parts.append(f"## {paper.title}\n\n{paper.source}.\n\n")
        parts += [section(name, exhibit, shown[name]) for name, exhibit in paper.exhibits.items()]
    return "".join(parts).rstrip("\n") + "\n"


def section(name: str, exhibit: Exhibit, shown: Shown) -> str:
    """Return the section of an exhibit."""
    paragraphs = [
        f"### {heading(exhibit)}",
        f"**Printed.** {exhibit.printed}",
        f"![{exhibit.title}]({name}.svg)",
        exhibit.shown,
        "\n".join(
            (
                "| number | unit | printed | allowed | telerobot |",
                "|---|---|---|---|---|",
                *(row(number) for number in shown.numbers),
            )
        ),
    ]
    if exhibit.wrong:
        paragraphs.append(f"**Wrong or open in print.** {exhibit.wrong}")
    paragraphs.append("\n".join(("```", *exhibit.command.split("; "), "```")))
    return "\n\n".join(paragraphs) + "\n\n"


def heading(exhibit: Exhibit) -> str:
    """Return the heading of an exhibit's section."""
    return f"{exhibit.place}: {exhibit.title}"


def row(number: Number) -> str:
    """Return a number's row of the table."""
    cells = number.what, number.unit, number.printed, allowed(number), ours(number)
    return f"| {' | '.join(cell.replace('|', BAR) for cell in cells)} |"


def ours(number: Number) -> str:
    """Return our value in words: to four digits, and no finer than its range can tell."""
    value, half = number.ours, 0.5 * (number.high - number.low)
    if math.isinf(number.low) and 0.0 < value <= number.high <= RESIDUE:
        return f"< {10.0 ** (math.floor(math.log10(value)) + 1):.0e}"
    if 0.0 < half < math.inf and abs(value) < FINEST * half:
        value = 0.0
    return f"{value:.4g}"


def allowed(number: Number) -> str:
    """Return the range of a number in words."""
    if math.isinf(number.low):
        return f"≤ {number.high:.4g}"
    if math.isinf(number.high):
        return f"≥ {number.low:.4g}"
    middle, half = 0.5 * (number.low + number.high), 0.5 * (number.high - number.low)
    return f"{middle:.5g} ± {half:.2g}"
