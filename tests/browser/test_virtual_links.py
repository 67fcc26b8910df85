"""The page sets the links along which a tool may leave its path, and tells how they are."""

import os

import pytest

pytestmark = [pytest.mark.browser]


def test_links_are_set_by_their_fields_and_a_refusal_says_why(site_of):
    site = site_of("ur5e_scene")
    page = site.enabled()
    page.get_by_role("tab", name="Set").click()
    links = page.get_by_role("heading", name="Virtual links").locator("..")
    links.scroll_into_view_if_needed()
    first, second = links.get_by_label("first link"), links.get_by_label("second link")
    site.until(lambda: first.input_value() == "0 0 1", "not told how the cell's link points")
    told = site.plant.operators[0]

    def set_refused_and_back():
        site.go_on(page)
        first.fill("1 0 0")
        second.fill("0 0,6 -0.8")
        links.get_by_label("axes of the links").select_option("path")
        links.get_by_label("stiffness of the links").fill("25")
        links.get_by_role("button", name="Set the links").click()
        ways = ((1.0, 0.0, 0.0), (0.0, 0.6, -0.8))
        site.until(lambda: told.state.link_directions == ways, "the links are not set")
        assert told.state.links == {"axes": "path", "always": False, "stiffness": 25.0}
        if folder := os.environ.get("TELEROBOT_PICTURES"):
            page.screenshot(path=f"{folder}/virtual_links.png")
        second.fill("1 0 1")
        links.get_by_role("button", name="Set the links").click()
        site.until(lambda: "square to each other" in links.text_content(), "no word of the reason")
        assert told.state.link_directions == ways
        links.get_by_role("button", name="As the cell says").click()
        site.until(
            lambda: told.state.link_directions == ((0.0, 0.0, 1.0),), "the cell's is not back"
        )
        site.until(
            lambda: (first.input_value(), second.input_value()) == ("0 0 1", ""), "not shown"
        )

    site.undisturbed(set_refused_and_back)
    assert page.errors == []


def test_a_cell_without_links_shows_none(site):
    page = site.enabled()
    page.get_by_role("tab", name="Set").click()
    assert not page.get_by_role("heading", name="Virtual links").is_visible()
