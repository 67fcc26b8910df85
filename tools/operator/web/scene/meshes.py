"""Meshes of a cell as a page loads them: one format, bounded, each asked for by number."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from .....config.errors import ConfigError
from .....config.urdf.meshes import find_mesh, read_mesh

if TYPE_CHECKING:
    import trimesh

PREFIX: Final = "/meshes/"
"""Addresses of meshes begin so."""
TRIANGLES: Final = 100_000
"""All meshes of a cell together are coarsened to so many: 1.8 MB, and a picture in time [1]."""
FEWEST: Final = 200
"""A part is not coarsened below this [1]."""

Colour = tuple[float, ...]


class Missing(NamedTuple):
    """A mesh that cannot be drawn."""

    link: str
    mesh: str
    """Its name in the URDF."""
    why: str


class Meshes:
    """The meshes that a cell's URDFs name, as binary glTF: STL, OBJ and COLLADA alike.

    Parts of one colour are one primitive, of a material `own`; parts without a colour have none.
    Textures become their mean colour.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self.missing: list[Missing] = []
        """Those that cannot be drawn, and why."""
        self._parts: dict[Path, list[trimesh.Trimesh]] = {}
        self._unreadable: dict[Path, str] = {}

    def address(self, link: str, urdf: Path, name: str) -> str | None:
        """Return the address `/meshes/NUMBER.glb` of a mesh that a URDF names for a link.

        None, and a row of `missing`, for one that is not found or cannot be read. Addresses hold
        nothing of the URDF's own text.
        """
        file = find_mesh(name, urdf, {})
        why = "not found" if file is None else None
        if file is not None:
            file = file.resolve()
            if file not in self._parts and file not in self._unreadable:
                try:
                    self._parts[file] = read_mesh(file)
                except ConfigError as error:
                    self._unreadable[file] = str(error)
            why = self._unreadable.get(file)
        if file is None or why is not None:
            self.missing.append(Missing(link, name, why or ""))
            return None
        return f"{PREFIX}{list(self._parts).index(file)}.glb"

    def files(self) -> dict[str, bytes]:
        """Return what is at each address."""
        each = list(self._parts.values())
        kept = min(
            1.0, TRIANGLES / max(1, sum(len(part.faces) for parts in each for part in parts))
        )
        return {f"{PREFIX}{i}.glb": _encoded(parts, kept) for i, parts in enumerate(each)}


def _encoded(parts: "list[trimesh.Trimesh]", kept: float) -> bytes:
    """Return parts as binary glTF, with about that part of their triangles `kept`."""
    import trimesh
    from trimesh.visual.material import PBRMaterial

    scene = trimesh.Scene()
    for colour, each in _by_colour(parts):
        mesh = trimesh.Trimesh(each.vertices, each.faces)  # equal corners become one
        goal = max(FEWEST, int(kept * len(mesh.faces)))
        if goal < len(mesh.faces):
            mesh = mesh.simplify_quadric_decimation(face_count=goal)
        mesh.visual = trimesh.visual.TextureVisuals(
            material=None if colour is None else PBRMaterial("own", baseColorFactor=colour)
        )
        scene.add_geometry(mesh)
    return bytes(scene.export(file_type="glb"))


def _by_colour(
    parts: "list[trimesh.Trimesh]",
) -> "Iterator[tuple[Colour | None, trimesh.Trimesh]]":
    import trimesh

    groups: dict[Colour | None, list[trimesh.Trimesh]] = {}
    for part in parts:
        groups.setdefault(_colour(part), []).append(part)
    for colour, each in groups.items():
        corners = [part.vertices for part in each]
        first = np.cumsum([0, *map(len, corners)])
        faces = [part.faces + start for part, start in zip(each, first, strict=False)]
        yield colour, trimesh.Trimesh(np.concatenate(corners), np.concatenate(faces), process=False)


def _colour(part: "trimesh.Trimesh") -> Colour | None:
    """Return the mean colour (4,) of a part, 0 to 1; None for one that its file gives none."""
    if not part.visual.defined:
        return None
    if part.visual.kind == "texture":
        material = part.visual.material
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        one = image.convert("RGBA").resize((1, 1)).getpixel((0, 0)) if image else None
        mean = np.asarray(material.main_color if one is None else one, dtype=float)
    else:
        mean = np.asarray(part.visual.main_color, dtype=float)
    return tuple(float(x) for x in (mean / 255.0).round(3))
