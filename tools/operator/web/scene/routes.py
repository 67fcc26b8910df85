"""Addresses of the scene's own files, behind the page's login."""

from aiohttp import web

from .....config.load import Cell
from .meshes import PREFIX, mesh_files


def add_routes(app: web.Application, cell: Cell) -> None:
    """Serve the meshes of a cell, and no other file: a page asks by number."""
    files = mesh_files(cell)

    async def mesh(request: web.Request) -> web.StreamResponse:
        file = files.get(request.path)
        if file is None:
            raise web.HTTPNotFound
        return web.FileResponse(file, headers={"Content-Type": "application/octet-stream"})

    app.router.add_get(f"{PREFIX}{{name}}", mesh)
