"""A real camera is whatever OpenCV opens; here, a film of a tag."""

import numpy as np
import pytest
from telerobot.config.schema.section import PoseSection
from telerobot.config.schema.surroundings import CameraSection
from telerobot.drivers.device import DeviceError

cv2 = pytest.importorskip("cv2")
SIZE = (320, 240)
PICTURES = 5


@pytest.fixture
def film(tmp_path):
    from telerobot.drivers.vision.opencv import marker

    tag = marker("5x5_50", 7, 12)
    picture = np.full((SIZE[1], SIZE[0], 3), 200, dtype=np.uint8)
    n = len(tag)
    picture[60 : 60 + n, 90 : 90 + n] = tag[:, :, None]
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20.0, SIZE)
    for _ in range(PICTURES):
        writer.write(picture)
    writer.release()
    return path


def camera(device, **changes):
    fields = {
        "name": "wrist",
        "T_wrist_lens": PoseSection(),
        "device": str(device),
        "size": SIZE,
        "focal": (300.0, 300.0),
        "tag": 7,
    }
    return CameraSection(**{**fields, **changes})


def test_a_tag_on_a_film_is_found(film):
    from telerobot.drivers.vision.detector import Detector
    from telerobot.drivers.vision.device import VideoCamera

    source = VideoCamera(camera(film))
    sight = Detector(camera(film)).look(source.picture())
    source.close()
    # 84 px of black for 0.1 m, seen head-on through 300 px
    assert sight.candidates[0].p[2] == pytest.approx(300 * 0.1 / 84, rel=0.02)


def test_a_film_that_ends_says_so(film):
    from telerobot.drivers.vision.device import VideoCamera

    source = VideoCamera(camera(film))
    for _ in range(PICTURES):
        source.picture()
    with pytest.raises(DeviceError, match="gives no pictures any more"):
        source.picture()


def test_pictures_of_another_size_than_the_cell_says_are_refused(film):
    from telerobot.drivers.vision.device import VideoCamera

    source = VideoCamera(camera(film, size=(640, 480)))
    with pytest.raises(DeviceError, match="pictures are 320 x 240, the cell says 640 x 480"):
        source.picture()


def test_a_camera_that_is_not_there_is_an_error_of_one_line(tmp_path):
    from telerobot.drivers.vision.device import VideoCamera

    with pytest.raises(DeviceError, match=r"camera wrist: .*nothing\.avi cannot be opened"):
        VideoCamera(camera(tmp_path / "nothing.avi"))
