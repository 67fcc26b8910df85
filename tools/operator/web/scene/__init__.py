"""Geometry of a cell for the page's scene."""

from aiohttp import web

from .....config.load import Cell


def describe(cell: Cell) -> dict[str, object]:
    """Return the geometry of a cell as JSON."""
    return {"cell": cell.config.name}


def add_routes(app: web.Application, cell: Cell) -> None:
    """Add the scene's own routes, such as meshes and pictures, below the page's login."""
