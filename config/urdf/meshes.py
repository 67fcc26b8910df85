"""Meshes that a URDF names: where their files are looked for, and their triangles.

A file is looked for beside the URDF and above it, in `ROS_PACKAGE_PATH` and `AMENT_PREFIX_PATH`,
in installed Python packages (and the `share` of those that hold a prefix), and where
`--package NAME=DIR` says.
"""

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import unquote

import numpy as np

from ..errors import ConfigError

if TYPE_CHECKING:
    import trimesh

KINDS: Final = (".stl", ".obj", ".dae", ".ply", ".glb", ".gltf")
"""Ends of the names of mesh files that are read: none is unpacked."""
LARGEST_FILE: Final = 1 << 26
"""A mesh file of more bytes is refused: 1.3 million triangles of a binary STL [B]."""

_UP = 6
"""Folders above the URDF's that are looked into [1]."""


def packages_of(given: Sequence[str]) -> dict[str, Path]:
    """Return the folders that `--package NAME=DIR` says. Raises `ConfigError`."""
    found = {}
    for text in given:
        name, is_there, folder = text.partition("=")
        if not (name and is_there and Path(folder).is_dir()):
            raise ConfigError(f"--package: value '{text}': must be NAME=DIR, a folder that exists")
        found[name] = Path(folder).resolve()
    return found


def find_mesh(name: str, urdf: Path, packages: Mapping[str, Path]) -> Path | None:
    """Return the file that a URDF calls `name`, or None where there is none."""
    return next((path for path in _places(name, urdf, packages) if path.is_file()), None)


def read_mesh(path: Path) -> "list[trimesh.Trimesh]":
    """Return the parts of a mesh file with their looks, in the file's own frame [m].

    A COLLADA file is scaled by its unit; its up axis is ignored, as ROS does. Reads STL, OBJ,
    COLLADA, PLY and glTF. Raises `ConfigError` for a file that is too large, of another kind, or
    without triangles of finite numbers.
    """
    if path.suffix.lower() not in KINDS:
        raise ConfigError(f"{path}: no mesh: its name ends in none of {', '.join(KINDS)}")
    try:
        size = path.stat().st_size
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    if size > LARGEST_FILE:
        raise ConfigError(f"{path}: {size} bytes: must be at most {LARGEST_FILE}")
    import trimesh

    try:
        scene = trimesh.load_scene(str(path), process=False)
        if path.suffix.lower() == ".dae":
            scene = scene.convert_units("meters")
        # A part that stands in several places of its file comes back in each of them.
        found = scene.dump()
    except Exception as error:  # noqa: BLE001  readers of eight formats raise what they like
        words = " ".join(str(error).split())[:160]
        raise ConfigError(f"{path}: cannot be read: {words or type(error).__name__}") from None
    parts = [part for part in found if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    if not parts or not all(np.isfinite(part.vertices).all() for part in parts):
        raise ConfigError(f"{path}: holds no triangles of finite numbers")
    return parts


def _places(name: str, urdf: Path, packages: Mapping[str, Path]) -> Iterator[Path]:
    scheme, is_uri, path = name.partition("://")
    if not is_uri:
        yield urdf.parent / name
        yield from _beside(Path(name).parts, urdf)
        return
    path = unquote(path)
    if scheme == "file":
        yield Path("/") / path.lstrip("/")
        return
    package, _, rest = path.partition("/")
    if package in packages:
        yield packages[package] / rest
    yield from _beside((package, *Path(rest).parts), urdf)
    for root in _roots():
        yield root / package / rest
        yield root / "share" / package / rest
        yield root / package.replace("-", "_") / rest


def _beside(parts: tuple[str, ...], urdf: Path) -> Iterator[Path]:
    """Yield the path from every folder above the URDF, whole and without its package's name."""
    above = urdf.resolve().parents
    for folder in above[:_UP]:
        yield folder.joinpath(*parts)
        yield folder.joinpath(*parts[1:])


def _roots() -> Iterator[Path]:
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        yield from (Path(p) for p in os.environ.get(variable, "").split(os.pathsep) if p)
    for folder in (*sys.path, sys.prefix):
        yield Path(folder)
        yield Path(folder) / "cmeel.prefix"
