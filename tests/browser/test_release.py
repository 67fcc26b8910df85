"""A motion lasts as long as it is held by a page that is alive and looked at."""

import os
import signal
import socket
import subprocess
import threading
import time

import pytest
from laboratory.bench.page.browser import FLAGS, chromium, renderers

pytestmark = pytest.mark.browser

HUNG = "for (const since = performance.now(); performance.now() - since < 8000;);"

STUTTER = """
window.stutter = 0;
setInterval(() => {
  for (const since = performance.now(); performance.now() - since < window.stutter;);
}, 1);
"""
"""A page that draws for so long, again and again [ms]."""


class Cable:
    """Address of the same port that passes everything on to the console, until it is cut."""

    def __init__(self, host, port):
        self._far = (host, port)
        self._listener = socket.create_server(("127.0.0.1", port))
        self._cut = threading.Event()
        self._sockets = [self._listener]
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while not self._cut.is_set():
            try:
                near, _ = self._listener.accept()
            except OSError:
                return
            far = socket.create_connection(self._far)
            self._sockets += [near, far]
            for pair in ((near, far), (far, near)):
                threading.Thread(target=self._carry, args=pair, daemon=True).start()

    def _carry(self, source, sink):
        try:
            while (data := source.recv(65536)) and not self._cut.is_set():
                sink.sendall(data)
            if not self._cut.is_set():
                sink.shutdown(socket.SHUT_WR)
        except OSError:
            return

    def cut(self):
        """Pass nothing on any more, and close nothing: as a cable that was pulled."""
        self._cut.set()

    def close(self):
        self.cut()
        for each in self._sockets:
            each.close()


@pytest.fixture
def tabs(browsers, tmp_path):
    """Return the tabs of a window that hides one behind the other, as people's browsers do.

    Playwright keeps every page visible that it opens in a browser which it started itself.
    """
    port = tmp_path / "DevToolsActivePort"
    child = subprocess.Popen(
        [chromium(), *FLAGS, "--headless", "--no-first-run", "--remote-debugging-port=0",
         f"--user-data-dir={tmp_path}", "about:blank"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        while not (port.is_file() and "\n" in port.read_text()):
            assert child.poll() is None, "chromium has ended"
            time.sleep(0.05)
        address = f"http://127.0.0.1:{port.read_text().split()[0]}"
        opened = browsers.playwright.chromium.connect_over_cdp(address, no_defaults=True)
        yield opened.contexts[0]
        opened.close()
    finally:
        child.terminate()
        child.wait()


def test_a_held_key_moves_the_tool_until_it_is_released(site):
    page = site.enabled()
    before = site.plant.truth.pose_mrf
    site.hold(page)
    page.keyboard.up("r")
    site.until_still()
    site.plant.turn()
    assert max(abs(a - b) for a, b in zip(site.plant.truth.pose_mrf, before, strict=True)) > 1e-3
    assert site.mode(page) == "enabled"
    assert "stream_expired" not in site.events(), "the stop was found out, not told"
    assert page.errors == []


def test_a_page_that_loses_the_focus_to_another_lets_go_of_everything(site):
    page = site.enabled()
    # Playwright lets every page believe that it has the focus, unless it is told not to.
    focus = page.context.new_cdp_session(page)
    focus.send("Emulation.setFocusEmulationEnabled", {"enabled": False})
    page.bring_to_front()
    page.evaluate("addEventListener('blur', (event) => { window.lost = event.isTrusted; })")
    site.hold(page)
    other = page.context.new_page()
    other.bring_to_front()
    site.until_still()
    assert page.evaluate("window.lost") is True, "the browser itself has to say so"
    assert site.mode(page) == "enabled"
    assert "stream_expired" not in site.events(), "the stop was found out, not told"
    page.keyboard.up("r")


def test_a_tab_that_is_hidden_by_another_lets_go_of_everything(site, tabs):
    page = site.tab(tabs)
    site.hold(page)
    page.evaluate(
        "document.addEventListener('visibilitychange', (event) => {"
        " window.became = [document.visibilityState, event.isTrusted]; })"
    )
    tabs.pages[0].bring_to_front()
    site.until_still()
    assert page.evaluate("window.became") == ["hidden", True], "the browser itself has to say so"
    assert site.mode(page) == "enabled"
    assert not {"stream_expired", "lease_expired"} & set(site.events()), "found out, not told"
    page.bring_to_front()
    page.keyboard.up("r")
    site.hold(page)
    page.keyboard.up("r")
    site.until_still()


def test_a_page_that_is_closed_gives_the_lease_back_and_the_arm_holds(site):
    page = site.enabled()
    site.hold(page)
    page.close()
    site.until_still()
    watcher = site.plant.operators[0]
    site.until(lambda: watcher.state.lease_holder is None, "the lease was not given back")
    site.until(lambda: "lease_released" in site.events(), "nobody was told")


@pytest.mark.parametrize("ending", ["frozen", "hung"])
def test_a_page_that_hangs_stops_the_arm_and_loses_the_lease(site, ending):
    page = site.enabled()
    site.hold(page)
    stopped = renderers() if ending == "frozen" else []
    for pid in stopped:
        os.kill(pid, signal.SIGSTOP)
    if ending == "hung":
        page.evaluate(f"setTimeout(() => {{ {HUNG} }})")
    try:
        site.until_still()
        watcher = site.plant.operators[0]
        site.until(lambda: "lease_expired" in site.events(), "the lease lives on")
        # Events and state come by ways of their own.
        site.until(lambda: watcher.state.lease_holder is None, "the lease lives on")
    finally:
        for pid in stopped:
            os.kill(pid, signal.SIGCONT)
    site.until(lambda: site.mode(page) == "hold", "the page does not come back")
    site.until_still()


def test_a_page_that_stutters_says_why_what_is_held_moves_nothing(site):
    page = site.enabled(script=STUTTER)
    page.evaluate("window.stutter = 400")
    page.keyboard.down("r")
    said = page.locator(".actions .refusal")
    site.until(lambda: "stood still" in said.text_content(), "the page does not say so")
    site.until_still()
    page.keyboard.up("r")
    page.evaluate("window.stutter = 0")
    site.hold(page)
    page.keyboard.up("r")
    site.until_still()
    assert site.mode(page) == "enabled"


def test_a_cut_cable_stops_the_arm_and_the_page_says_so(site):
    cable = Cable("127.0.0.2", site.console.port)
    try:
        page = site.enabled(host="127.0.0.1")
        site.hold(page)
        cable.cut()
        site.until_still()
        site.until(lambda: page.is_visible("#over p"), "the page does not say that it is cut off")
    finally:
        cable.close()


def test_a_page_that_is_loaded_again_in_motion_lets_go(site):
    page = site.enabled()
    site.hold(page)
    page.reload()
    site.until_still()
    page.wait_for_selector("body[data-ready]")
    site.until(lambda: site.mode(page) == "hold", "the page shows no state")
    site.go_on(page)


def test_a_console_that_is_killed_is_said_and_the_arm_holds(site):
    page = site.enabled()
    site.hold(page)
    site.console.kill()
    site.until_still()
    site.until(lambda: page.is_visible("#over p"), "the page does not say so")
    site.console.start()
    site.until(lambda: site.mode(page) == "hold", "the page does not find the console again")


def test_a_daemon_that_is_killed_is_said_and_found_again(site):
    page = site.enabled()
    site.hold(page)
    site.plant.kill9_daemon()
    site.until_still()
    site.until(lambda: "silent" in page.text_content("#over p"), "the page does not say so")
    page.keyboard.up("r")
    site.plant.start_daemon()
    site.until(lambda: not page.is_visible("#over p"), "the page does not find the daemon again")
    site.until(lambda: site.mode(page) != "enabled", "the page shows what the old daemon told")
    site.go_on(page)
