"""Video of a camera for people's eyes, as H.264. The only place here that knows PyAV."""

from fractions import Fraction
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...config.schema.surroundings import CameraSection
from ..device import DeviceError

CODEC: Final = "libx264"
KEYED_S: Final = 1.0
"""From one key frame to the next: who comes in, or has lost a frame, waits at most so long [s]."""

BURST_S: Final = 0.2
"""One frame takes no more than the bit rate's share of so long [s]."""

MOST_BURST_KBIT: Final = 800
"""Nor more than this [kbit]: a router keeps no more for a link that is slow."""


class Encoded(NamedTuple):
    """One frame of a video."""

    data: bytes
    """Access unit with start codes (Annex B); a key frame has its parameter sets in it."""
    key: bool
    """Needs no frame before it."""


class VideoEncoder:
    """Makes H.264 of a camera's pictures, each frame at once: nothing is kept back.

    Bit rate and width are bounded by the cell, the time between key frames by `KEYED_S`. A picture
    of another size begins a new video.
    """

    def __init__(self, camera: CameraSection) -> None:
        """Build it. Raises `DeviceError` where there is no such encoder."""
        try:
            import av
        except ImportError as error:
            raise DeviceError(
                f"video needs PyAV, which cannot be loaded ({error}): pip install av"
            ) from None
        if CODEC not in av.codecs_available:
            raise DeviceError(f"video needs PyAV with {CODEC}: pip install av")
        self._av = av
        self._camera = camera
        self._shape: tuple[int, ...] = ()
        self._frames = 0
        self._keyed_s = float("-inf")

    def encode(self, picture: NDArray[np.uint8], now_s: float) -> Encoded | None:
        """Return the frame of a picture, grey (h, w) or RGB (h, w, 3); None if it makes none."""
        if picture.shape != self._shape:
            self._begin(picture.shape)
        colours = "gray" if picture.ndim == 2 else "rgb24"
        frame = self._av.VideoFrame.from_ndarray(picture, format=colours)
        frame = frame.reformat(self._codec.width, self._codec.height, "yuv420p")
        frame.pts = self._frames
        self._frames += 1
        if now_s - self._keyed_s >= KEYED_S:
            self._keyed_s = now_s
            frame.pict_type = self._av.video.frame.PictureType.I
        packets = list(self._codec.encode(frame))
        data = b"".join(bytes(packet) for packet in packets)
        return Encoded(data, any(packet.is_keyframe for packet in packets)) if data else None

    def end(self) -> None:
        """End the video: the next frame is a key frame again."""
        self._shape = ()

    def _begin(self, shape: tuple[int, ...]) -> None:
        height, width = shape[:2]
        scale = min(1.0, self._camera.video_width / width)
        codec = self._av.CodecContext.create(CODEC, "w")
        codec.width, codec.height = _even(width * scale), _even(height * scale)
        codec.pix_fmt = "yuv420p"
        rate = Fraction(self._camera.video_hz).limit_denominator(100)
        codec.framerate, codec.time_base = rate, 1 / rate
        codec.bit_rate = 1000 * self._camera.video_kbit_s
        codec.gop_size = 10_000  # key frames come by time, also where pictures come late
        codec.thread_count = 1
        kbit = self._camera.video_kbit_s
        burst = min(MOST_BURST_KBIT, round(BURST_S * kbit))
        codec.options = {
            "preset": "superfast",
            "tune": "zerolatency",
            "profile": "baseline",
            "forced-idr": "1",
            "x264-params": "annexb=1:repeat-headers=1:scenecut=0:"
            f"vbv-maxrate={kbit}:vbv-bufsize={burst}",
        }
        self._codec, self._shape, self._frames = codec, shape, 0
        self._keyed_s = float("-inf")


def _even(pixels: float) -> int:
    """Return a size that chroma of half the resolution fits [px]."""
    return max(2, 2 * round(pixels / 2))
