"""Finds a planar tag in a picture, or several on a board: corners to sub-pixel, then their poses.

A square seen in a small picture has two poses that explain its corners almost equally well
(Collins, Bartoli: Infinitesimal Plane-Based Pose Estimation, 2014). Both are told, the better one
first, with their reprojection errors: who knows more may choose. Of a board each tag that is seen
proposes its poses, and all corners together decide.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...config.schema.surroundings import BoardTagSection, CameraSection
from ...protocols.messages.perception import Sighting
from ..device import DeviceError
from .opencv import cv2, dictionary

Picture = NDArray[np.uint8]
Array = NDArray[np.float64]

FINE_PX = 24.0
"""Side of a tag in the picture from which its size takes nothing off the quality [px]."""

ROUGH_PX = 2.0
"""Reprojection error at which the quality is down to about a third [px]."""

PERIMETER_PX = 32.0
"""Outlines shorter than this are not looked at [px]."""


FARTHEST_M = 50.0
"""A tag that is farther away is an error [m]."""

WIDEST = 10.0
"""Normalised image coordinates beyond are an error: of a lens that sees 84 degrees aside [1]."""

_NUDGE_PX = 1e-6
"""Moves a corner of a perfect parallelogram [px]."""

SAME_RAD = 0.02
"""Two poses this close together are one [rad]."""

MOST_POSES = 2
"""So many poses of a board are told at most [1]."""


@dataclass(frozen=True)
class Candidate:
    """A pose of the tag in the Lens that explains what was seen."""

    R: Array
    """Rotation (3, 3) from tag to Lens axes."""
    p: Array
    """Tag's middle in the Lens (3,) [m]."""
    error_px: float
    """Root mean square reprojection error of the corners [px]."""

    @property
    def xyz_rpy(self) -> tuple[float, float, float, float, float, float]:
        """Place [m] and fixed-axis roll, pitch, yaw [rad]."""
        (a, b, _), (c, d, _), (e, f, g) = self.R.tolist()
        x, y, z = self.p.tolist()
        pitch = math.asin(min(1.0, max(-1.0, -e)))
        if abs(e) > 1.0 - 1e-12:
            return (x, y, z, 0.0, pitch, math.atan2(-b, d))
        return (x, y, z, math.atan2(f, g), pitch, math.atan2(c, a))


@dataclass(frozen=True)
class Detection:
    """Tag found in a picture."""

    candidates: tuple[Candidate, ...]
    """The better one first; none where the tag is not to be seen."""
    quality: float
    """From 0 to 1: small for tags that are small or don't fit a square."""
    corners: Array | None
    """Corners in the picture (4, 2) [px] of the tag, or of the first of its board that was found:
    clockwise from the upper left."""
    seen: Mapping[int, Array] = field(default_factory=dict)
    """Corners (4, 2) of each tag in normalised image coordinates without distortion, by its id."""


NOTHING = Detection((), 0.0, None)
"""No tag was seen."""


class _Tag(NamedTuple):
    """A tag of a board."""

    square: Array  # corners (4, 3) in its own axes [m], clockwise from the upper left
    R: Array  # from its axes to the board's (3, 3)
    p: Array  # its middle in the board's (3,) [m]

    @property
    def corners(self) -> Array:
        """Corners (4, 3) in the board's axes [m]."""
        return np.asarray(self.square @ self.R.T + self.p)


def _tag(section: BoardTagSection) -> _Tag:
    h, place = section.size / 2, section.T_board_tag
    square = np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])
    return _Tag(square, _rotation(*place.rpy), np.array(place.xyz))


Find = Callable[[Picture], Mapping[int, Array]]
"""Returns the corners (4, 2) [px] of each square that is seen once in a grey picture (h, w), by its
id: clockwise from its upper left, pixel centres at whole numbers."""


def tags_of(camera: CameraSection) -> Find:
    """Return what finds a camera's family of tags."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.minMarkerPerimeterRate = PERIMETER_PX / max(camera.size)
    aruco = cv2.aruco.ArucoDetector(dictionary(camera.family), parameters)

    def find(picture: Picture) -> Mapping[int, Array]:
        found, ids, _ = aruco.detectMarkers(picture)
        seen = [] if ids is None else [int(i) for i in ids.ravel()]
        # Of two of one id nobody can say which is meant.
        return {
            tag: np.asarray(found[i], dtype=float).reshape(4, 2)
            for i, tag in enumerate(seen)
            if seen.count(tag) == 1
        }

    return find


def _others(camera: CameraSection) -> Find:
    """Return what the cell names as its camera's detector. Raises `DeviceError`."""
    where = f"camera {camera.name}: detector '{camera.detector}'"
    module, _, name = str(camera.detector).partition(":")
    try:
        find: Find = getattr(import_module(module), name)(camera)
    except Exception as error:
        raise DeviceError(f"{where}: {type(error).__name__}: {error}") from error

    def judged(picture: Picture) -> Mapping[int, Array]:
        try:
            seen = {int(i): np.asarray(each, dtype=float) for i, each in find(picture).items()}
        except Exception as error:
            raise DeviceError(f"{where}: {type(error).__name__}: {error}") from error
        for tag, corners in seen.items():
            if corners.shape != (4, 2) or not np.isfinite(corners).all():
                shape = corners.shape
                raise DeviceError(f"{where}: id {tag}: wants 4 finite corners (4, 2), not {shape}")
        return seen

    return judged


class Detector:
    """Looks for the tag of one camera, and for those that its cell fixes to it."""

    def __init__(self, camera: CameraSection) -> None:
        self._tags = {each.tag: _tag(each) for each in camera.tags}
        fx, fy = camera.focal
        cx, cy = camera.centre
        self._K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        self._distortion = np.array(camera.distortion)
        self._find = tags_of(camera) if camera.detector is None else _others(camera)

    def look(self, picture: Picture) -> Detection:
        """Return what a picture, grey (h, w) or RGB (h, w, 3), shows of the tag."""
        grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        seen = self._find(np.asarray(grey, dtype=np.uint8))
        corners = {tag: seen[tag] for tag in self._tags if tag in seen}
        candidates = self._poses(corners)
        if not candidates:
            return NOTHING
        side = max(
            math.sqrt(abs(float(cv2.contourArea(each.astype(np.float32)))))
            for each in corners.values()
        )
        quality = min(1.0, side / FINE_PX) * math.exp(-candidates[0].error_px / ROUGH_PX)
        return Detection(
            candidates,
            quality,
            next(iter(corners.values())),
            dict(self._normalised(corners)),
        )

    def _normalised(self, corners: Mapping[int, Array]) -> Iterator[tuple[int, Array]]:
        """Yield each tag's corners without distortion, where that can be taken out."""
        for tag, pixels in corners.items():
            points = cv2.undistortPoints(pixels.reshape(-1, 1, 2), self._K, self._distortion)
            if np.abs(points).max() <= WIDEST:
                yield tag, np.asarray(points, dtype=float).reshape(-1, 2)

    def _poses(self, corners: Mapping[int, Array]) -> tuple[Candidate, ...]:
        """Return the poses that explain the corners (4, 2) of tags, the better one first.

        IPPE's two of each tag, each refined by least squares over all corners: seen head-on, where
        IPPE splits the noise into two tilts, both run into the one optimum between them.
        """
        if not corners:
            return ()
        points = np.concatenate([self._tags[tag].corners for tag in corners])
        pixels = np.concatenate([_off_a_parallelogram(each) for each in corners.values()])
        found: list[Candidate] = []
        for start_turn, start_place in self._starts(corners):
            turn, place = cv2.solvePnPRefineLM(
                points, pixels, self._K, self._distortion, start_turn, start_place
            )
            seen, _ = cv2.projectPoints(points, turn, place, self._K, self._distortion)
            error = float(np.sqrt(np.mean(np.sum((seen.reshape(-1, 2) - pixels) ** 2, axis=1))))
            R = np.asarray(cv2.Rodrigues(turn)[0], dtype=float)
            p = np.asarray(place, dtype=float).ravel()
            new = not any(_angle(R, c.R) < SAME_RAD for c in found)
            if new and p[2] > 0.0 and np.abs(p).max() < FARTHEST_M and math.isfinite(error):
                found.append(Candidate(R, p, error))
        return tuple(sorted(found, key=lambda c: c.error_px)[:MOST_POSES])

    def _starts(self, corners: Mapping[int, Array]) -> Iterator[tuple[Array, Array]]:
        """Yield turns (3, 1) and places (3, 1) of the board that one tag alone explains."""
        for tag, pixels in corners.items():
            of = self._tags[tag]
            count, turns, places, _ = cv2.solvePnPGeneric(
                of.square, _off_a_parallelogram(pixels), self._K, self._distortion,
                flags=cv2.SOLVEPNP_IPPE_SQUARE,
            )  # fmt: skip
            for i in range(count):
                turn, place = np.asarray(turns[i], dtype=float), np.asarray(places[i], dtype=float)
                if of.p.any() or not np.array_equal(of.R, np.eye(3)):
                    R = np.asarray(cv2.Rodrigues(turn)[0] @ of.R.T, dtype=float)
                    turn = np.asarray(cv2.Rodrigues(R)[0], dtype=float)
                    place = place - (R @ of.p).reshape(3, 1)
                yield turn, place


def _off_a_parallelogram(corners: Array) -> Array:
    """Return corners (4, 2) [px] that are none to the last bit: IPPE divides by zero there."""
    if np.any(corners[0] - corners[1] + corners[2] - corners[3]):
        return corners
    nudged = corners.copy()
    nudged[0, 0] += _NUDGE_PX
    return nudged


def _rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Return the rotation (3, 3) of fixed-axis roll, pitch, yaw [rad]."""
    X, Y, Z = (cv2.Rodrigues(np.array(axis))[0] for axis in (
        (roll, 0.0, 0.0), (0.0, pitch, 0.0), (0.0, 0.0, yaw),
    ))  # fmt: skip
    return np.asarray(Z @ Y @ X, dtype=float)


def _angle(A: Array, B: Array) -> float:
    return math.acos(min(1.0, max(-1.0, 0.5 * (float(np.trace(A.T @ B)) - 1.0))))


def told(camera: CameraSection, tick: int, sight: Detection) -> Sighting:
    """Return the message of what a picture showed."""
    return Sighting(
        camera=camera.name,
        tick=tick,
        poses=tuple(c.xyz_rpy for c in sight.candidates),
        errors_px=tuple(min(c.error_px, 1e4) for c in sight.candidates),
        seen=tuple((tag, tuple(corners.ravel().tolist())) for tag, corners in sight.seen.items()),
        quality=sight.quality,
    )
