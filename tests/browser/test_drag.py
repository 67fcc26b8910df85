"""The handle at the MRF, dragged with the mouse in a scene that is drawn; judged by the truth."""

import math

import pytest

pytestmark = pytest.mark.browser

TRIES = 5
"""Drawn without a graphics card, a page may miss the handle, or fall silent; then once more."""

FOLLOWS = 2e-3
"""The tool follows a drag once it has gone so far [m]."""

FAR = 60
"""Dragged so far the arm is under way for a while [px]."""
LISTEN = """
const send = WebSocket.prototype.send;
WebSocket.prototype.send = function(text) {
  const led = JSON.parse(text).held?.["cmd/master_pose"];
  if (led) (window.led ??= []).push(led.xyz);
  return send.call(this, text);
};
"""
"""Notes where the page leads the tool live."""


def opened(site, live):
    """Return a page that holds the lease, with the handle in sight; no axis of it hides another."""
    page = site.enabled(drawn=True, script=LISTEN)
    site.click(page, "home")
    site.click(page, "Move")
    page.get_by_label("live", exact=True).set_checked(live, timeout=60_000)
    return page


def place(site):
    site.plant.turn()
    return site.plant.truth.pose_mrf[:3]


def grasp(page, up):
    """Press the mouse on the handle, and drag it up by so much [px]."""
    x, y = page.evaluate("document.getElementById('scene').handleOnScreen()")
    box = page.locator("#scene").bounding_box()
    page.mouse.move(box["x"] + x, box["y"] + y)
    page.mouse.down()
    page.mouse.move(box["x"] + x, box["y"] + y - up, steps=6)


def drag_live(site, page, up):
    """Drag the handle until the tool follows; return where the tool was."""
    before = []

    def begin():
        site.click(page, "home")  # a drag that misses the handle turns the view
        before[:] = place(site)
        page.evaluate("window.led = []")
        grasp(page, up)

    site.hold_by(page, begin, page.mouse.up, lambda: math.dist(place(site), before) > FOLLOWS)
    return before


def led(page):
    """Return by how much the page has led the tool since it was grasped [m]."""
    first, last = page.evaluate("[window.led[0], window.led.at(-1)]")
    return [b - a for a, b in zip(first, last, strict=True)]


def test_a_handle_that_is_dragged_live_has_the_tool_follow_before_it_is_let_go_of(site):
    page = opened(site, live=True)
    watcher = site.plant.operators[0]
    before = []

    def off():
        way = [b - a for a, b in zip(before, place(site), strict=True)]
        return math.dist(way, led(page))

    for _ in range(TRIES):
        before[:] = drag_live(site, page, 20)
        site.until_still()
        site.until(
            lambda: off() < 1e-3 or site.fell_silent(), "the tool is not where the handle is"
        )
        if not site.fell_silent():
            break
        page.mouse.up()
    assert math.hypot(*led(page)) > 0.01, "the handle was dragged by more than this"
    assert off() < 1e-3
    assert site.mode(page) == "enabled"
    page.mouse.up()
    stood = place(site)
    seen = watcher.state.tick
    site.until(lambda: watcher.state.tick > seen + 50, "no telemetry")
    assert math.dist(place(site), stood) < 1e-3, "let go of, the tool moves on"
    assert page.errors == []


def release(page):
    page.mouse.up()


def escape(page):
    page.keyboard.press("Escape")


def blur(page):
    focus = page.context.new_cdp_session(page)
    focus.send("Emulation.setFocusEmulationEnabled", {"enabled": False})
    page.context.new_page().bring_to_front()


@pytest.mark.parametrize("ending", [release, escape, blur])
def test_a_live_drag_ends_at_once_and_what_is_dragged_on_moves_nothing(site, ending):
    page = opened(site, live=True)
    watcher = site.plant.operators[0]
    for _ in range(TRIES):
        page.bring_to_front()
        before = drag_live(site, page, FAR)
        ending(page)
        site.until_still()
        stood = place(site)
        page.mouse.move(400, 300, steps=3)
        seen = watcher.state.tick
        site.until(lambda seen=seen: watcher.state.tick > seen + 50, "no telemetry")
        page.mouse.up()
        if not site.fell_silent():
            break
    assert math.dist(place(site), stood) < 1e-3, "the tool moves on"
    assert math.dist(stood, before) > 1e-3
    assert watcher.state.target_mrf is None
    assert site.mode(page) == "enabled"
    assert "stream_expired" not in site.events(), "the stop was found out, not told"


def test_a_drag_that_escape_ends_is_no_target(site):
    page = opened(site, live=False)
    watcher = site.plant.operators[0]
    grasp(page, 15)
    escape(page)
    page.mouse.up()
    seen = watcher.state.tick
    site.until(lambda: watcher.state.tick > seen + 50, "no telemetry")
    assert watcher.state.target_mrf is None
    for _ in range(TRIES):  # the same drag without it is one
        site.go_on(page)
        grasp(page, 15)
        page.mouse.up()
        if site.soon(lambda: watcher.state.target_mrf is not None):
            return
    raise AssertionError("the handle is not where the test believes")
