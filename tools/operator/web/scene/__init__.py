"""The cell as the console's page draws it: frames, shapes and surroundings, as JSON."""

from .description import describe
from .meshes import mesh_files
from .routes import add_routes

__all__ = ["add_routes", "describe", "mesh_files"]
