"""OpenCV, where it is installed, set up to use one thread and to be repeatable."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...config.schema.surroundings import TagFamily
from ..device import DeviceError

try:
    import cv2
except ImportError as error:
    raise DeviceError(
        f"pictures need OpenCV, which cannot be loaded ({error}): "
        "pip install opencv-python-headless"
    ) from None

__all__ = ["cells", "cv2", "dictionary", "marker", "save", "small_jpeg"]

cv2.setNumThreads(1)

_FAMILIES = {
    "4x4_50": cv2.aruco.DICT_4X4_50,
    "5x5_50": cv2.aruco.DICT_5X5_50,
    "6x6_50": cv2.aruco.DICT_6X6_50,
    "apriltag_36h11": cv2.aruco.DICT_APRILTAG_36H11,
}


def dictionary(family: TagFamily) -> "cv2.aruco.Dictionary":
    """Return the tags of a family."""
    return cv2.aruco.getPredefinedDictionary(_FAMILIES[family])


def marker(family: TagFamily, tag: int, cell_px: int) -> NDArray[np.uint8]:
    """Return the picture of a tag (n, n), `cell_px` a cell, with one cell of white around it."""
    tags = dictionary(family)
    cells = tags.markerSize + 2
    black = cv2.aruco.generateImageMarker(tags, tag, cells * cell_px)
    return np.asarray(np.pad(black, cell_px, constant_values=255), dtype=np.uint8)


def cells(family: TagFamily) -> int:
    """Return how many cells the black square of a tag of a family has on a side."""
    return int(dictionary(family).markerSize) + 2


def save(path: Path, picture: NDArray[np.uint8], corners: NDArray[np.float64] | None) -> None:
    """Write a picture, grey (h, w) or RGB (h, w, 3), as PNG; outline what was found in it."""
    code = cv2.COLOR_GRAY2BGR if picture.ndim == 2 else cv2.COLOR_RGB2BGR
    drawn = cv2.cvtColor(picture, code)
    if corners is not None:
        outline = np.round(corners * 16).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(drawn, [outline], True, (40, 200, 40), 2, cv2.LINE_AA, 4)
    cv2.imwrite(str(path), drawn, [cv2.IMWRITE_PNG_COMPRESSION, 9])


WIDTH_PX = 320
"""Small pictures are at most so wide [px]."""
QUALITIES = (70, 50, 35, 20, 10)
"""Qualities of JPEG that are tried, the best first [%]."""


def small_jpeg(picture: NDArray[np.uint8], largest: int) -> bytes | None:
    """Return a picture, grey (h, w) or RGB (h, w, 3), as JPEG of at most so many bytes.

    None for one that is larger at the poorest quality.
    """
    scale = min(1.0, WIDTH_PX / picture.shape[1])
    size = (round(picture.shape[1] * scale), max(1, round(picture.shape[0] * scale)))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    drawn = small if small.ndim == 2 else cv2.cvtColor(small, cv2.COLOR_RGB2BGR)
    for quality in QUALITIES:
        _, coded = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, quality])
        if len(coded) <= largest:
            return bytes(coded)
    return None
