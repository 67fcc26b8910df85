"""Every way of input moves every kind of cell, and stops it when it is let go of.

A few of all pairs by default; `TELEROBOT_ALL_WAYS=1` takes all of them.
"""

import os

import pytest

pytestmark = [pytest.mark.browser, pytest.mark.usefixtures("rendering")]

GAMEPAD = """
window.pad = {id: "made up", connected: true, axes: [0, 0, 0, 0],
  buttons: [...Array(17)].map(() => ({pressed: false}))};
navigator.getGamepads = () => [window.pad];
"""
CELLS = ("pa10_pair", "rover_bridge", "snake_space", "pa10_vision")


class Key:
    def __init__(self, page):
        self._keyboard = page.keyboard

    def begin(self):
        self._keyboard.down("w")

    def end(self):
        self._keyboard.up("w")


def upper_end_of_field(page):
    """Return the middle of the round pad for moving, and a point near its upper end."""
    box = page.locator(".pad .field").first.bounding_box()
    x = box["x"] + 0.5 * box["width"]
    return (x, box["y"] + 0.5 * box["height"]), (x, box["y"] + 8)


class MouseDrag:
    def __init__(self, page):
        self._page = page

    def begin(self):
        middle, upper = upper_end_of_field(self._page)
        self._page.mouse.move(*middle)
        self._page.mouse.down()
        self._page.mouse.move(*upper)

    def end(self):
        self._page.mouse.up()


class Touch:
    def __init__(self, page):
        self._page = page
        self._browser = page.context.new_cdp_session(page)

    def _touch(self, kind, *points):
        at = [{"x": x, "y": y} for x, y in points]
        self._browser.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": at})

    def begin(self):
        middle, upper = upper_end_of_field(self._page)
        self._touch("touchStart", middle)
        self._touch("touchMove", upper)

    def end(self):
        self._touch("touchEnd")


class Gamepad:
    def __init__(self, page):
        self._page = page

    def begin(self):
        self._page.evaluate("window.pad.buttons[5].pressed = true; window.pad.axes[1] = -1")

    def end(self):
        self._page.evaluate("window.pad.buttons[5].pressed = false; window.pad.axes[1] = 0")


OPENED = {Touch: {"has_touch": True}, Gamepad: {"script": GAMEPAD}}
"""How a page is opened on which something is held this way."""

WAYS = (Key, MouseDrag, Touch, Gamepad)
EVERY = [(cell, way) for cell in CELLS for way in WAYS]
SOME = list(zip(CELLS, WAYS, strict=True))


@pytest.mark.parametrize(
    ("cell", "way"),
    EVERY if os.environ.get("TELEROBOT_ALL_WAYS") else SOME,
    ids=lambda each: each if isinstance(each, str) else each.__name__.lower(),
)
def test_what_is_held_moves_the_cell_and_what_is_let_go_of_stops_it(site_of, cell, way):
    site = site_of(cell)
    page = site.enabled(**OPENED.get(way, {}))
    made = way(page)

    def hold_and_let_go():
        site.hold_by(page, made.begin, made.end)
        made.end()
        site.until_still()
        assert site.mode(page) == "enabled"

    site.undisturbed(hold_and_let_go)
    assert page.errors == []
