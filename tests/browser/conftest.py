"""The console in a real Chromium, against a rig, a daemon and a console that are real processes.

One plant at a time serves the tests, since starting it takes most of the time; each has pages of
its own, and begins with the arm in HOLD or READY and nobody holding the lease. What moves is
judged by the rig's truth. Nothing here sleeps: `Site.until` waits for a state.
"""

import importlib.util
import math
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from laboratory.bench.page.browser import children
from telerobot.config.load import load_cell
from telerobot.tools.host.address import options
from telerobot.tools.host.machine import free_port

HOST = "127.0.0.2"
"""The console's own address; that of the same port on 127.0.0.1 is the tests' to cut."""

SECRET, WATCHER = "only-for-operators", "only-for-observers"
PLAIN = ("--disable-3d-apis", "--disable-gpu")
DRAWING = (
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-accelerated-2d-canvas",
)
HOSTILE = "<img src=x onerror=alert(1)><script>alert(2)</script>"
PATIENCE_S = 180.0
"""Wall time after which something will never be; a limit for failures only [s]."""
LEASE_S = 3.0
"""How long the daemon here keeps the lease of a page that says nothing [s]."""
PICTURE_S = 2.0
"""How long it believes a picture: a camera's process shares two cores with a Chromium [s]."""
TRIES = 5
"""So often a page may hang for so long that it loses the lease."""

STAYS, STAYS_S = 2e-4, 0.3
"""A joint that moves by less [rad] in so much physics time [s] stands."""

SILENT = {"lease_expired", "stream_expired"}
"""What the daemon tells of a page that says nothing for a while; a busy machine makes it."""

COARSE = 0.3
SMALL = {"width": 960, "height": 620}
"""Drawn by the processor alone, a picture takes its time; the fewer points, the less."""

NICEST = 19
READY = "body[data-ready]"
OFFERED = ".actions button.next:not([hidden])"
AGAIN_S = 3.0
"""A button is pressed again if the page still offers it by then [s]."""

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.fixture(scope="session")
def browsers():
    """Return what opens a browser, with a scene or without; skip, with the reason, where none is.

    Most tests do without the scene: to draw it without a graphics card takes a core.
    """
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no chromium here: apt-get install chromium")
    from laboratory.vendor.fetch import missing

    if missing():
        pytest.skip("the page's JavaScript is not fetched: make venv")
    with sync_api.sync_playwright() as playwright:
        opened = {}

        def browser(drawn):
            if drawn not in opened:
                flags = ["--no-sandbox", *(DRAWING if drawn else PLAIN)]
                opened[drawn] = playwright.chromium.launch(executable_path=CHROMIUM, args=flags)
            return opened[drawn]

        browser.playwright = playwright
        yield browser
        for each in opened.values():
            each.close()


class Console:
    """The console's process."""

    def __init__(self, cell):
        self.port = free_port(socket.SOCK_STREAM)
        self._cell = cell
        self.start()

    def start(self):
        self.process = subprocess.Popen(
            [
                sys.executable, "-m", "telerobot.tools.cli", "console",
                *options(self._cell, bus=False), f"--listen={HOST}:{self.port}",
            ],
            env={**os.environ, "TELEROBOT_CONSOLE_KEYS": f"{SECRET},{WATCHER}"},
            stdout=subprocess.PIPE,
            text=True,
        )  # fmt: skip
        for _ in range(2):
            assert self.process.stdout.readline(), "the console did not start"

    def address(self, key=SECRET, host=HOST):
        return f"http://{host}:{self.port}/?key={key}"

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def close(self):
        self.process.terminate()
        self.process.wait()
        self.process.stdout.close()


def stand_back():
    """Keep Chromium's drawing to one core: without a graphics card it would take all of them."""
    core = {max(os.sched_getaffinity(0))}
    for pid in children("--type=gpu-process"):
        for thread in Path(f"/proc/{pid}/task").iterdir():
            with suppress(ProcessLookupError):  # it has ended meanwhile
                os.sched_setaffinity(int(thread.name), core)
                os.setpriority(os.PRIO_PROCESS, int(thread.name), NICEST)


def complaint(told):
    """Return what a page's console says, and of which file."""
    return f"{told.text} ({told.location['url']})"


class Site:
    """A plant with a console, and pages that are open on it."""

    def __init__(self, plant, browsers):
        self.plant, self._browsers = plant, browsers
        self.console = Console(plant.cell)
        self._contexts = []
        self._repeats = False

    def page(self, key=SECRET, name="ann", host=HOST, script="", drawn=False, **context):
        """Return a page that has come in, and shows a state; its scene only if `drawn`."""
        opened = self._browsers(drawn).new_context(
            **{
                "viewport": SMALL,
                "device_scale_factor": COARSE,
                "reduced_motion": "reduce",
                **context,
            }
        )
        self._contexts.append(opened)
        return self.come_in(opened.new_page(), key, name, host, script)

    def come_in(self, page, key=SECRET, name="ann", host=HOST, script=""):
        """Let a page come in; return it once it shows a state."""
        page.errors = []
        page.on("pageerror", lambda error: page.errors.append(str(error)))
        page.on(
            "console", lambda told: told.type == "error" and page.errors.append(complaint(told))
        )
        page.add_init_script(f"localStorage.setItem('name', {name!r})")
        if script:
            page.add_init_script(script)
        page.goto(self.console.address(key, host))
        # Attached, not visible: that would wait for pictures of the page, which come late.
        page.wait_for_selector(READY, state="attached", timeout=1000 * PATIENCE_S)
        stand_back()
        self.until(lambda: self.mode(page) not in ("…", "no daemon"), "the page shows no state")
        return page

    def enabled(self, **more):
        """Return a page that holds the lease of an arm that is enabled.

        It does what the page offers to do next: on a busy machine a lease may run out meanwhile.
        """
        page = self.page(**more)
        self.go_on(page)
        return page

    def tab(self, context):
        """Return a new tab of a browser that has come in, and goes when everybody leaves."""
        page = context.new_page()
        self._contexts.append(page)
        return self.come_in(page)

    def go_on(self, page):
        """Press what the page offers next, until the arm is enabled."""

        pressed, pressed_s = "", 0.0

        def enabled():
            nonlocal pressed, pressed_s
            offered = page.evaluate(f"document.querySelector('{OFFERED}')?.textContent ?? ''")
            again = offered != pressed or time.monotonic() - pressed_s > AGAIN_S
            if offered and again:
                pressed, pressed_s = offered, time.monotonic()
                page.evaluate(f"document.querySelector('{OFFERED}')?.click()")
            mine = "(you)" in page.text_content("#bar")
            return self.mode(page) == "enabled" and mine and not offered

        self.until(enabled, "not enabled")

    def click(self, page, name):
        page.get_by_role("button", name=name, exact=True).first.click(timeout=1000 * PATIENCE_S)

    def mode(self, page):
        return page.text_content(".mode").lower()

    def until(self, done, why):
        """Wait until something holds; the browser and the plant go on meanwhile."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not done():
            self.plant.turn()
            assert not (self._repeats and self.lost_the_lease()), f"{why}: the lease is lost"
            assert time.monotonic() < deadline_s, f"{why}; {self.plant.told()}"

    def soon(self, done):
        """Return whether something comes to hold within `AGAIN_S`."""
        deadline_s = time.monotonic() + AGAIN_S
        while not done() and time.monotonic() < deadline_s:
            self.plant.turn()
        return done()

    def of_joints(self, values):
        """Return those of the joints that an operator moves; a scanner's nods by itself."""
        cell = self.plant.cell
        swept = [(part.prefix, part.config.mechanism.sweep) for part in cell.parts]
        nodding = [prefix + sweep.joint for prefix, sweep in swept if sweep is not None]
        told = zip(cell.joints, values, strict=True)
        return [value for joint, value in told if joint not in nodding]

    def speed(self):
        """Return how fast the arm's joints move, in truth [rad/s]."""
        self.plant.turn()
        return max(map(abs, self.of_joints(self.plant.truth.dq)))

    def hold(self, page, key="r"):
        """Hold a key until the arm moves by it."""
        self.hold_by(page, lambda: page.keyboard.down(key), lambda: page.keyboard.up(key))

    def hold_by(self, page, begin, end, moves=None):
        """Hold something until the arm moves by it; begin anew if the page missed or lost it.

        A page that stutters by more than 0.2 s moves nothing, as it should: its console stops what
        is held, and has it let go of first. A machine may make it stutter for as long as it likes.
        """
        moves = moves or (lambda: self.speed() > 0.01)
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            self.go_on(page)
            self.forget()
            begin()
            self.soon(lambda: moves() or self.fell_silent())
            if moves() and not self.fell_silent():
                return
            end()
        raise AssertionError(f"the arm does not move; {self.plant.told()}")

    def fell_silent(self):
        """Return whether the daemon has told that a page which held something said nothing."""
        return bool(SILENT & set(self.events()))

    def undisturbed(self, turn):
        """Do something; anew from its beginning where the page lost its lease meanwhile.

        A page that a busy machine keeps silent for too long loses it, and is refused from then on.
        """
        self._repeats = True
        try:
            for _ in range(TRIES):
                self.forget()
                try:
                    return turn()
                except Exception:  # a button that is offered no more, too
                    if not self.soon(self.lost_the_lease):
                        raise
        finally:
            self._repeats = False
        raise AssertionError(f"the page lost the lease {TRIES} times; {self.plant.told()}")

    def until_still(self):
        """Wait until the joints have stayed for a while where they are, in truth.

        A command that stands is not enough, nor a low speed: a drive's integrator takes another
        second for the last millimetre of a quick stop.
        """
        stood, since_s = [], 0.0

        def still():
            nonlocal stood, since_s
            self.plant.turn()
            truth = self.plant.truth
            now = self.of_joints(truth.q)
            moved = [abs(a - b) for a, b in zip(now, stood, strict=True)] if stood else [math.inf]
            if max(moved) > STAYS:
                stood, since_s = now, truth.time_s
            return truth.time_s - since_s > STAYS_S

        self.until(still, "the arm does not stop")

    def lost_the_lease(self):
        """Return whether the daemon has told that a lease ran out."""
        return "lease_expired" in self.events()

    def events(self):
        """Return the names of the daemon's events that the test's own operator has read."""
        return [event.name for event in self.plant.operators[0].events]

    def forget(self):
        self.plant.operators[0].events.clear()

    def leave(self):
        """Close all pages, wait until nobody holds the lease, and reset what stopped the arm."""
        for context in self._contexts:
            context.close()
        self._contexts.clear()
        watcher = self.plant.operators[0]
        at_rest = ("ready", "hold", "fault")
        self.until(
            lambda: watcher.state.lease_holder is None and watcher.state.mode in at_rest,
            "a page that has gone still holds the lease",
        )
        if watcher.state.protective_stop or watcher.state.mode == "fault":
            watcher.acquire()
            if watcher.state.protective_stop:
                watcher.clear_protective_stop()
            if watcher.state.mode == "fault":
                watcher.reset()
            watcher.release()

    def close(self):
        for context in self._contexts:
            context.close()
        self.console.close()


def plant_type():
    """Return the `Plant` of the tests on processes; conftest files cannot import each other."""
    path = Path(__file__).resolve().parents[1] / "hil" / "conftest.py"
    spec = importlib.util.spec_from_file_location("plant_of_processes", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Plant


@pytest.fixture(scope="session")
def site_of(browsers, tmp_path_factory):
    """Return what gives a cell with a console; one at a time, the last that was asked for.

    Leases and pictures last for longer than shipped, which tests on processes judge: without a
    graphics card a page, and the cameras beside it, may stand still for a second.

    Two would take all of a small machine. What a test left open is closed, and the arm comes to
    rest.
    """
    ends = ExitStack()
    running = {}
    folder = tmp_path_factory.mktemp("patient")

    def patient(name):
        path = load_cell(name).path
        timing = f"[timing]\nlease_timeout_s = {LEASE_S}\n"
        text = re.sub(r"^lease_timeout_s = .*\n", "", path.read_text(), flags=re.M)
        text = re.sub(r"^\[timing\]\n", timing, text, flags=re.M)
        vision = f"[sources.vision]\ntimeout_s = {PICTURE_S}\n"
        text = re.sub(r"^\[sources\.vision\]\n", vision, text, flags=re.M)
        written = folder / path.name
        written.write_text(text if timing in text else f"{text}\n{timing}")
        return written

    def of(name):
        if name not in running:
            ends.close()
            running.clear()
            plant = ends.enter_context(plant_type()(load_cell(patient(name))))
            plant.operator("watcher")
            running[name] = Site(plant, browsers)
            ends.callback(running[name].close)
        running[name].leave()
        running[name].forget()
        return running[name]

    yield of
    ends.close()


@pytest.fixture(scope="session")
def hostile(tmp_path_factory):
    """Return the path of a PA-10 whose description is hostile."""
    path = tmp_path_factory.mktemp("cell") / "pa10.toml"
    text = load_cell("pa10").path.read_text()
    path.write_text(re.sub(r"^description = .*$", f"description = '{HOSTILE}'", text, flags=re.M))
    return path


@pytest.fixture
def site(site_of, hostile):
    """Return the console of that with no page open and nobody driving."""
    found = site_of(hostile)
    yield found
    found.leave()


@pytest.fixture(scope="module")
def rover(site_of):
    """Return a rover with a console."""
    return site_of("rover")
