"""From a key on the page to the bus, and from its release to rest; what page and viewers cost.

Keys are pressed in a real Chromium against a rig, a daemon and a console that are processes. When
the browser sees an event it says by its own clock, the wall clock; a passive member of the bus has
the kernel's stamps of the first frame whose target has changed; rest is told by the rig's truth.
Force control and self-motion are off, as for `latency`.
"""

import operator
import os
import signal
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from telerobot.config.load import Cell
from telerobot.drivers.bus import CanBus, open_bus
from telerobot.drivers.network.sensor_session import newest
from telerobot.drivers.network.session import Session
from telerobot.protocols import topics as t
from telerobot.protocols.canopen.can301 import SYNC_ID
from telerobot.protocols.messages.rig import RigTruth
from telerobot.protocols.messages.telemetry import State
from telerobot.server.control.spatial import Array
from telerobot.tools.bench.figures import Figures, percentiles
from telerobot.tools.bench.latency import Targets, frames, without_self_motion
from telerobot.tools.host.local_plant import LocalPlant, listens
from telerobot.tools.host.machine import free_port

from .browser import FLAGS as BROWSER_FLAGS
from .browser import OpenPage, chromium, cpu_s, missing, renderers

SECRET: Final = "only-for-the-bench"
KEYS: Final = 60
QUICK_KEYS: Final = 10
SECONDS: Final = 20.0
QUICK_SECONDS: Final = 5.0
STILL_S: Final = 0.08
MOVING: Final = 0.01
"""Joint rate of the rig's truth [rad/s]."""
LEFT: Final = {"slower": 0.9, "rest": 0.05, "settled": 0.01}
"""What is left of the arm's speed once a release is felt, once it has stopped, and once its servos
have settled, which takes them some 0.1 mrad [1]."""
AT_REST: Final = list(LEFT).index("rest")
HELD_S: Final = 0.3
TRIES: Final = 5
"""Trials of each ending other than a key's release [1]."""
GIVE_UP_S: Final = 3.0
START_S: Final = 120.0
PRESS_S: Final = 0.025
STOP_S: Final = 0.05
"""Targets: two periods and this [s]; `key_within` and `release_within` of all `keys` meet them."""
VIEWERS: Final = (0, 1, 10)
ENDINGS: Final = ("blur", "closed", "killed", "frozen")


def bench(cell: Cell, quick: bool) -> Figures:
    """Measure; figures say why where there is no browser."""
    why = missing()
    if why:
        return {"skipped": why}
    from playwright.sync_api import sync_playwright

    keys, seconds = (QUICK_KEYS, QUICK_SECONDS) if quick else (KEYS, SECONDS)
    period_s = cell.config.timing.period_s
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        still = without_self_motion(cell, Path(folder))
        flags = [*BROWSER_FLAGS]
        browser = playwright.chromium.launch(executable_path=chromium(), args=flags)
        try:
            with _site(still) as site:
                opened = OpenPage(browser, site.address)
                opened.until(lambda: opened.mode() in ("ready", "hold"), "no page to steer by")
                ready_s = time.monotonic() - site.started_s
                figures = _keys(site, opened, keys, period_s)
                cpu = _cpu(site, opened, seconds)
                opened.close()
                endings = [_endings(site, browser, ending) for ending in ENDINGS]
                viewers = {n: _viewers(site, browser, n, seconds, period_s) for n in VIEWERS}
        finally:
            browser.close()
    none = viewers[0]["period_error_us"]["p99"]
    for each in viewers.values():
        each["ratio_p99"] = (
            round(each["period_error_us"]["p99"] / none, 2) if none else float("nan")
        )
    return {
        "load_1min": round(os.getloadavg()[0], 1),
        "start_to_steer_s": round(ready_s, 2),
        **figures,
        **{name: value for figures in endings for name, value in figures.items()},
        **cpu,
        **{f"viewers_{n}": figures for n, figures in viewers.items()},
    }


class _Site:
    """A plant with a console; who listens on its bus, and to the rig's truth."""

    def __init__(self, plant: LocalPlant, bus: CanBus, session: Session) -> None:
        self.plant, self.bus = plant, bus
        self.targets = Targets(plant.cell, bus)
        self.started_s, self.address = 0.0, ""
        self._truths = session.subscribe(t.RIG_TRUTH, 1)
        self._states = session.subscribe(t.STATE, 1)

    def speed(self) -> float | None:
        """Return how fast the arm moves, in truth, if that is told anew [rad/s]."""
        truth = newest(self._truths, RigTruth, t.RIG_TRUTH.max_bytes)
        return None if truth is None else max(abs(rate) for rate in truth.dq)

    def now(self) -> float:
        """Return how fast the arm moves [rad/s]."""
        speed = None
        while speed is None:
            speed = self.speed()
        return speed

    def reaches(self, done: Callable[[float], bool]) -> float:
        """Return the wall time at which the arm's speed is what it should be; NaN if never [s]."""
        since_s = time.time()
        while time.time() - since_s < GIVE_UP_S:
            speed = self.speed()
            if speed is not None and done(speed):
                return time.time()
            time.sleep(0.0005)
        return float("nan")

    def stops(self, held: float) -> list[float]:
        """Return the wall times at which the arm is slower than it was held at, at rest, settled.

        In seconds, of joints that went at `held` [rad/s].
        """
        return [self.reaches(partial(operator.gt, left * held)) for left in LEFT.values()]

    def overruns(self) -> int:
        """Return the daemon's overruns so far."""
        state = None
        while state is None:
            state = newest(self._states, State, t.STATE.max_bytes)
        return state.overruns


@contextmanager
def _site(cell: Cell) -> Iterator[_Site]:
    started_s, port = time.monotonic(), free_port(socket.SOCK_STREAM)
    with LocalPlant(cell) as plant:
        plant.start_console(
            [f"--listen=127.0.0.1:{port}"],
            {"TELEROBOT_CONSOLE_KEYS": f"{SECRET},{SECRET}"},
        )
        plant.wait(plant.answers, START_S, "the daemon did not answer")
        plant.wait(lambda: listens(port), START_S, "the console did not answer")
        bus = open_bus(plant.cell.config.fieldbuses[0])
        session = Session(plant.cell.config.name, plant.cell.config.zenoh.dialled)
        try:
            site = _Site(plant, bus, session)
            site.started_s, site.address = started_s, f"http://127.0.0.1:{port}/?key={SECRET}"
            yield site
        finally:
            session.close()
            bus.shutdown()


def _keys(site: _Site, opened: OpenPage, keys: int, period_s: float) -> Figures:
    """Press and let go of a key, again and again."""
    pressed, released, missed = [], [], 0
    draw = np.random.default_rng(1)
    opened.enable()
    opened.switch_off("force")
    for i in range(keys):
        if opened.mode() != "enabled":
            opened.enable()
        site.targets.until_still(STILL_S, lambda: None)
        time.sleep(float(draw.uniform(0.0, period_s)))
        site.targets.forget()
        key = "ad"[i % 2]
        opened.page.keyboard.down(key)
        changed_s = site.targets.changed_at(GIVE_UP_S)
        time.sleep(HELD_S)
        held = site.now()
        opened.page.keyboard.up(key)
        stops_s = np.array(site.stops(held))
        if changed_s is None or np.isnan(stops_s).any():
            missed += 1
            continue
        pressed.append(changed_s - opened.noted("keydown"))
        released.append(stops_s - opened.noted("keyup"))
    press_s, stops_s = np.array(pressed), np.array(released).reshape(-1, len(LEFT))
    press, stops = percentiles(1e3 * press_s), _told("release", stops_s)
    press_target_s, stop_target_s = 2 * period_s + PRESS_S, 2 * period_s + STOP_S
    return {
        "keys": keys,
        "missed": missed,
        "key_to_frame_ms": press,
        "key_target_ms": 1e3 * press_target_s,
        "key_within": int((press_s < press_target_s).sum()),
        **stops,
        "release_target_ms": 1e3 * stop_target_s,
        "release_within": int((stops_s[:, AT_REST] < stop_target_s).sum()),
    }


def _endings(site: _Site, browser: Any, ending: str) -> Figures:
    """Return the times from a page's end, as it was brought about; NaN where one was missed."""
    return _told(ending, np.array([_ending(site, browser, ending) for _ in range(TRIES)]))


def _told(what: str, stops_s: Array) -> Figures:
    """Return the figures of times (k, 3) [s] from what ended a motion to each part of its stop."""
    names = [f"{what}_to_{left}_ms" for left in LEFT]
    return {name: percentiles(1e3 * s) for name, s in zip(names, stops_s.T, strict=True)}


def _ending(site: _Site, browser: Any, ending: str) -> Array:
    """Return the times (3,) from one end of a page to each part of the stop [s]; NaN if missed."""
    opened = OpenPage(browser, site.address)
    opened.enable()
    focus = opened.context.new_cdp_session(opened.page)
    focus.send("Emulation.setFocusEmulationEnabled", {"enabled": False})
    opened.page.bring_to_front()
    other = opened.context.new_page() if ending == "blur" else None
    opened.page.bring_to_front()
    opened.page.keyboard.down("d")
    site.reaches(lambda speed: speed > MOVING)
    time.sleep(HELD_S)
    held = site.now()
    frozen = renderers() if ending == "frozen" else []
    killed = renderers() if ending == "killed" else []
    begun_s = time.time()
    if other is not None:
        other.bring_to_front()
    elif ending == "closed":
        opened.page.close()
    for pid in frozen:
        os.kill(pid, signal.SIGSTOP)
    for pid in killed:
        os.kill(pid, signal.SIGKILL)
    try:
        stops_s = np.array(site.stops(held))
    finally:
        for pid in frozen:
            os.kill(pid, signal.SIGCONT)
    if other is not None:
        begun_s = opened.noted("blur")
    opened.close()
    return stops_s - begun_s


def _cpu(site: _Site, opened: OpenPage, seconds: float) -> Figures:
    """Return what console and page take of a core while a key is held, at 60 states a second."""
    assert site.plant.console is not None, "the console was started"
    console, pages = [site.plant.console.pid], renderers()
    opened.page.keyboard.down("a")
    before = cpu_s(console), cpu_s(pages)
    time.sleep(seconds)
    after = cpu_s(console), cpu_s(pages)
    opened.page.keyboard.up("a")
    shares = [100.0 * (b - a) / seconds for a, b in zip(before, after, strict=True)]
    return {"console_cpu_percent": round(shares[0], 1), "page_cpu_percent": round(shares[1], 1)}


def _viewers(site: _Site, browser: Any, count: int, seconds: float, period_s: float) -> Figures:
    """Return SYNC's jitter and the daemon's overruns with so many viewers."""
    opened = OpenPage(browser, site.address) if count else None
    if opened is not None:
        opened.watched(count - 1)
        opened.until(lambda: _pages(opened) == count, "not all viewers are there")
    for _ in frames(site.bus):
        continue  # what came before
    overruns, since_s = site.overruns(), time.monotonic()
    stamps: list[float] = []
    while time.monotonic() - since_s < seconds:
        stamps += [f.timestamp for f in frames(site.bus) if f.arbitration_id == SYNC_ID]
        time.sleep(0.01)
    found = {
        "period_error_us": percentiles(1e6 * np.abs(np.diff(np.array(stamps)) - period_s)),
        "overruns": site.overruns() - overruns,
    }
    if opened is not None:
        opened.close()
    return found


def _pages(opened: OpenPage) -> int:
    """Return how many pages the console counts."""
    return int(opened.page.evaluate("Number(document.querySelector('#bar .pages').textContent)"))
