"""Everybody can use the page: contrast, names, order; on a desk and a tablet, dark and light."""

import pytest
from telerobot.tools.operator.web.vendor.fetch import PACKAGES

pytestmark = pytest.mark.browser

AXE = PACKAGES / "axe-core" / "axe.min.js"
DESK, TABLET = {"width": 1280, "height": 720}, {"width": 820, "height": 1180}


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
