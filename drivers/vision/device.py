"""A real camera, through OpenCV."""

import numpy as np
from numpy.typing import NDArray

from ...config.schema.surroundings import CameraSection
from ..device import DeviceError
from .opencv import cv2


class VideoCamera:
    """A camera that OpenCV can open: an index, a device path, or the URL of a stream.

    Raises `DeviceError` when it cannot be opened, or gives pictures of another size.
    """

    def __init__(self, camera: CameraSection) -> None:
        self._name, self._size = camera.name, camera.size
        device = camera.device or "0"
        self._capture = cv2.VideoCapture(int(device) if device.isdecimal() else device)
        if not self._capture.isOpened():
            raise DeviceError(f"camera {camera.name}: {device} cannot be opened")
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, camera.size[0])
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, camera.size[1])
        # An old picture is of no use: none is to wait in a buffer.
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)

    def picture(self) -> NDArray[np.uint8]:
        """Return the next picture, RGB (h, w, 3); waits for it. Raises `DeviceError`."""
        ok, picture = self._capture.read()
        if not ok:
            raise DeviceError(f"camera {self._name}: gives no pictures any more")
        h, w = picture.shape[:2]
        if (w, h) != self._size:
            raise DeviceError(
                f"camera {self._name}: pictures are {w} x {h}, the cell says "
                f"{self._size[0]} x {self._size[1]}"
            )
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)

    def close(self) -> None:
        """Let go of the camera."""
        self._capture.release()
