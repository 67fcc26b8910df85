"""Shapes of links: the triangles of their meshes and primitives, in the links' frames."""

import itertools
import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
from numpy.typing import NDArray

from ....config.errors import ConfigError
from ....config.urdf.elements import check_shape
from ....config.urdf.meshes import find_mesh, read_mesh

Array = NDArray[np.float64]
_ROUND = 16
"""Corners of a circle that stands for a round primitive [1]."""
LARGEST = 100.0
"""A link whose mesh is larger is one in millimetres, or none [m]."""


class LinkMesh(NamedTuple):
    """Triangles (t, 3, 3) of a link's shape [m], in its frame."""

    link: str
    triangles: Array
    from_visual: bool
    """True where the link has no collision shape, and what is looked at stands for it."""


class Hull(NamedTuple):
    """The convex hull of a shape."""

    volume: float
    """[m³]."""
    centre: Array
    """Centre of volume (3,) [m]."""
    moments: Array
    """∫ (|r|² 1 − r rᵀ) dV about the centre (3, 3) [m⁵]."""


def link_shape(
    link: ET.Element,
    urdf: Path,
    packages: Mapping[str, Path],
    *,
    meshes_only: bool = False,
    around: bool = True,
) -> LinkMesh | None:
    """Return the shape of a link, or None for one that has none.

    With `meshes_only`, of a link with collision shapes those that are meshes. Corners of round
    primitives lie `around` them, so that they hold all of it, or on them. Raises `ConfigError`
    for a mesh that is not found or cannot be read, with file, link and name.
    """
    name = link.get("name", "")
    collisions, visuals = link.findall("collision"), link.findall("visual")
    chosen = collisions or visuals
    found = []
    for element in chosen:
        where = f"{urdf}: link '{name}': <{element.tag}>"
        check_shape(element, f"{urdf}: link '{name}'")
        geometry = element.find("geometry")
        if geometry is None or (meshes_only and collisions and geometry.find("mesh") is None):
            continue
        R, p = placement(element)
        scale = 1.0 / math.cos(math.pi / _ROUND) if around else 1.0
        found.append(_triangles(geometry[0], where, urdf, packages, scale) @ R.T + p)
    if not found:
        return None
    triangles = np.concatenate(found)
    size = float(np.ptp(triangles.reshape(-1, 3), axis=0).max())
    if size > LARGEST:
        raise ConfigError(
            f"{urdf}: link '{name}': its shape is {size:.3g} m long: meshes in millimetres have "
            '<mesh scale="0.001 0.001 0.001">'
        )
    return LinkMesh(name, triangles, not collisions)


def hull_of(points: Array) -> Hull | None:
    """Return the convex hull of points (p, 3); None for points that span no volume."""
    corners = coal.StdVec_Vec3s()
    for point in points:
        corners.append(point)
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 4 or spread[2] < 1e-6 * max(spread[0], 1e-12):
        return None
    try:
        hull = coal.Convex.convexHull(corners, True, "Qt")
    except (RuntimeError, ValueError):
        return None
    volume = float(hull.computeVolume())
    if not volume > 1e-12:
        return None
    centre = np.array(hull.computeCOM())
    moments = np.array(hull.computeMomentofInertiaRelatedToCOM())
    return Hull(volume, centre, moments)


def placement(element: ET.Element | None) -> tuple[Array, Array]:
    """Return rotation (3, 3) and translation (3,) of an element's `<origin>`."""
    origin = None if element is None else element.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    roll, pitch, yaw = (float(x) for x in origin.get("rpy", "0 0 0").split())
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    R = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    return R, np.array([float(x) for x in origin.get("xyz", "0 0 0").split()])


def _triangles(
    shape: ET.Element, where: str, urdf: Path, packages: Mapping[str, Path], wider: float
) -> Array:
    """Return the triangles of one shape; round primitives are `wider` than they are."""
    if shape.tag == "mesh":
        name = shape.get("filename", "")
        path = find_mesh(name, urdf, packages)
        if path is None:
            package = name.partition("://")[2].partition("/")[0]
            hint = f"; say where it is: --package {package}=DIR" if "package://" in name else ""
            raise ConfigError(f"{where}: <mesh filename>: value '{name}': no such file{hint}")
        scale = np.array([float(x) for x in shape.get("scale", "1 1 1").split()])
        return np.asarray(_mesh(path, where) * scale)
    up = np.array([0.0, 0.0, 1.0])
    if shape.tag == "box":
        half = 0.5 * np.array([float(x) for x in shape.get("size", "").split()])
        square = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]])
        return _between([(square - up) * half, (square + up) * half])
    radius = float(shape.get("radius", "0"))
    half_length = 0.5 * float(shape.get("length", "0"))
    turns = np.arange(_ROUND) * (2.0 * math.pi / _ROUND)
    outside = radius * wider
    circle = np.stack([np.cos(turns), np.sin(turns), np.zeros(_ROUND)], axis=1)
    if shape.tag == "cylinder":
        return _between([outside * circle + s * half_length * up for s in (-1.0, 1.0)])
    tilts = np.linspace(-0.5 * math.pi, 0.5 * math.pi, _ROUND // 2 + 1)
    middle = half_length if shape.tag == "capsule" else 0.0
    return _between(
        [
            outside * (math.cos(a) * circle + math.sin(a) * up) + math.copysign(middle, a) * up
            for a in tilts
        ]
    )


def _mesh(path: Path, where: str) -> Array:
    try:
        return np.concatenate([np.asarray(part.triangles) for part in read_mesh(path)])
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def _between(rings: list[Array]) -> Array:
    """Return the closed surface (t, 3, 3) through rings of k corners (k, 3), and two lids."""
    sides = []
    for low, high in itertools.pairwise(rings):
        after_low, after_high = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
        sides += [np.stack([low, after_low, high], axis=1)]
        sides += [np.stack([after_low, after_high, high], axis=1)]
    for lid in (rings[0], rings[-1]):
        first = np.broadcast_to(lid[0], lid[1:-1].shape)
        sides += [np.stack([first, lid[1:-1], lid[2:]], axis=1)]
    return np.concatenate(sides)
