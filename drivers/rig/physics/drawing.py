"""Pictures without OpenGL: solids as flat polygons in a depth buffer, tags as warped textures."""

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....config.schema.surroundings import CameraSection
from ...vision.opencv import cv2

Picture = NDArray[np.uint8]
Array = NDArray[np.float64]

EMISSION: Final = 0.35
"""Light that a tag gives by itself, so that its white is white [1]."""
_NEAR_M: Final = 0.01
"""What is nearer is not drawn [m]."""
_FAR_M: Final = 30.0
"""Half side of a plane without end [m]."""
_SAFE_PX: Final = 8000.0
"""Polygons that reach farther out of the picture are clipped in space first [px]."""
_AROUND: Final = 16
"""Sides of a round solid."""
_LENS: Final = np.diag([1.0, -1.0, -1.0])
"""MuJoCo's cameras look along -z with y up, the Lens along z with y down."""
_SKY: Final = (118, 130, 144)
_DRAWN_GROUPS: Final = 3
"""Geoms of groups from this one on are not drawn, as in MuJoCo's pictures."""
_SAMPLES: Final = ((160.0, 4), (400.0, 2))
"""Samples a pixel along each axis for tags of up to so many pixels; larger ones take one."""


class _Solid(NamedTuple):
    """A convex solid in the axes of its geom: corners, and faces counter-clockwise from outside."""

    geom: int
    corners: Array
    """(k, 3) [m]."""
    faces: tuple[NDArray[np.intp], ...]
    first: NDArray[np.intp]
    """A corner of each face (m,)."""
    normals: Array
    """(m, 3)."""
    colour: Array
    """(3,) 0 to 255."""


class Tag(NamedTuple):
    """A tag: its body, the geom that says whether it is seen, and its front."""

    body: int
    geom: int
    half: float
    """Half of the side of the texture's square, which lies at z = 0 about the body's origin [m]."""
    texture: NDArray[np.uint8]
    """(n, n), grey; its upper left is at (-half, half)."""


class _Light(NamedTuple):
    """A light, in the Lens."""

    at: Array
    direction: Array
    inner: float | None
    """Cosine of half its cone; None for one that is infinitely far."""
    ambient: Array
    diffuse: Array


class _View(NamedTuple):
    """Pinhole camera of one picture, and the picture."""

    R_lens_world: Array
    origin: Array
    """The Lens in World (3,) [m]."""
    focal: float
    middle: tuple[float, float]
    colour: Picture
    inverse_depth: NDArray[np.float32]
    """(h, w) [1/m]; 0 is infinitely far."""
    lights: tuple["_Light", ...]
    head: tuple[Array, Array]
    """Ambient and diffuse colour (3,) of the light at the camera."""

    def light(self, point: Array, normal: Array) -> Array:
        """Return the light (3,) on a face at a point of the Lens (3,) [1]."""
        ambient, diffuse = self.head
        light = ambient - diffuse * min(0.0, float(normal @ point) / float(np.linalg.norm(point)))
        for at, direction, inner, ambient, diffuse in self.lights:
            ray = direction if inner is None else point - at
            ray = ray / np.linalg.norm(ray)
            light = light + ambient
            if inner is None or ray @ direction > inner:
                light = light + diffuse * max(0.0, float(-normal @ ray))
        return np.asarray(light)


class Drawing:
    """Draws what one camera sees of a model."""

    def __init__(
        self, model: "mujoco.MjModel", camera: CameraSection, tags: Mapping[str, Tag]
    ) -> None:
        self._model, self._camera, self._tags = model, camera, tuple(tags.values())
        fronts = {tag.geom for tag in self._tags}
        self._solids = [
            solid
            for i in range(model.ngeom)
            if i not in fronts and (solid := _solid(model, i)) is not None
        ]
        self._pyramids = [_pyramid(tag.texture) for tag in self._tags]

    def picture(self, data: "mujoco.MjData") -> Picture:
        """Return an RGB picture (h, w, 3) of the bodies where they are in `data`."""
        width, height = self._camera.size
        seen = data.camera(self._camera.name)
        R_lens_world = _LENS @ seen.xmat.reshape(3, 3).T
        colour = np.empty((height, width, 3), dtype=np.uint8)
        colour[:] = _SKY
        depth = np.zeros((height, width), dtype=np.float32)
        middle = ((width - 1) / 2, (height - 1) / 2)
        head = self._model.vis.headlight
        view = _View(
            R_lens_world,
            seen.xpos,
            self._camera.focal[0],
            middle,
            colour,
            depth,
            self._lights(data, R_lens_world, seen.xpos),
            (head.ambient.astype(float), head.diffuse.astype(float)),
        )
        for solid in self._solids:
            if self._model.geom_group[solid.geom] < _DRAWN_GROUPS:
                _draw_solid(view, solid, data)
        for tag, pyramid in zip(self._tags, self._pyramids, strict=True):
            if self._model.geom_group[tag.geom] < _DRAWN_GROUPS:
                _draw_tag(view, tag, pyramid, data)
        return colour

    def close(self) -> None:
        """Do nothing: no library is held."""

    def _lights(
        self, data: "mujoco.MjData", R_lens_world: Array, origin: Array
    ) -> tuple[_Light, ...]:
        model, lights = self._model, []
        for i in np.flatnonzero(model.light_active):
            far = model.light_type[i] == mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
            lights.append(
                _Light(
                    R_lens_world @ (data.light_xpos[i] - origin),
                    R_lens_world @ data.light_xdir[i],
                    None if far else math.cos(math.radians(min(180.0, model.light_cutoff[i]))),
                    model.light_ambient[i].astype(float),
                    model.light_diffuse[i].astype(float),
                )
            )
        return tuple(lights)


def _draw_solid(view: _View, solid: _Solid, data: "mujoco.MjData") -> None:
    R = view.R_lens_world @ data.geom_xmat[solid.geom].reshape(3, 3)
    corners = solid.corners @ R.T + view.R_lens_world @ (data.geom_xpos[solid.geom] - view.origin)
    normals = solid.normals @ R.T
    offsets = np.einsum("ij,ij->i", normals, corners[solid.first])
    whole = corners[:, 2].min() > _NEAR_M
    pixels = _projected(view, corners) if whole else corners[:, :2]
    whole = whole and np.abs(pixels).max() < _SAFE_PX
    for i in np.flatnonzero(offsets < -1e-9):
        face = solid.faces[i]
        polygon = pixels[face] if whole else _projected(view, _clipped(view, corners[face]))
        if len(polygon) < 3:
            continue
        region = _region(view, polygon)
        if region is None:
            continue
        nearer = _nearer(view, region, polygon, normals[i] / offsets[i])
        light = view.light(corners[face].mean(axis=0), normals[i])
        view.colour[region][nearer] = np.minimum(255.0, light * solid.colour)


def _draw_tag(
    view: _View, tag: Tag, pyramid: tuple[NDArray[np.uint8], ...], data: "mujoco.MjData"
) -> None:
    R = view.R_lens_world @ data.xmat[tag.body].reshape(3, 3)
    p = view.R_lens_world @ (data.xpos[tag.body] - view.origin)
    square = tag.half * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    corners, normal = square @ R.T + p, R[:, 2]
    offset = float(normal @ p)
    if corners[:, 2].min() < _NEAR_M or offset > -1e-9:
        return
    polygon = _projected(view, corners)
    region = _region(view, polygon)
    if np.abs(polygon).max() > _SAFE_PX or region is None:
        return
    nearer = _nearer(view, region, polygon, normal / offset)
    side = math.sqrt(abs(cv2.contourArea(polygon.astype(np.float32))))
    samples = next((n for most, n in _SAMPLES if side <= most), 1)
    texture = next((t for t in pyramid if len(t) <= 2.0 * side * samples), pyramid[-1])
    # Pixel centres are at whole numbers; a sample's is a part of a pixel beside that.
    y, x = region[0].start, region[1].start
    into = samples * (polygon - (x, y)) + 0.5 * (samples - 1)
    n = len(texture)
    of = np.array([[0, 0], [n, 0], [n, n], [0, n]]) - 0.5
    way = cv2.getPerspectiveTransform(of.astype(np.float32), into.astype(np.float32))
    size = (samples * nearer.shape[1], samples * nearer.shape[0])
    warped = cv2.warpPerspective(
        texture, way, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    if samples > 1:
        warped = cv2.resize(warped, nearer.shape[::-1], interpolation=cv2.INTER_AREA)
    light = np.minimum(1.0, EMISSION + view.light(p, normal))
    view.colour[region][nearer] = warped[nearer][:, None] * light


def _projected(view: _View, points: Array) -> Array:
    """Return points (k, 3) of the Lens in the picture (k, 2) [px]."""
    return np.asarray(view.focal * points[:, :2] / points[:, 2:] + view.middle)


def _region(view: _View, polygon: Array) -> tuple[slice, slice] | None:
    """Return the rows and columns that a polygon (k, 2) [px] may cover; None outside."""
    height, width = view.inverse_depth.shape
    x0, y0 = np.maximum(np.floor(polygon.min(axis=0)), 0.0).astype(int)
    x1, y1 = np.minimum(np.ceil(polygon.max(axis=0)) + 1, (width, height)).astype(int)
    return (slice(y0, y1), slice(x0, x1)) if x0 < x1 and y0 < y1 else None


def _nearer(
    view: _View, region: tuple[slice, slice], polygon: Array, plane: Array
) -> NDArray[np.bool_]:
    """Return where a polygon is the nearest thing so far, in its region, and keep its depth.

    `plane` (3,) [1/m] are its points: plane · point = 1.
    """
    depth = view.inverse_depth[region]
    x = np.arange(region[1].start, region[1].stop, dtype=np.float32)
    y = np.arange(region[0].start, region[0].stop, dtype=np.float32)[:, None]
    ways = np.roll(polygon, -1, axis=0) - polygon
    turn = 1.0 if np.sum(polygon[:, 0] * ways[:, 1] - polygon[:, 1] * ways[:, 0]) > 0.0 else -1.0
    across = turn * np.column_stack([-ways[:, 1], ways[:, 0]])
    rest = -np.einsum("ij,ij->i", across, polygon).astype(np.float32)
    across = across.astype(np.float32)
    columns = across[:, :1] * x + rest[:, None]
    inside = (columns[:, None, :] + across[:, 1:, None] * y >= 0.0).all(axis=0)
    u = (x - np.float32(view.middle[0])) / np.float32(view.focal)
    v = (y - np.float32(view.middle[1])) / np.float32(view.focal)
    slope = plane.astype(np.float32)
    inverse = v * slope[1] + (u * slope[0] + slope[2])
    nearer = inside & (inverse > depth)
    np.copyto(depth, inverse, where=nearer)
    return np.asarray(nearer)


def _clipped(view: _View, polygon: Array) -> Array:
    """Return the part of a polygon (k, 3) that is ahead of the Lens and inside its cone."""
    x, y = (np.array(view.middle) + 2.0) / view.focal
    for bound, least in (
        ((0.0, 0.0, 1.0), _NEAR_M), ((1.0, 0.0, x), 0.0), ((-1.0, 0.0, x), 0.0),
        ((0.0, 1.0, y), 0.0), ((0.0, -1.0, y), 0.0),
    ):  # fmt: skip
        inside = polygon @ np.array(bound) - least
        kept: list[Array] = []
        for i in range(len(polygon)):
            a, b = inside[i - 1], inside[i]
            if (a < 0.0) != (b < 0.0):
                kept.append(polygon[i - 1] + a / (a - b) * (polygon[i] - polygon[i - 1]))
            if b >= 0.0:
                kept.append(polygon[i])
        if not kept:
            return np.empty((0, 3))
        polygon = np.array(kept)
    return polygon


def _pyramid(texture: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], ...]:
    """Return a texture and its halves, down to four pixels a cell."""
    levels = [texture]
    while len(levels) < 4:
        half = (len(levels[-1]) // 2,) * 2
        smaller = cv2.resize(levels[-1], half, interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(smaller, dtype=np.uint8))
    return tuple(levels)


def _solid(model: "mujoco.MjModel", geom: int) -> _Solid | None:
    """Return a geom's solid; None for one that is not to be seen."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    rgba, material = model.geom_rgba[geom], int(model.geom_matid[geom])
    if material >= 0:
        rgba = model.mat_rgba[material]
    if rgba[3] < 0.5:
        return None
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        x, y = (float(side) or _FAR_M for side in size[:2])
        made = np.array([[x, y, 0], [-x, y, 0], [-x, -y, 0], [x, -y, 0]]), [np.arange(4)]
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        made = _lathe(np.array([math.sqrt(2.0)] * 2), np.array([-1.0, 1.0]), 4)
        made = made[0] * size, made[1]
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        made = _lathe(np.full(2, size[0]), np.array([-size[1], size[1]]), _AROUND)
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        angles = np.linspace(-0.47 * math.pi, 0.47 * math.pi, 8)
        middles = np.where(angles < 0.0, -size[1], size[1])
        made = _lathe(size[0] * np.cos(angles), size[0] * np.sin(angles) + middles, _AROUND)
    elif kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        angles = np.linspace(-0.47 * math.pi, 0.47 * math.pi, 8)
        made = _lathe(np.cos(angles), np.sin(angles), _AROUND)
        axes = np.full(3, size[0]) if kind == mujoco.mjtGeom.mjGEOM_SPHERE else size
        made = made[0] * axes, made[1]
    elif kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.mesh(int(model.geom_dataid[geom]))
        corners = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]].astype(float)
        triangles = model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]]
        made = corners, [np.array(t, dtype=np.intp) for t in triangles]
    else:
        return None
    corners, faces = made
    normals = np.array([_normal(corners[face]) for face in faces])
    first = np.array([face[0] for face in faces])
    return _Solid(geom, corners, tuple(faces), first, normals, 255.0 * rgba[:3])


def _lathe(radii: Array, heights: Array, around: int) -> tuple[Array, list[NDArray[np.intp]]]:
    """Return corners and faces of a solid of revolution about z, its rings from below."""
    angles = 2.0 * math.pi * (np.arange(around) + 0.5) / around
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    corners = np.vstack(
        [
            np.column_stack([r * ring, np.full(around, z)])
            for r, z in zip(radii, heights, strict=True)
        ]
    )
    faces = [np.arange(around)[::-1], np.arange(around) + around * (len(radii) - 1)]
    for k in range(len(radii) - 1):
        for i in range(around):
            j = (i + 1) % around
            faces.append(around * k + np.array([i, j, j + around, i + around]))
    return corners, faces


def _normal(polygon: Array) -> Array:
    """Return the unit normal (3,) of a polygon (k, 3), by Newell; zeros without an area."""
    normal = np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0)
    return np.asarray(normal / max(float(np.linalg.norm(normal)), 1e-12))
