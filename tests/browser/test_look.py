"""Everybody can use the page: contrast, names, order; on a desk and a tablet, dark and light."""

import pytest
from laboratory.vendor.fetch import PACKAGES

pytestmark = pytest.mark.browser

AXE = PACKAGES / "axe-core" / "axe.min.js"
DESK, TABLET = {"width": 1280, "height": 720}, {"width": 820, "height": 1180}
PHONE, LYING = {"width": 390, "height": 844}, {"width": 844, "height": 390}


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_axe_finds_no_serious_issue(site, scheme):
    if not AXE.is_file():
        pytest.skip("axe-core is not fetched: make venv")
    page = site.page(drawn=True, viewport=DESK, color_scheme=scheme)
    page.evaluate(AXE.read_text(encoding="utf-8"))
    found_in = {}
    for tab in ("Steer", "Now", "Set", "Log"):
        page.get_by_role("tab", name=tab).click()
        found = page.evaluate("axe.run().then(({violations}) => violations)")
        serious = [
            (each["id"], [node["html"][:200] for node in each["nodes"]])
            for each in found
            if each["impact"] in ("serious", "critical")
        ]
        if serious:
            found_in[tab] = serious
    assert found_in == {}


LATE = """
  // States are passed on so late as on a slow network; what the page says until then is kept.
  window.said = [];
  const timer = setInterval(() => {
    const over = document.querySelector('#over p');
    const why = document.querySelector('.why p')?.textContent;
    if (why) window.said.push(why);
    if (over && !over.hidden) window.said.push(over.textContent);
  }, 20);
  const since = performance.now();
  const { set } = Object.getOwnPropertyDescriptor(WebSocket.prototype, 'onmessage');
  Object.defineProperty(WebSocket.prototype, 'onmessage', { set(take) {
    set.call(this, ({ data }) => {
      const told = typeof data === 'string' ? JSON.parse(data) : {};
      if (told.type === 'state' && performance.now() - since < 3000) return;
      if (told.type === 'state') clearInterval(timer);
      take({ data: told.type === 'link' ? JSON.stringify({ ...told, daemon: 'alive' }) : data });
    });
  } });
"""


def test_a_page_whose_first_state_comes_late_waits_and_does_not_say_that_the_daemon_is_silent(site):
    page = site.page(script=LATE)
    assert set(page.evaluate("window.said")) == {"Waiting for the daemon."}


STANDS_STILL = """
  () => new Promise((told) => {
    const said = [], mode = document.querySelector('.mode');
    const watcher = new MutationObserver(() => said.push(mode.textContent));
    watcher.observe(mode, { characterData: true, childList: true, subtree: true });
    for (const since = performance.now(); performance.now() - since < 1500;);
    setTimeout(() => { watcher.disconnect(); told(said); }, 400);
  })
"""


def test_a_page_that_stood_still_does_not_say_that_the_daemon_is_silent(site):
    page = site.page()
    assert [page.evaluate(STANDS_STILL) for _ in range(3)] == [[], [], []]


@pytest.mark.parametrize("viewport", [DESK, TABLET], ids=["desk", "tablet"])
def test_what_matters_is_in_sight(site, viewport):
    page = site.page(drawn=True, viewport=viewport, has_touch=True)
    width, height = viewport["width"], viewport["height"]
    for what in ("#stop button", ".mode", ".why", "#scene canvas", ".pad .field", ".tabs"):
        box = page.locator(what).first.bounding_box()
        assert box is not None, what
        assert box["x"] >= 0, what
        assert box["x"] + box["width"] <= width + 1, what
        assert box["y"] >= 0, what
        assert box["y"] + box["height"] <= height + 1, what
    areas = page.evaluate(
        "[...document.querySelectorAll('button')]"
        ".map((each) => [each.id, each.offsetWidth * each.offsetHeight])"
    )
    assert max(areas, key=lambda each: each[1])[0] == "stop-button", "the stop is not the largest"
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.errors == []


@pytest.mark.parametrize("viewport", [PHONE, LYING], ids=["upright", "lying"])
def test_on_a_phone_plots_are_folded_and_sticks_stand_beside_the_arm(site, viewport):
    page = site.page(drawn=True, viewport=viewport, has_touch=True)
    strip = page.locator(".plots-strip")
    assert not strip.is_visible()
    page.locator("#plots .fold").evaluate("each => each.click()")
    site.until(strip.is_visible, "the plots do not unfold")
    for what in ("#stop button", ".mode", ".why", "#scene canvas", ".pad .field"):
        box = page.locator(what).first.bounding_box()
        assert box["x"] >= 0, what
        assert box["x"] + box["width"] <= viewport["width"] + 1, what
        assert box["y"] + box["height"] <= viewport["height"] + 1, what
    pads = [pad.bounding_box() for pad in page.locator(".pad").all()]
    scene = page.locator("#scene").bounding_box()
    middle = scene["x"] + 0.5 * scene["width"]
    beside = pads[0]["x"] + pads[0]["width"] < middle < pads[1]["x"]
    below = all(pad["y"] >= scene["y"] + scene["height"] - 1 for pad in pads)
    assert beside or below
    assert page.evaluate("document.documentElement.scrollWidth") <= viewport["width"]
    assert page.errors == []


def test_gains_have_their_axes_and_units_and_frames_say_what_they_are(site):
    page = site.page(viewport=DESK)
    page.evaluate("document.getElementById('tab-set').click()")
    card = page.locator(".card", has_text="position").first
    site.until(lambda: card.count() == 1, "no gains")
    assert card.locator(".gains b").all_text_contents() == ["x", "y", "z", "rx", "ry", "rz"]
    assert card.locator(".gains small").all_text_contents() == ["1/s"] * 6
    frames = page.locator("select[aria-label='Axes of the stick'] option")
    assert frames.all_text_contents() == ["reference (CRF)", "tool (MRF)", "base", "world"]
    assert "moving reference frame" in frames.nth(1).get_attribute("title")
    control = page.get_by_role("button", name="Take control").first
    assert "lease" in control.get_attribute("title")


def test_axes_are_left_free_and_held_again_by_their_boxes(site):
    page, watcher = site.enabled(), site.plant.operators[0]
    page.evaluate("document.getElementById('tab-set').click()")

    def press(axis):
        page.evaluate(f"document.getElementById('held-{axis}').click()")

    def shown():
        boxes = page.evaluate(
            "[...document.querySelectorAll('[id^=held-]')].map((b) => [b.checked, b.indeterminate])"
        )
        return [checked and not fading for checked, fading in boxes]

    site.until(lambda: shown() == [True] * 6, "no boxes")
    press("rx")
    press("rz")  # before the first has faded
    site.until(lambda: watcher.state.axes_held == (1, 1, 1, 0, 1, 0), "they are held")
    site.until(lambda: shown() == [True, True, True, False, True, False], "the boxes do not tell")
    watcher_sees = watcher.state.mode
    press("rx")
    press("rz")
    site.until(lambda: watcher.state.axes_held == (1,) * 6, "they are still free")
    site.until(lambda: shown() == [True] * 6, "the boxes do not tell that all are held")
    assert watcher_sees == "enabled"
    assert page.errors == []


def test_axes_that_a_page_may_not_leave_free_are_shown_as_they_are(site):
    page = site.page()
    page.evaluate("document.getElementById('tab-set').click()")
    page.evaluate("document.getElementById('held-z').click()")
    said = page.locator(".refusal", has_text="lease")
    site.until(lambda: said.count() > 0, "no refusal")
    held = "document.getElementById('held-z').checked"
    site.until(lambda: page.evaluate(held), "the box tells what was refused")
    assert site.plant.operators[0].state.axes_held == (1,) * 6
