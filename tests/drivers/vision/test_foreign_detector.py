"""A detector that is not ours, by the hook that the guide tells of."""

import re
import sys
from types import ModuleType

import numpy as np
import pytest
from telerobot.config.schema.surroundings import CameraSection
from telerobot.drivers.device import DeviceError
from telerobot.server.control.spatial import rotation_log, rotation_rpy

from ...test_pages import ROOT

cv2 = pytest.importorskip("cv2")

from telerobot.drivers.vision.detector import Detector  # noqa: E402  needs OpenCV

SIZE = 0.1
K = np.array([[560.0, 0.0, 319.5], [0.0, 560.0, 239.5], [0.0, 0.0, 1.0]])


@pytest.fixture
def hook(monkeypatch):
    """Put a module on Python's path; return a detector of what it holds."""

    def make(source, name):
        module = ModuleType("my_squares")
        exec(source, module.__dict__)
        monkeypatch.setitem(sys.modules, "my_squares", module)
        camera = {"name": "eye", "T_world_lens": {}, "tag": 4, "tag_size": SIZE}
        return Detector(CameraSection.model_validate({**camera, "detector": f"my_squares:{name}"}))

    return make


def of_the_guide():
    page = (ROOT / "config/guides/camera.md").read_text()
    (source,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    return source


def qr_code(R, p):
    """Return a picture (480, 640) of a QR code at a pose in the Lens, by its homography."""
    code = cv2.QRCodeEncoder.create().encode("telerobot")
    code = code[2:-2, 2:-2] if code[0].min() > 0 and code[1].min() > 0 else code
    n, px = code.shape[0], 12
    big = np.kron(code, np.ones((px, px), dtype=np.uint8))
    # From the code's pixels to metres, x to the right and y up, then to the picture.
    scale = SIZE / (n * px)
    to_metres = np.array(
        [[scale, 0, -SIZE / 2 + scale / 2], [0, -scale, SIZE / 2 - scale / 2], [0, 0, 1]]
    )
    H = K @ np.column_stack([R[:, 0], R[:, 1], p]) @ to_metres
    return cv2.warpPerspective(big, H, (640, 480), borderValue=255, flags=cv2.INTER_AREA)


@pytest.mark.parametrize(
    ("place", "tilt"),
    [
        ((0.0, 0.0, 0.3), (0.0, 0.0, 0.0)),
        ((0.03, -0.02, 0.3), (0.4, 0.0, 0.2)),
        ((-0.05, 0.03, 0.35), (0.2, -0.4, -0.5)),
    ],
)
def test_the_detector_of_the_guide_finds_a_qr_code_where_it_is(hook, place, tilt):
    R, p = rotation_rpy(*tilt) @ np.diag([1.0, -1.0, -1.0]), np.array(place)
    sight = hook(of_the_guide(), "QrCode").look(qr_code(R, p))
    best = min(sight.candidates, key=lambda c: np.linalg.norm(rotation_log(R.T @ c.R)))
    assert np.linalg.norm(best.p - p) < 0.006
    assert np.linalg.norm(rotation_log(R.T @ best.R)) < 0.06
    assert sight.quality > 0.5


def test_where_it_sees_nothing_there_is_no_tag(hook):
    sight = hook(of_the_guide(), "QrCode").look(np.full((480, 640), 200, dtype=np.uint8))
    assert sight.candidates == ()


BAD = "def Bad(camera):\n    return lambda picture: {}\n"


@pytest.mark.parametrize(
    ("source", "name", "words"),
    [
        ("x = 1\n", "Missing", "AttributeError"),
        (BAD.format("1 / 0"), "Bad", "ZeroDivisionError"),
        (BAD.format("None"), "Bad", "AttributeError"),
        (BAD.format("{4: [[0.0, 1.0]] * 3}"), "Bad", r"id 4: wants 4 finite corners"),
        (BAD.format("{4: [[float('nan')] * 2] * 4}"), "Bad", r"id 4: wants 4 finite corners"),
    ],
    ids=["missing", "raises", "none", "three", "nan"],
)
def test_one_that_is_wrong_is_named_in_one_line(hook, source, name, words):
    expected = f"camera eye: detector 'my_squares:{name}': .*{words}"
    with pytest.raises(DeviceError, match=expected):
        hook(source, name).look(np.zeros((48, 64), dtype=np.uint8))


def test_one_that_is_not_on_the_path_is_named():
    camera = {"name": "eye", "T_world_lens": {}, "detector": "no_such_module:Thing"}
    with pytest.raises(DeviceError, match="ModuleNotFoundError"):
        Detector(CameraSection.model_validate(camera))
