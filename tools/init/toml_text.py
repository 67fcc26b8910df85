"""Values as a TOML file has them, and the paths that it names."""

import math
import os
from collections.abc import Iterable
from pathlib import Path


def path_from(folder: Path, file: Path) -> str:
    """Return the path of a file as seen from a folder, so that both can move together.

    Whole where they share no folder but the root.
    """
    folder, file = folder.resolve(), file.resolve()
    if file.is_relative_to(folder):
        return f"./{file.relative_to(folder)}"
    shared = os.path.commonpath([folder, file])
    return str(file) if shared == os.sep else os.path.relpath(file, folder)


def quoted(text: str) -> str:
    """Return a string in quotes."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def plain(text: str) -> str:
    """Return a text that may stand in a comment or a string: a line, not too long."""
    return "".join(c if c.isprintable() and c not in '"\\' else "_" for c in text)[:120]


def number(value: float) -> str:
    """Return a number with four digits, and a point."""
    text = f"{float(value):.4g}"
    return text if any(c in text for c in ".en") else f"{text}.0"


def bound(value: float) -> str:
    """Return a positive number that is no more than a bound, with four digits."""
    if value <= 0.0:
        return number(value)
    digit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return number(math.floor(value / digit * (1.0 + 1e-12)) * digit)


def numbers(values: Iterable[float], digits: int = 4) -> str:
    """Return a list of numbers, so many digits after the point; small ones as powers of ten."""
    shown = []
    for value in map(float, values):
        small = 0.0 < abs(value) < 10.0 ** (1 - digits)
        text = f"{value:.3e}" if small else f"{value:.{digits}f}"
        shown.append("0.0" if float(text) == 0.0 else text)
    return "[" + ", ".join(shown) + "]"
