"""Several people at one cell: one drives, all may stop, and refusals are said where they arise."""

import json
import urllib.error
import urllib.request

import pytest
from telerobot.protocols import topics as t

pytestmark = pytest.mark.browser

WATCHER = "only-for-observers"
SCRIPT = "<img src=x onerror=alert(1)>"


def test_a_viewer_stops_the_arm_by_the_space_bar_and_clears_its_own_stop(site):
    ann, viewer = site.enabled(), site.page(key=WATCHER, name="eve")
    site.hold(ann)
    viewer.keyboard.press("Space")
    site.until_still()
    site.until(lambda: site.mode(ann) == "hold", "no stop")
    site.until(lambda: "Clear it" in viewer.text_content(".why"), "no word of what to do next")
    assert "latched" in viewer.get_attribute("#stop button", "class")
    site.click(viewer, "Clear the stop")
    site.until(lambda: site.plant.operators[0].state.protective_stop is False, "not cleared")


def test_a_viewer_may_not_drive(site):
    viewer = site.page(key=WATCHER, name="eve")
    assert not viewer.get_by_role("button", name="Take control").first.is_visible()
    reply = viewer.evaluate(
        """() => new Promise((resolve) => {
          const socket = new WebSocket(`ws://${location.host}/ws?name=eve`);
          socket.onopen = () => socket.send(JSON.stringify(
            {type: "send", id: 7, key: "operator/lease", fields: {}}));
          socket.onmessage = ({data}) => {
            const message = JSON.parse(data);
            if (message.type === "reply") { socket.close(); resolve(message); }
          };
        })"""
    )
    assert (reply["ok"], reply["reason"]) == (False, "not_certified")


def test_the_lease_passes_on_by_release_only_and_the_refusal_is_said(site):
    ann, bob = site.enabled(name="ann"), site.page(name="bob")
    site.click(bob, "Take control")
    refusal = bob.locator("#bar .refusal, .actions .refusal")
    site.until(lambda: "ann" in "".join(refusal.all_text_contents()), "no refusal at the button")
    assert "Ask its holder" in "".join(refusal.all_text_contents())
    site.click(ann, "Release control")
    watcher = site.plant.operators[0]
    site.until(lambda: watcher.state.lease_holder is None, "not released")
    site.click(bob, "Take control")
    site.until(lambda: watcher.state.lease_holder == "bob", "not taken")


def test_a_setting_that_is_refused_says_why_at_its_own_control(site):
    page = site.enabled()
    page.get_by_role("tab", name="Set").click()
    card = page.locator("details[data-topic='operator/payload']")
    card.locator("summary").click()
    card.get_by_label("mass", exact=True).fill("900")
    card.get_by_role("button", name="Send").click()
    site.until(lambda: "mass" in card.locator(".refusal").text_content(), "no word of the bound")
    card.get_by_label("mass", exact=True).fill("0.5")
    card.get_by_role("button", name="Send").click()
    site.until(lambda: card.locator(".refusal").text_content() == "done", "not taken")


def test_every_topic_of_an_operator_has_a_control(site):
    page = site.page()
    offered = {
        each.get_attribute("data-topic") for each in page.locator("details[data-topic]").all()
    }
    with_controls = {
        "cmd/keepalive", "cmd/joystick", "cmd/jog", "cmd/self_motion", "cmd/drive",
        "cmd/master_pose", "operator/lease", "operator/release", "operator/protective_stop",
        "operator/protective_clear", "operator/free_axes",
        "operator/virtual_links", "operator/load_shares",
    }  # fmt: skip
    assert offered | with_controls == {topic.key for topic in (*t.COMMANDS, *t.REQUESTS)}


def test_what_cells_and_people_are_called_is_text_and_never_markup(site):
    page, other = site.enabled(name=SCRIPT), site.page(name="bob", drawn=True)
    other.evaluate("document.getElementById('tab-log').click()")
    log = other.locator("#panel-log")
    site.until(lambda: SCRIPT in log.text_content(), "the log does not name who has the lease")
    assert other.locator("#panel-log img, #bar b img, #side img, #scene img").count() == 0
    assert other.locator("script:not([src])").count() == 0
    assert page.errors == []
    assert other.errors == []


def test_ten_viewers_watch_and_the_arm_goes_on(site):
    page = site.enabled()
    socket = "new WebSocket(`ws://${location.host}/ws?name=viewer${i}`)"
    page.evaluate(f"window.viewers = [...Array(9).keys()].map((i) => {socket})")
    site.until(lambda: page.text_content("#bar").find("pages10") > 0, "ten pages are not counted")
    site.hold(page)
    page.keyboard.up("r")
    site.until_still()
    assert site.mode(page) == "enabled"


def asked(url, **headers):
    try:
        return urllib.request.urlopen(urllib.request.Request(url, headers=headers)).status
    except urllib.error.HTTPError as error:
        return error.code


def test_nobody_comes_in_without_the_secret_nor_by_another_name_of_the_host(site):
    base = f"http://127.0.0.2:{site.console.port}"
    assert asked(f"{base}/") == 401
    assert asked(f"{base}/?key=guess") == 401
    assert asked(f"{base}/scene.json") == 401
    assert asked(f"{base}/?key=only-for-operators", Host="evil.example:80") == 421


def test_a_page_of_another_origin_cannot_open_the_socket(site):
    page = site.page()
    cookies = page.context.cookies()
    cookie = f"{cookies[0]['name']}={cookies[0]['value']}"
    url = f"http://127.0.0.2:{site.console.port}/ws"
    assert asked(url, Cookie=cookie, Origin="http://evil.example") == 403
    assert cookies[0]["httpOnly"]
    assert cookies[0]["sameSite"] == "Strict"
    policy = page.evaluate("fetch('/').then((r) => r.headers.get('Content-Security-Policy'))")
    assert "'unsafe-inline'" not in policy
    assert "key=" not in page.url
    assert json.loads(page.evaluate("fetch('/catalogue.json').then((r) => r.text())"))["topics"]
