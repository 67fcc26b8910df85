"""Video for people's eyes: at once, whole, bounded, and never of another picture."""

import numpy as np
import pytest
from telerobot.config.schema.section import PoseSection
from telerobot.config.schema.surroundings import CameraSection
from telerobot.protocols.messages.perception import LARGEST_FRAME

av = pytest.importorskip("av", reason="pip install 'telerobot[vision]'")
NOISE = np.random.default_rng(3)
PERIOD_S = 0.05


def encoder(**more):
    from telerobot.drivers.vision.video import VideoEncoder

    return VideoEncoder(CameraSection(name="eye", T_wrist_lens=PoseSection(), **more))


def noise(width=320, height=240):
    """Return a picture of which nothing can be left out."""
    return NOISE.integers(0, 256, (height, width, 3), dtype=np.uint8)


def shade(value, width=320, height=240):
    return np.full((height, width, 3), value, dtype=np.uint8)


def seen(decoder, frame):
    """Return the one picture that a decoder makes of a frame."""
    (shown,) = decoder.decode(av.Packet(frame.data))
    return shown.to_ndarray(format="rgb24")


def test_each_picture_is_a_frame_at_once_and_shows_that_picture():
    eye, decoder = encoder(), av.CodecContext.create("h264", "r")
    decoder.flags |= av.codec.context.Flags.low_delay
    for k in range(8):
        value = 20 + 25 * k
        picture = seen(decoder, eye.encode(shade(value), k * PERIOD_S))
        assert picture.shape == (240, 320, 3)
        assert abs(float(picture.mean()) - value) < 6


@pytest.mark.parametrize("period_s", [0.05, 0.4], ids=["in time", "late"])
def test_a_key_frame_comes_every_second_also_where_pictures_come_late(period_s):
    eye = encoder()
    keys = [k * period_s for k in range(60) if eye.encode(noise(), k * period_s).key]
    assert keys[0] == 0.0
    assert max(np.diff(keys)) <= 1.0 + period_s
    assert min(np.diff(keys)) >= 1.0 - period_s


@pytest.mark.parametrize(("kbit_s", "size"), [(500, (640, 480)), (8000, (1280, 720))])
def test_bit_rate_and_frames_are_bounded_even_of_noise(kbit_s, size):
    eye = encoder(video_kbit_s=kbit_s, size=size)
    sizes = [len(eye.encode(noise(*size), k * PERIOD_S).data) for k in range(40)]
    assert 8 * sum(sizes) / (40 * PERIOD_S) < 1.25e3 * kbit_s
    assert max(sizes) < LARGEST_FRAME


def test_a_wide_picture_is_scaled_down_to_what_the_cell_says():
    eye, decoder = encoder(video_width=200), av.CodecContext.create("h264", "r")
    decoder.flags |= av.codec.context.Flags.low_delay
    assert seen(decoder, eye.encode(shade(90, 641, 479), 0.0)).shape == (150, 200, 3)


def test_a_picture_of_another_size_or_a_new_beginning_is_a_key_frame():
    eye, decoder = encoder(), av.CodecContext.create("h264", "r")
    decoder.flags |= av.codec.context.Flags.low_delay
    assert eye.encode(noise(), 0.0).key
    assert not eye.encode(noise(), 0.1).key
    other = eye.encode(shade(90, 160, 120), 0.2)
    assert other.key
    assert seen(decoder, other).shape == (120, 160, 3)
    eye.end()
    assert eye.encode(shade(90, 160, 120), 0.3).key


def test_a_grey_picture_is_filmed_as_well():
    decoder = av.CodecContext.create("h264", "r")
    decoder.flags |= av.codec.context.Flags.low_delay
    picture = seen(decoder, encoder().encode(np.full((240, 320), 77, dtype=np.uint8), 0.0))
    assert abs(float(picture.mean()) - 77) < 6
