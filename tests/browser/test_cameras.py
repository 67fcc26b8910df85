"""Cameras to steer by: large in the scene's place, as video, with how old it is."""

import re

import pytest
from telerobot.drivers.network.session import Session
from telerobot.protocols import topics as t

pytestmark = [pytest.mark.browser, pytest.mark.usefixtures("rendering")]

PHONE = {"width": 390, "height": 844}
NO_H264 = "delete window.VideoDecoder"
TILE, THUMB = ".camera-tile", ".cameras button"
SHOWN = re.compile(r"(\d+) Hz · (\d+) ms old")


@pytest.fixture
def site(site_of):
    """Return a PA-10 that is seen by two cameras."""
    pytest.importorskip("av", reason="pip install 'telerobot[vision]'")
    return site_of("pa10_vision")


@pytest.fixture
def films(site):
    """Return what says which cameras somebody looks at, as the cameras' process hears it."""
    cell = site.plant.cell
    session = Session(cell.config.name, cell.config.zenoh.dialled)
    yield lambda: {c.name for c in cell.cameras if session.heard(t.VIDEO.by(c.name))}
    session.close()


def thumbs(site, **more):
    """Return a page on which both cameras are small."""
    page = site.page(**more)
    site.until(lambda: page.locator(THUMB).count() == 2, "no small pictures")
    return page


def thumb(page, name):
    return page.get_by_role("button", name=f"camera {name} large")


def large(page):
    """Return the names of the cameras that are large, and what is said of them."""
    tiles = page.locator(".camera-words").evaluate_all(
        "each => each.map(({children}) => [children[0].textContent, children[1].textContent])"
    )
    return dict(tiles)


def video(site, page, name):
    """Wait until a camera shows video that is told to be so old [ms]; return that."""
    site.until(lambda: SHOWN.fullmatch(large(page).get(name, "")), f"no video of {name}")
    return int(SHOWN.fullmatch(large(page)[name])[2])


def lit(page):
    """Return whether the first large picture shows anything but black."""
    return page.evaluate(
        "(() => { const c = document.querySelector('.camera-tile canvas');"
        " const { data } = c.getContext('2d').getImageData(0, 0, c.width, c.height);"
        " return data.reduce((most, each, i) => i % 4 < 3 && each > most ? each : most, 0); })()"
    )


def test_a_small_picture_that_is_clicked_becomes_a_video_until_it_is_clicked_again(site, films):
    page = thumbs(site)
    assert films() == set(), "nobody looks, and yet a video is made"
    thumb(page, "wrist").click()
    assert 0 < video(site, page, "wrist") < 2000
    assert lit(page) > 100
    assert films() == {"wrist"}
    assert page.locator(THUMB).count() == 2, "the small pictures have to stay"
    page.locator(TILE).click()
    assert large(page) == {}
    site.until(lambda: films() == set(), "the video goes on with nobody looking")
    assert page.errors == []


def test_several_cameras_are_large_at_once_and_escape_makes_all_small(site, films):
    page = thumbs(site)
    for name in ("wrist", "beside"):
        thumb(page, name).click()
    for name in ("wrist", "beside"):
        video(site, page, name)
    boxes = [tile.bounding_box() for tile in page.locator(TILE).all()]
    assert boxes[0]["x"] + boxes[0]["width"] <= boxes[1]["x"] + 3
    page.keyboard.press("Escape")
    assert large(page) == {}
    site.until(lambda: films() == set(), "the videos go on with nobody looking")


def test_by_keyboard_a_camera_becomes_large_and_small_and_the_space_bar_still_stops(site):
    page = thumbs(site)
    thumb(page, "beside").focus()
    page.keyboard.press("Enter")
    video(site, page, "beside")
    page.keyboard.press("Enter")
    assert large(page) == {}
    page.keyboard.press("Enter")
    page.keyboard.press("Space")
    site.until(lambda: site.plant.operators[0].state.protective_stop, "the space bar stops nothing")
    assert set(large(page)) == {"beside"}


def test_by_touch_on_a_phone_a_camera_takes_the_scenes_place_and_the_sticks_stay(site):
    page = thumbs(site, viewport=PHONE, has_touch=True)
    thumb(page, "wrist").tap()
    video(site, page, "wrist")
    scene = page.locator("#scene").bounding_box()
    tile = page.locator(TILE).bounding_box()
    assert tile["width"] == pytest.approx(scene["width"], abs=2)
    middle = [scene["x"] + 0.5 * scene["width"], scene["y"] + 0.4 * scene["height"]]
    over = "([x, y]) => document.elementFromPoint(x, y).closest('.camera-tile') !== null"
    assert page.evaluate(over, middle)
    pad = page.locator(".pad .field").first.bounding_box()
    on_pad = [pad["x"] + 0.5 * pad["width"], pad["y"] + 0.5 * pad["height"]]
    assert not page.evaluate(over, on_pad)
    page.locator(TILE).tap()
    assert large(page) == {}


def test_a_key_steers_while_a_camera_is_large(site):
    page = thumbs(site)
    thumb(page, "wrist").click()
    site.hold(page)
    page.keyboard.up("r")
    site.until_still()
    assert set(large(page)) == {"wrist"}


def test_without_h264_small_pictures_are_shown_large_and_the_page_says_so(site, films):
    page = thumbs(site, script=NO_H264)
    thumb(page, "wrist").click()
    words = "small pictures: this browser decodes no H.264"
    site.until(lambda: words in large(page)["wrist"], "not said")
    assert " ms old" in large(page)["wrist"]
    assert films() == set()
    assert page.errors == []


def test_a_viewer_without_rights_sees_the_videos_and_one_without_the_secret_nothing(site):
    page = thumbs(site, key="only-for-observers", name="bob")
    thumb(page, "wrist").click()
    video(site, page, "wrist")
    refused = page.context.browser.new_context()
    assert refused.new_page().goto(site.console.address("wrong")).status == 401
    refused.close()


def test_ten_viewers_are_told_the_same_frames_and_go(site, films):
    page = thumbs(site)
    page.evaluate(
        """() => { window.viewers = [...Array(10).keys()].map((i) => {
          const viewer = { frames: 0 };
          viewer.socket = new WebSocket(`ws://${location.host}/ws?name=viewer${i}`);
          viewer.socket.binaryType = 'arraybuffer';
          let seen = 0;
          viewer.socket.onmessage = ({ data }) => {
            if (typeof data === 'string') return;
            viewer.frames += 1;
            seen = new DataView(data).getUint32(4, true);
          };
          setInterval(() => viewer.socket.readyState === 1 && viewer.socket.send(
            JSON.stringify({ type: 'beat', n: 0, held: {}, video: { wrist: seen } })), 100);
          return viewer;
        }); }"""
    )
    least = "Math.min(...window.viewers.map((each) => each.frames))"
    site.until(lambda: page.evaluate(least) > 40, "not everybody is told")
    page.close()
    site.until(lambda: films() == set(), "the video goes on with nobody looking")


def test_a_camera_that_stops_is_said_to_have_stopped(site):
    page = thumbs(site)
    thumb(page, "wrist").click()
    video(site, page, "wrist")
    site.plant.vision.kill()
    site.plant.vision.wait()
    site.until(lambda: large(page)["wrist"].startswith("no picture for"), "it looks alive")
    site.until(lambda: page.locator(f"{THUMB}.stopped").count() == 2, "small ones look alive")
    site.plant.start_vision()
    video(site, page, "wrist")
