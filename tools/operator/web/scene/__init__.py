"""The cell as the console's page draws it: frames, shapes and surroundings, as JSON."""

from .description import Scene, describe, scene_of
from .meshes import PREFIX

__all__ = ["PREFIX", "Scene", "describe", "scene_of"]
