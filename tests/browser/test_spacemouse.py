"""A SpaceMouse, played by a made-up device in place of the browser's: there is no USB here."""

import pytest

pytestmark = pytest.mark.browser

MOUSE = """
class Mouse extends EventTarget {
  productName = "made up mouse";
  opened = false;
  pushed = [0, 0, 0, 0, 0, 0];
  async open() { this.opened = true; setInterval(() => this.report(), 16); }
  report() {
    const event = new Event("inputreport");
    event.reportId = 1;
    event.data = new DataView(new ArrayBuffer(12));
    this.pushed.forEach((value, i) => event.data.setInt16(2 * i, value, true));
    this.dispatchEvent(event);
  }
}
window.mouse = new Mouse();
const hid = new EventTarget();
hid.requestDevice = async () => [window.mouse];
Object.defineProperty(navigator, "hid", { value: hid, configurable: true });
"""


def push(page, raw):
    """Push the puck up, or let go of it."""
    page.evaluate(f"window.mouse.pushed[2] = {raw}; window.mouse.report()")


def pushed(site, page):
    site.hold_by(page, lambda: push(page, -300), lambda: push(page, 0))


def connected(site):
    page = site.enabled(script=MOUSE)
    page.evaluate(
        "[...document.querySelectorAll('button')]"
        ".find((each) => each.textContent.startsWith('Connect a')).click()"
    )
    site.until(lambda: page.locator("text=made up mouse").count() == 1, "no mouse is seen")
    return page


def test_a_pushed_puck_moves_the_tool_until_it_springs_back(site):
    page = connected(site)
    pushed(site, page)
    push(page, 0)
    site.until_still()
    assert site.mode(page) == "enabled"


def test_a_puck_that_is_still_pushed_after_a_stop_moves_nothing(site):
    page = connected(site)
    pushed(site, page)
    page.keyboard.press("h")
    site.until(lambda: site.mode(page) == "hold", "not held")
    site.until_still()
    site.go_on(page)
    seen = site.plant.operators[0].state.tick
    site.until(lambda: site.plant.operators[0].state.tick > seen + 50, "no telemetry")
    assert site.speed() < 0.002, "the push from before the stop counts"
    push(page, 0)
    pushed(site, page)
    push(page, 0)
    site.until_still()
