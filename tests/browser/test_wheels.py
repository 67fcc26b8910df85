"""A rover that is driven by keys and buttons of the page; judged by where its base is in truth."""

import math
import re

import pytest

pytestmark = pytest.mark.browser

FAR = 0.02
"""The base has gone when it is so far from where it was [m]."""
TURNED = 0.02
"""... or is turned by so much [rad]."""
PLACE = re.compile(r"([-+]?[\d.]+) +([-+]?[\d.]+) m\s+heading")
"""How the page writes where the base stands."""


def base(rover):
    rover.plant.turn()
    return rover.plant.truth.frames["base"]


def gone(rover, before):
    now = base(rover)
    return math.dist(now[:2], before[:2]) > FAR or abs(now[5] - before[5]) > TURNED


@pytest.fixture
def page(rover):
    """Return a page that holds the lease of an enabled rover, and closes afterwards."""
    yield rover.enabled()
    rover.leave()


@pytest.mark.parametrize(("key", "ahead", "left"), [("v", 1, 0), ("b", -1, 0), (",", 0, 1)])
def test_a_key_drives_the_base_until_it_is_released(rover, page, key, ahead, left):
    before = base(rover)
    rover.hold_by(
        page,
        lambda: page.keyboard.down(key),
        lambda: page.keyboard.up(key),
        lambda: gone(rover, before),
    )
    page.keyboard.up(key)
    rover.until_still()
    now = base(rover)
    way = [now[i] - before[i] for i in range(2)]
    along = way[0] * math.cos(before[5]) + way[1] * math.sin(before[5])
    if ahead:
        assert along * ahead > 0.5 * FAR
    else:
        assert (now[5] - before[5]) * left > 0.5 * TURNED
    assert rover.mode(page) == "enabled"
    assert "stream_expired" not in rover.events(), "the stop was found out, not told"


def test_the_page_tells_where_the_base_stands(rover, page):
    page.evaluate("document.getElementById('tab-now').click()")
    shown = page.locator("#panel-now")
    rover.until(lambda: "base in world" in shown.inner_text().lower(), "no word of the base")

    def off():
        told = PLACE.search(shown.inner_text())
        return math.inf if told is None else math.dist(map(float, told.groups()), base(rover)[:2])

    rover.until(lambda: off() < 0.01, "another place")


def test_a_button_that_is_held_while_the_speed_changes_still_ends_with_its_release(rover, page):
    def press():
        box = page.get_by_role("button", name="Ahead", exact=True).bounding_box()
        page.mouse.move(box["x"] + 5, box["y"] + 5)
        page.mouse.down()

    before = base(rover)
    rover.hold_by(page, press, page.mouse.up, lambda: gone(rover, before))
    page.keyboard.press("-")
    page.mouse.up()
    rover.until_still()
    assert rover.mode(page) == "enabled"
