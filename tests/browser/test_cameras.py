"""Cameras to steer by: large in the scene's place, as video, with how old it is."""

import re
import subprocess
import sys

import pytest
from telerobot.drivers.network.session import Session
from telerobot.protocols import topics as t
from telerobot.tools.host.address import options

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


BITS = 24
MEDIAN_OF = 15
"""Frames whose median age the page shows, as `cameras.js` has it [1]."""
AGREE_MS = 40
STAMPED = f"""
import sys, time
import numpy as np
from telerobot.drivers.rig.physics.camera import RigCameras
from telerobot.drivers.vision import process
from telerobot.tools.cli import main

def stamped(self, camera, *args, **more):
    height, width = self._cameras[camera].size[::-1]
    now = round(1000 * time.time())
    row = 255 * (now >> np.arange(width) * {BITS} // width & 1).astype(np.uint8)
    return np.broadcast_to(row[:, None], (height, width, 3)).copy()

def slow(self, *args, tell=process._Video.tell):
    time.sleep(float(sys.argv[1]))
    tell(self, *args)

RigCameras.picture, process._Video.tell = stamped, slow
sys.exit(main(sys.argv[2:]))
"""
"""The cameras' process, whose pictures show the wall clock as stripes and go on late by a delay."""

READ = f"""
  window.ages = [];
  const {{ drawImage }} = CanvasRenderingContext2D.prototype;
  CanvasRenderingContext2D.prototype.drawImage = function (image, ...where) {{
    drawImage.call(this, image, ...where);
    if (!(image instanceof VideoFrame)) return;
    const now = Date.now();
    const {{ width, height }} = this.canvas;
    const {{ data }} = this.getImageData(0, height >> 1, width, 1);
    let stamp = 0;
    for (let i = 0; i < {BITS}; i++) {{
      if (data[4 * Math.floor((i + 0.5) * width / {BITS})] > 127) stamp += 2 ** i;
    }}
    window.ages.push(((now - stamp) % 2 ** {BITS} + 2 ** {BITS}) % 2 ** {BITS});
  }};
  window.readings = [];
  new MutationObserver((changes) => {{
    const told = changes.map(({{ target }}) => target);
    const words = told.find((each) => each.matches?.(".camera-words output"));
    const last = ages.slice(-{MEDIAN_OF}).sort((a, b) => a - b);
    if (!words || last.length < {MEDIAN_OF}) return;
    window.readings.push([words.textContent, last[{MEDIAN_OF} >> 1]]);
  }}).observe(document, {{ subtree: true, childList: true }});
"""
"""Keeps the age of each frame [ms], when it is drawn, by its stripes; and beside all words on the
age of a large picture the median by the stripes of the frames that they are said of."""


@pytest.mark.parametrize("delay_s", [0.0, 0.25])
def test_the_age_that_is_shown_is_that_by_a_clock_in_the_picture_itself(site, delay_s):
    plant = site.plant
    plant.vision.kill()
    plant.vision.wait()
    arguments = ["vision", *options(plant.cell, bus=False)]
    with subprocess.Popen([sys.executable, "-c", STAMPED, str(delay_s), *arguments]) as child:
        try:
            page = thumbs(site, script=READ)
            thumb(page, "wrist").click()
            site.until(lambda: agreed(page), "what is shown is not the age of what is to be seen")
            assert min(page.evaluate("ages")) >= 1000 * delay_s
        finally:
            child.terminate()
    plant.start_vision()


def agreed(page):
    """Return the readings whose words agree with the pictures that they are said of.

    A busy machine makes a picture later than the tick that it is told to be of, and then it is
    younger than the words; no load makes words agree that are always wrong.
    """
    told = [(SHOWN.fullmatch(words), age) for words, age in page.evaluate("readings")]
    return [age for shown, age in told if shown and abs(int(shown[2]) - age) <= AGREE_MS]


def test_a_stored_view_is_kept_by_its_picture_and_the_page_tells_how_far_off_it_is(site):
    page = thumbs(site)
    told = page.locator("#side")
    wanted = re.compile(r"\d+\.\d mm +\d+\.\d° +\d+\.\d px +kept by its picture")

    def free():
        return site.plant.operators[0].state.lease_holder is None

    def mine():
        return "(you)" in page.text_content("#bar")

    def press(*names):
        page.get_by_role("tab", name="Set").click()
        for name in names:
            page.get_by_role("button", name=name).click()
        page.get_by_role("tab", name="Now").click()

    def keep_both_ways():
        site.until(lambda: free() != mine(), "the page is late")
        if free():
            page.get_by_role("button", name="Take control").first.click()
            site.until(mine, "no lease")
        press("Store the view", "Keep it by its picture")
        site.until(lambda: wanted.search(told.inner_text()), "nothing is said of the picture")
        press("by its pose")
        site.until(lambda: "kept by its pose" in told.inner_text(), "still kept by its picture")

    site.undisturbed(keep_both_ways)
    assert page.errors == []
