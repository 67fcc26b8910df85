"""The page shares the load of a payload out anew, and tells what each arm carries."""

import os

import pytest

pytestmark = [pytest.mark.browser]


def test_the_load_goes_over_by_two_fields_and_a_refusal_names_arm_and_bound(site_of):
    site = site_of("pa10_pair")
    page = site.enabled()
    page.get_by_role("tab", name="Set").click()
    load = page.get_by_role("heading", name="Load of the payload").locator("..")
    load.scroll_into_view_if_needed()

    def share(weight):
        load.get_by_label("left weight").fill(weight)
        load.get_by_role("button", name="Share the load so").click()

    def back():
        load.get_by_role("button", name="As the cell says").click()
        site.until(lambda: "of 24.5 N" in load.text_content(), "the cell's own are not there")

    def there_and_back():
        site.go_on(page)
        back()
        share("3")
        site.until(lambda: "of 14.5 N" in load.text_content(), "the load did not go over")
        if folder := os.environ.get("TELEROBOT_PICTURES"):
            page.screenshot(path=f"{folder}/load_shares.png")
        share("1000")
        site.until(lambda: "right: axis Tx" in load.text_content(), "no word of arm and bound")
        back()

    site.until(lambda: "of 24.5 N" in load.text_content(), "not told what an arm carries")
    site.undisturbed(there_and_back)
    assert page.errors == []
