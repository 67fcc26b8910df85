"""Rendered cameras: pictures of the virtual world, from a copy of its model."""

import os
import weakref
from collections.abc import Collection, Mapping, Sequence
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell
from ....config.schema.section import PoseSection
from ....config.schema.surroundings import CameraSection, RigTagSection
from ....protocols.messages.rig import RigTruth
from ...device import DeviceError
from ...vision.opencv import cells, marker
from .drawing import EMISSION, Drawing, Tag
from .geoms import quaternion
from .movers import FREE
from .scene import build_spec

Picture = NDArray[np.uint8]

_CELL_PX = 32
"""Texture pixels for each cell of a tag."""
_THICKNESS = 0.002
"""Of a tag's panel [m]."""
_LENS_TO_CAMERA = np.diag([1.0, -1.0, -1.0])
"""MuJoCo's cameras look along -z with y up, the Lens along z with y down."""
_COVERED = 5
"""Geoms of this group are not drawn."""

_OFF = ("disable", "disabled", "off", "false", "0")
"""Values of the environment's MUJOCO_GL with which MuJoCo renders nothing."""

_unusable: list[str] = []
"""Why MuJoCo can render nothing in this process, once that is known.

A graphics library that failed to start is left half initialised: asked a second time, it aborts the
process.
"""


class Eye(Protocol):
    """Maker of one camera's pictures."""

    def picture(self, data: "mujoco.MjData") -> Picture:
        """Return an RGB picture (h, w, 3) of the bodies where they are in `data`."""
        ...

    def close(self) -> None:
        """Let go of what it holds."""
        ...


class _OpenGL:
    """A camera whose pictures MuJoCo renders. Raises what the graphics library raises."""

    def __init__(self, model: "mujoco.MjModel", camera: CameraSection) -> None:
        width, height = camera.size
        self._name, self._renderer = camera.name, mujoco.Renderer(model, height, width)

    def picture(self, data: "mujoco.MjData") -> Picture:
        self._renderer.update_scene(data, camera=self._name)
        return np.asarray(self._renderer.render(), dtype=np.uint8)

    def close(self) -> None:
        self._renderer.close()


class RigCameras:
    """Makes the pictures of all virtual cameras of a cell.

    MuJoCo renders them where OpenGL can be had: libEGL, libOSMesa, or what the environment's
    MUJOCO_GL names. Else, and with MUJOCO_GL=disable, they are drawn. Raises `DeviceError` for a
    cell without a rig, and without OpenCV.
    """

    def __init__(self, cell: Cell) -> None:
        rig = cell.config.rig
        if rig is None:
            raise DeviceError(f"cell {cell.config.name} has no [rig]: nothing to render")
        spec = build_spec(cell)
        self._cameras = {c.name: c for c in cell.cameras if c.device is None}
        spec.compiler.discardvisual = False  # what only can be seen is what we are here for
        for part in cell.parts:
            tip = _tip(spec, part)
            stands = {"world": spec.worldbody, "base": _root(tip, part.prefix), "wrist": tip}
            for camera in part.config.cameras:
                if camera.name in self._cameras:
                    _add_camera(stands[camera.on], camera)
        for tag in rig.tags:
            carrier = _tip(spec, cell.part(tag.mechanism))
            _add_tag(spec, spec.worldbody if tag.T_world_tag else carrier, tag)
        _light(spec)
        width = max((c.size[0] for c in self._cameras.values()), default=640)
        height = max((c.size[1] for c in self._cameras.values()), default=480)
        spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
        self._root = spec.worldbody.first_body().name
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._joints = [int(self._model.joint(name).qposadr[0]) for name in cell.joints]
        rolls = cell.config.mechanism.base is not None
        self._chassis = int(self._model.joint(FREE).qposadr[0]) if rolls else None
        self._tags = {
            t.name: Tag(
                int(self._model.body(f"tag_{t.name}").id),
                int(self._model.geom(f"tag_{t.name}").id),
                _half(t),
                marker(t.family, t.tag, _CELL_PX),
            )
            for t in rig.tags
        }
        self._bodies = {t.name: f"tag_{t.name}" for t in rig.tags if t.T_world_tag is not None}
        self._eyes = {name: self._eye(c) for name, c in self._cameras.items()}
        # Left to the interpreter's last moments, a renderer finds its library gone.
        self._end = weakref.finalize(self, _close, tuple(self._eyes.values()))

    @property
    def drawn(self) -> str:
        """Why pictures are drawn, and not rendered by MuJoCo; "" if they are rendered."""
        return _unusable[0] if _unusable else ""

    def picture(
        self,
        camera: str,
        q: Sequence[float] | NDArray[np.float64],
        covered: Collection[str] = (),
        tags: Mapping[str, Sequence[float]] | None = None,
        base: Sequence[float] | None = None,
    ) -> Picture:
        """Return an RGB picture (h, w, 3) with the joints of all arms at q (n,) [rad].

        `covered` names tags that are not to be seen; `tags` says where those are that stand in
        World: x, y, z [m], roll, pitch, yaw [rad]; `base` the same of Base, where that may move.
        Raises `KeyError` for an unknown camera.
        """
        self._data.qpos[self._joints] = q
        if base is not None and self._chassis is not None:
            place = self._data.qpos[self._chassis :][:7]
            place[:3], place[3:] = (
                base[:3],
                quaternion(PoseSection(rpy=(base[3], base[4], base[5]))),
            )
        elif base is not None:
            _put(self._model, self._root, base)
        for name, tag in self._tags.items():
            self._model.geom_group[tag.geom] = _COVERED if name in covered else 0
        for name, pose in (tags or {}).items():
            if name in self._bodies:
                _put(self._model, self._bodies[name], pose)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        return self._eyes[camera].picture(self._data)

    def close(self) -> None:
        """Let go of the graphics library."""
        self._end()

    def _eye(self, camera: CameraSection) -> Eye:
        if not _unusable and os.environ.get("MUJOCO_GL", "").lower() in _OFF:
            _unusable.append("MUJOCO_GL switches OpenGL off")
        if not _unusable:
            try:
                return _OpenGL(self._model, camera)
            except Exception as error:  # noqa: BLE001  graphics libraries raise whatever they like
                words = " ".join(str(error).split())[:120]
                _unusable.append(f"{type(error).__name__}: {words}")
        return Drawing(self._model, camera, self._tags)


class ToldCameras(RigCameras):
    """The same in a process of its own, by the newest truth that the rig has told."""

    def __init__(self, cell: Cell) -> None:
        super().__init__(cell)
        self._truth: RigTruth | None = None

    def on_truth(self, truth: RigTruth) -> None:
        self._truth = truth

    def seen(self, camera: str) -> Picture | None:
        """Return what a camera would see, None before the rig has told anything."""
        truth = self._truth
        if truth is None:
            return None
        base = truth.frames.get("base")
        return self.picture(camera, truth.q, truth.covered, truth.tags, base)


def _tip(spec: mujoco.MjSpec, part: Cell) -> mujoco.MjsBody:
    return spec.body(part.prefix + part.config.mechanism.tip_link)


def _root(body: mujoco.MjsBody, prefix: str) -> mujoco.MjsBody:
    """Return the base of the arm that a body belongs to, whose bodies' names begin so."""
    while body.parent.name != "world" and body.parent.name.startswith(prefix):
        body = body.parent
    return body


def _put(model: "mujoco.MjModel", name: str, pose: Sequence[float]) -> None:
    """Put a body of World at x, y, z [m], roll, pitch, yaw [rad]."""
    body = model.body(name)
    body.pos[:] = pose[:3]
    body.quat[:] = quaternion(PoseSection(rpy=(pose[3], pose[4], pose[5])))


def _close(eyes: tuple[Eye, ...]) -> None:
    for eye in eyes:
        eye.close()


def _half(tag: RigTagSection) -> float:
    """Return half of the side of a tag with its white margin [m]."""
    return 0.5 * tag.size * (cells(tag.family) + 2) / cells(tag.family)


def _add_camera(body: mujoco.MjsBody, camera: CameraSection) -> None:
    place = camera.place
    turn = _rotation(place) @ _LENS_TO_CAMERA
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, turn.ravel())
    fovy = 2.0 * np.degrees(np.arctan(camera.size[1] / 2 / camera.focal[1]))
    body.add_camera(name=camera.name, pos=place.xyz, quat=quat, fovy=fovy)


def _add_tag(spec: mujoco.MjSpec, parent: mujoco.MjsBody, tag: RigTagSection) -> None:
    place = tag.T_world_tag or tag.T_wrist_tag or PoseSection()
    name = f"tag_{tag.name}"
    grey = marker(tag.family, tag.tag, _CELL_PX)
    n = len(grey)
    texture = spec.add_texture(
        name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=n, height=n, nchannel=3
    )
    texture.data = np.repeat(grey[:, :, None], 3, axis=2).tobytes()
    material = spec.add_material(name=name, specular=0.0, shininess=0.0, emission=EMISSION)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    half = _half(tag)
    body = parent.add_body(name=name, pos=place.xyz, quat=quaternion(place))
    _paint(spec, body, name, half)
    panel = body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=(1.3 * half, 1.3 * half, _THICKNESS / 2),
        pos=(0.0, 0.0, -_THICKNESS),
        rgba=(*tag.colour, 1.0),
        density=0,
    )
    panel.contype = panel.conaffinity = 0


def _paint(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, half: float) -> None:
    """Add a thin square whose front, at z = 0, carries the tag's texture."""
    h, d = half, -_THICKNESS / 2
    front = [(-h, -h, 0.0), (h, -h, 0.0), (h, h, 0.0), (-h, h, 0.0)]
    back = [(x, y, d) for x, y, _ in front]
    mesh = spec.add_mesh(name=name)
    mesh.uservert = np.array(front + back, dtype=np.float32).ravel()
    # Front counter-clockwise seen from +z; the sides and the back close the body.
    faces = [(0, 1, 2), (0, 2, 3), (5, 4, 7), (5, 7, 6)]
    for i in range(4):
        j = (i + 1) % 4
        faces += [(i, i + 4, j), (j, i + 4, j + 4)]
    mesh.userface = np.array(faces, dtype=np.int32).ravel()
    corners = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)]
    mesh.usertexcoord = np.array(corners * 2, dtype=np.float32).ravel()
    geom = body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name, density=0
    )
    geom.contype = geom.conaffinity = 0


def _light(spec: mujoco.MjSpec) -> None:
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=(0.55, 0.62, 0.70),
        rgb2=(0.25, 0.28, 0.32),
        width=64,
        height=384,
    )
    spec.visual.headlight.ambient[:] = 0.45
    spec.visual.headlight.diffuse[:] = 0.35
    spec.visual.headlight.specular[:] = 0.0
    for light in spec.lights:
        light.castshadow = False
    spec.worldbody.add_light(
        pos=(0.0, 0.0, 3.0), dir=(0.3, 0.1, -1.0), castshadow=False, diffuse=(0.4, 0.4, 0.4)
    )


def _rotation(pose: PoseSection) -> NDArray[np.float64]:
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, np.array(quaternion(pose)))
    return R.reshape(3, 3)
