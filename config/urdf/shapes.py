"""Shapes of a URDF's links: their triangles, hulls, and the capsules that hold them."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

import coal
import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigError
from .elements import check_shape, floats, origin_of
from .meshes import find_mesh, read_mesh

Array = NDArray[np.float64]

# --- Shapes of links: the triangles of their meshes and primitives, in the links' frames ----------
_ROUND: Final = 16  # corners of a circle that stands for a round primitive [1]
LARGEST: Final = 100.0  # a link whose mesh is larger is one in millimetres, or none [m]


class LinkMesh(NamedTuple):
    """Triangles (t, 3, 3) of a link's shape [m], in its frame."""

    link: str
    triangles: Array
    from_visual: bool
    """True where the link has no collision shape, and what is looked at stands for it."""


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
        R, p = origin_of(element)
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


def _triangles(
    shape: ET.Element, where: str, urdf: Path, packages: Mapping[str, Path], wider: float
) -> Array:
    """Return the triangles of one shape; round primitives are `wider` than they are."""
    from trimesh import creation

    if shape.tag == "mesh":
        name = shape.get("filename", "")
        path = find_mesh(name, urdf, packages)
        if path is None:
            package = name.partition("://")[2].partition("/")[0]
            hint = f"; say where it is: --package {package}=DIR" if "package://" in name else ""
            raise ConfigError(f"{where}: <mesh filename>: value '{name}': no such file{hint}")
        return np.asarray(_mesh(path, where) * floats(shape.get("scale", "1 1 1")))
    if shape.tag == "box":
        return np.asarray(creation.box(floats(shape.get("size", ""))).triangles)
    radius = wider * float(shape.get("radius", "0"))
    half = 0.0 if shape.tag == "sphere" else 0.5 * float(shape.get("length", "0"))
    if shape.tag == "cylinder":
        profile = np.array([[0.0, -half], [radius, -half], [radius, half], [0.0, half]])
    else:
        tilts = np.linspace(-0.5 * math.pi, 0.5 * math.pi, _ROUND // 2 + 1)
        profile = radius * np.column_stack([np.cos(tilts), np.sin(tilts)])
        profile[:, 1] += np.copysign(half, tilts)
    return np.asarray(creation.revolve(profile, sections=_ROUND).triangles)


def _mesh(path: Path, where: str) -> Array:
    try:
        return np.concatenate([np.asarray(part.triangles) for part in read_mesh(path)])
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


# --- Hulls of shapes, and capsules ----------------------------------------------------------------
CORNERS: Final = 240  # corners that a search looks at; the end is held against all [1]
_SAMPLES: Final = 20_000


class Hull(NamedTuple):
    """The convex hull of a shape."""

    volume: float  # [m³]
    centre: Array  # centre of volume (3,) [m]
    moments: Array  # ∫ (|r|² 1 − r rᵀ) dV about the centre (3, 3) [m⁵]


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


class Tube(NamedTuple):
    """A capsule: in a link's frame, or in World what an arm keeps away from."""

    start: Array
    end: Array
    radius: float

    def volume(self) -> float:
        """Return its volume [m³]."""
        length = float(np.linalg.norm(self.end - self.start))
        return math.pi * self.radius**2 * (length + 4.0 / 3.0 * self.radius)

    def distance(self, points: Array) -> Array:
        """Return the distances (p,) of points (p, 3) from it, negative inside [m]."""
        along = self.end - self.start
        length2 = max(float(along @ along), 1e-18)
        part = np.clip((points - self.start) @ along / length2, 0.0, 1.0)
        off = points - self.start - part[:, None] * along
        return np.asarray(np.sqrt((off * off).sum(axis=1)) - self.radius)

    def placed(self, R: Array, p: Array) -> "Tube":
        """Return it in the frame in which its own is at R (3, 3), p (3,)."""
        return Tube(R @ self.start + p, R @ self.end + p, self.radius)

    def seen_from(self, R: Array, p: Array) -> "Tube":
        """Return it in a frame that is at R (3, 3), p (3,) of its own."""
        return Tube((self.start - p) @ R, (self.end - p) @ R, self.radius)

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Return which of some points (p, 3) are inside (p,)."""
        return np.asarray(self.distance(points) <= 0.0)


def extreme(points: Array, most: int = CORNERS) -> Array:
    """Return those of many points that are the farthest in some direction."""
    if len(points) <= most:
        return points
    draw, across = np.random.default_rng(0).normal(size=(most, 3)), points.T.copy()
    found = [(draw[i : i + 16] @ across).argmax(axis=1) for i in range(0, most, 16)]
    return np.asarray(points[np.unique(np.concatenate(found))])


def union(tubes: tuple[Tube, ...]) -> float:
    """Return the volume of capsules, what they share once [m³]."""
    if len(tubes) == 1:
        return tubes[0].volume()
    low = np.min([np.minimum(t.start, t.end) - t.radius for t in tubes], axis=0)
    high = np.max([np.maximum(t.start, t.end) + t.radius for t in tubes], axis=0)
    points = np.random.default_rng(0).uniform(low, high, size=(_SAMPLES, 3))
    inside = np.any([t.holds(points) for t in tubes], axis=0)
    return float(np.prod(high - low) * inside.mean())
