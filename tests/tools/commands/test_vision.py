"""`telerobot vision`: which tick a picture belongs to, when the next is due, what it refuses."""

import numpy as np
import pytest
from telerobot.config.schema.section import PoseSection
from telerobot.config.schema.surroundings import CameraSection
from telerobot.tools.cli import main

pytest.importorskip("cv2")


class Blank:
    """A camera before a white wall."""

    def picture(self):
        return np.full((480, 640), 255, dtype=np.uint8)


class Counting(Blank):
    """A camera that counts its pictures."""

    taken = 0

    def picture(self):
        self.taken += 1
        return super().picture()


class Shut:
    """A camera that has no picture yet."""

    def picture(self):
        return None


def looker(eye, device=None, rate_hz=20.0):
    from telerobot.drivers.vision.process import Looker

    camera = CameraSection(
        name="eye",
        T_wrist_lens=PoseSection(),
        device=device,
        rate_hz=rate_hz,
        latency_s=0.08,
        tag=7,
    )
    made = Looker(camera, eye.picture, 0.01)
    made.seen_through = lambda: eye.taken
    return made


def test_a_picture_of_a_white_wall_is_told_as_one_without_a_tag():
    (sighting, _, sight) = looker(Blank()).look(1000, 5.0)
    assert (sighting.camera, sighting.poses, sighting.quality) == ("eye", (), 0.0)
    assert sight.corners is None


def test_a_rendered_picture_belongs_to_the_newest_tick_a_real_one_to_an_earlier_by_its_latency():
    assert looker(Blank()).look(1000, 5.0)[0].tick == 1000
    assert looker(Blank(), device="0").look(1000, 5.0)[0].tick == 992
    assert looker(Blank(), device="0").look(3, 5.0)[0].tick == 0


def test_pictures_are_due_at_the_cameras_rate_and_lost_time_is_not_made_up():
    eye = looker(Blank())
    eye.look(1, 5.0)
    assert eye.due_s == pytest.approx(5.0)
    eye.look(2, 5.0)
    assert eye.due_s == pytest.approx(5.05)
    eye.look(3, 9.0)
    assert eye.due_s == pytest.approx(9.0)


def test_a_picture_that_is_due_for_a_sighting_and_for_video_is_taken_once():
    eye = looker(Counting())
    eye.watched, eye.due_s, eye.video_due_s = True, 5.0, 5.0
    for k in range(5):
        _, picture, _ = eye.look(k, 5.0 + 0.05 * k)
        assert eye.film(5.0 + 0.05 * k - 1e-6, picture) is picture
        assert eye.next_s == pytest.approx(5.05 + 0.05 * k)
    assert eye.seen_through() == 5


def test_video_is_made_at_a_rate_of_its_own_and_sightings_keep_theirs():
    eye = looker(Counting(), rate_hz=10.0)
    eye.watched, eye.due_s, eye.video_due_s = True, 5.0, 5.0
    sightings, frames, now_s = 0, 0, 5.0
    while now_s < 7.0 - 1e-9:
        picture = eye.look(0, now_s)[1] if now_s >= eye.due_s - 1e-9 else None
        sightings += picture is not None
        frames += eye.film(now_s, picture) is not None
        now_s = eye.next_s
    assert (sightings, frames) == (20, 40)
    assert eye.seen_through() == 40


def test_no_picture_is_taken_for_a_video_that_nobody_looks_at():
    eye = looker(Counting())
    eye.look(1, 5.0)
    assert eye.film(9.0, None) is None
    assert eye.next_s == eye.due_s
    assert eye.seen_through() == 1


def test_without_a_picture_nothing_is_told():
    eye = looker(Shut())
    assert eye.look(1, 5.0) is None
    assert (eye.pictures, eye.seen) == (0, 0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["pa10"], "cameras: the cell has no cameras"),
        (["pa10_vision", "--camera", "ceiling"], "cameras: the cell has no camera 'ceiling'"),
    ],
)
def test_a_cell_that_lacks_the_camera_is_bad_usage(capsys, arguments, words):
    assert main(["vision", *arguments]) == 2
    assert words in capsys.readouterr().err
