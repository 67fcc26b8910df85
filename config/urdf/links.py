"""Links of a URDF: which carries which, where they are, and their shapes as triangles."""

import math
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigError
from .elements import check_shape, end_of, floats, origin_of
from .meshes import find_mesh, read_mesh

Array = NDArray[np.float64]


class LinkTree:
    """Links of a URDF, and the joints that each carries."""

    def __init__(self, root: ET.Element) -> None:
        self.links = {link.get("name", ""): link for link in root.findall("link")}
        self.above = {end_of(joint, "child"): joint for joint in root.findall("joint")}
        """The joint that carries each link, but the roots."""
        self._below: dict[str, list[ET.Element]] = {}
        for joint in root.findall("joint"):
            self._below.setdefault(end_of(joint, "parent"), []).append(joint)
        self.roots = [link for link in self.links if link not in self.above]
        """Names of the links that no joint carries."""

    def below(self, link: str) -> list[ET.Element]:
        """Return the joints that a link carries."""
        return self._below.get(link, [])

    def walk(
        self, link: str, through: Callable[[ET.Element], bool] = lambda _joint: True
    ) -> Iterator[tuple[str, Array, Array]]:
        """Yield a link and all that it carries, those nearer to it first, all joints at zero.

        Each with its attitude (3, 3) and place (3,) in the first; `through` says beyond which
        joints.
        """
        seen, waiting = {link}, deque([(link, np.eye(3), np.zeros(3))])
        while waiting:
            name, R, p = waiting.popleft()
            yield name, R, p
            for joint in filter(through, self.below(name)):
                if (child := end_of(joint, "child")) not in seen:
                    seen.add(child)
                    turn, shift = origin_of(joint)
                    waiting.append((child, R @ turn, p + R @ shift))

    def mass(self, link: str) -> float:
        """Return the mass that the URDF says of a link, 0 where it says none [kg]."""
        told = self.links[link].find("inertial/mass") if link in self.links else None
        return 0.0 if told is None else _number(told.get("value"))


def movable(joint: ET.Element) -> bool:
    """Return whether a joint moves along or about one axis."""
    return joint.get("type") in ("revolute", "continuous", "prismatic")


def _number(text: str | None) -> float:
    try:
        value = float(text or "0")
    except ValueError:
        return 0.0
    return value if math.isfinite(value) and value > 0.0 else 0.0


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
