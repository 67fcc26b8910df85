"""OpenCV, where it is installed, set up to use one thread and to be repeatable."""

import numpy as np
from numpy.typing import NDArray

from ...config.cameras import TagFamily
from ..device import DeviceError

try:
    import cv2
except ImportError as error:
    raise DeviceError(
        f"pictures need OpenCV, which cannot be loaded ({error}): "
        "pip install opencv-python-headless"
    ) from None

__all__ = ["cv2", "dictionary", "marker"]

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
