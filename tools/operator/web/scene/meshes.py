"""Meshes of a robot: the files that its URDF names, and the addresses that a page loads them by."""

import xml.etree.ElementTree as ET
from pathlib import Path

from .....config.load import Cell

SUFFIXES = (".stl", ".obj", ".dae")
"""Formats that the page reads."""
PREFIX = "/meshes/"
"""Addresses of meshes begin so."""


def mesh_files(cell: Cell) -> dict[str, Path]:
    """Return the file of each address `/meshes/NUMBER.SUFFIX` in the description of a cell.

    Addresses hold nothing of the URDF's own text. A mesh that is not found, or of a format that no
    page reads, has none: the link's collision shapes are drawn in its place.
    """
    addresses = {file: address for address, file in _numbered(cell)}
    return {address: file for file, address in addresses.items()}


def address_of(cell: Cell) -> dict[Path, str]:
    """Return the address of each file, the other way round than `mesh_files`."""
    return {file: address for address, file in mesh_files(cell).items()}


def resolved(urdf: Path, filename: str) -> Path | None:
    """Return the file that a URDF means by a mesh's name, None where there is none.

    `package://NAME/REST` is looked for in the folders above the URDF, with NAME and without.
    """
    if filename.startswith("package://"):
        name = filename.removeprefix("package://")
        rest = name.partition("/")[2]
        for folder in urdf.resolve().parents:
            for candidate in (folder / name, folder / rest):
                if rest and candidate.is_file():
                    return candidate.resolve()
        return None
    path = urdf.parent / filename.removeprefix("file://")
    return path.resolve() if path.is_file() else None


def _numbered(cell: Cell) -> list[tuple[str, Path]]:
    found: list[Path] = []
    for part in cell.parts:
        root = ET.fromstring(part.robot.description(looks=True))
        for mesh in root.iter("mesh"):
            file = resolved(part.robot.urdf, mesh.get("filename", ""))
            if file is not None and file.suffix.lower() in SUFFIXES and file not in found:
                found.append(file)
    return [(f"{PREFIX}{i}{file.suffix.lower()}", file) for i, file in enumerate(found)]
