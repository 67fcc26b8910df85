"""Finds one planar tag in a picture: corners to sub-pixel, then both poses that fit them.

A square seen in a small picture has two poses that explain its corners almost equally well
(Collins, Bartoli: Infinitesimal Plane-Based Pose Estimation, 2014). Both are told, the better one
first, with their reprojection errors: who knows more may choose.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...config.schema.surroundings import CameraSection
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

_NUDGE_PX = 1e-6
"""Moves a corner of a perfect parallelogram [px]."""

SAME_RAD = 0.02
"""Two poses this close together are one [rad]."""


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
    """Corners in the picture (4, 2) [px], clockwise from the tag's upper left."""


NOTHING = Detection((), 0.0, None)
"""No tag was seen."""


class Detector:
    """Looks for the tag of one camera."""

    def __init__(self, camera: CameraSection) -> None:
        self._id = camera.tag
        fx, fy = camera.focal
        cx, cy = camera.centre
        self._K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        self._distortion = np.array(camera.distortion)
        h = camera.tag_size / 2
        self._square = np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.minMarkerPerimeterRate = PERIMETER_PX / max(camera.size)
        self._aruco = cv2.aruco.ArucoDetector(dictionary(camera.family), parameters)

    def look(self, picture: Picture) -> Detection:
        """Return what a picture, grey (h, w) or RGB (h, w, 3), shows of the tag."""
        grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        found, ids, _ = self._aruco.detectMarkers(grey)
        matches = [] if ids is None else np.flatnonzero(ids.ravel() == self._id)
        if len(matches) != 1:  # none; or two of one id, and nobody can say which is meant
            return NOTHING
        corners = np.asarray(found[int(matches[0])], dtype=float).reshape(4, 2)
        candidates = self._poses(corners)
        if not candidates:
            return NOTHING
        side = math.sqrt(abs(float(cv2.contourArea(corners.astype(np.float32)))))
        quality = min(1.0, side / FINE_PX) * math.exp(-candidates[0].error_px / ROUGH_PX)
        return Detection(candidates, quality, corners)

    def _poses(self, corners: Array) -> tuple[Candidate, ...]:
        """Return the one or two poses that explain the corners, the better one first.

        IPPE's two, each refined by least squares: seen head-on, where IPPE splits the noise into
        two tilts, both run into the one optimum between them.
        """
        if not np.any(corners[0] - corners[1] + corners[2] - corners[3]):
            # A parallelogram to the last bit, as in a drawn picture: IPPE divides by zero.
            corners = corners + np.array([[_NUDGE_PX, 0.0], [0.0] * 2, [0.0] * 2, [0.0] * 2])
        count, turns, places, _ = cv2.solvePnPGeneric(
            self._square, corners, self._K, self._distortion, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        found: list[Candidate] = []
        for i in range(count):
            turn, place = cv2.solvePnPRefineLM(
                self._square, corners, self._K, self._distortion, turns[i], places[i]
            )
            seen, _ = cv2.projectPoints(self._square, turn, place, self._K, self._distortion)
            error = float(np.sqrt(np.mean(np.sum((seen.reshape(4, 2) - corners) ** 2, axis=1))))
            R = np.asarray(cv2.Rodrigues(turn)[0], dtype=float)
            p = np.asarray(place, dtype=float).ravel()
            new = not any(_angle(R, c.R) < SAME_RAD for c in found)
            if new and p[2] > 0.0 and np.abs(p).max() < FARTHEST_M and math.isfinite(error):
                found.append(Candidate(R, p, error))
        return tuple(sorted(found, key=lambda c: c.error_px))


def _angle(A: Array, B: Array) -> float:
    return math.acos(min(1.0, max(-1.0, 0.5 * (float(np.trace(A.T @ B)) - 1.0))))
