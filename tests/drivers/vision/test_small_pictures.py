"""Small pictures for people's eyes: within their bound, whatever is in front of the camera."""

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2")

from telerobot.drivers.vision.opencv import small_jpeg  # noqa: E402  needs OpenCV
from telerobot.protocols.messages.perception import LARGEST_JPEG  # noqa: E402


@pytest.mark.parametrize("shape", [(480, 640), (480, 640, 3), (1080, 1920, 3), (100, 4000)])
def test_a_picture_is_small_and_has_its_own_proportions(shape):
    ramp = np.linspace(0, 255, shape[1]).astype(np.uint8)
    picture = np.broadcast_to(ramp.reshape(1, -1, *[1] * (len(shape) - 2)), shape)
    jpeg = small_jpeg(np.ascontiguousarray(picture), LARGEST_JPEG)
    assert len(jpeg) <= LARGEST_JPEG
    seen = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_UNCHANGED)
    assert seen.shape[1] == 320
    assert seen.shape[0] == pytest.approx(320 * shape[0] / shape[1], abs=1)


def test_colours_stay_what_they_are():
    red = np.zeros((60, 80, 3), dtype=np.uint8)
    red[..., 0] = 250
    seen = cv2.imdecode(np.frombuffer(small_jpeg(red, LARGEST_JPEG), np.uint8), cv2.IMREAD_COLOR)
    blue, green, red_again = seen.reshape(-1, 3).mean(axis=0)
    assert red_again > 240
    assert max(blue, green) < 10


def test_the_noisiest_picture_still_fits_or_is_left_out():
    noise = np.random.default_rng(1).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    jpeg = small_jpeg(noise, LARGEST_JPEG)
    assert jpeg is None or len(jpeg) <= LARGEST_JPEG
    assert small_jpeg(noise, 100) is None
