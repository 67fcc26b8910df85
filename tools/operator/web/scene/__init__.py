"""Geometry of a cell for the page's scene."""

from pathlib import Path

from .....config.load import Cell


def describe(cell: Cell) -> dict[str, object]:
    """Return the geometry of a cell as JSON."""
    return {"cell": cell.config.name}


def mesh_files(_cell: Cell) -> dict[str, Path]:
    """Return the file of each address below `/meshes/`."""
    return {}
