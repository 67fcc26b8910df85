"""The whole page at work: rig, daemon, console and Chromium as processes, driven by its controls.

What is shown is what an operator would see, latency included. Chromium's drawing process stands
back behind all others: without a graphics processor it would take the cores that they need, and a
latency would be shown that no machine with one has.
"""

import os
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from laboratory.bench.page.browser import OpenPage, children
from telerobot.config.load import Cell
from telerobot.tools.host.local_plant import ChildDied, LocalPlant, listens
from telerobot.tools.host.machine import free_port

SIZE: Final = {"width": 1280, "height": 720}
KEYS: Final = "TELEROBOT_CONSOLE_KEYS"
SECRET: Final = "only-for-pictures"
START_S: Final = 180.0
SETTLED_S: Final = 6.0
"""From the last act to the picture: plots fill [s]."""
TRIES: Final = 5
"""A page on a busy machine may hang for so long that it loses the lease."""
NICEST: Final = 19


def take_whole(browser: Any, cell: Cell, picture: Path) -> None:
    """Write the picture of a cell's page while the arm presses and goes to a target.

    Raises `ChildDied` where the page did not keep the lease.
    """
    port = free_port(socket.SOCK_STREAM)
    with LocalPlant(cell) as plant:
        plant.start_console([f"--listen=127.0.0.1:{port}"], {KEYS: f"{SECRET},{SECRET}-to-watch"})
        plant.wait(plant.answers, START_S, "the daemon did not answer")
        plant.wait(lambda: listens(port), START_S, "the console did not answer")
        opened = OpenPage(
            browser,
            f"http://127.0.0.1:{port}/?key={SECRET}",
            viewport=SIZE,
            color_scheme="dark",
        )
        try:
            for pid in children("--type=gpu-process"):
                os.setpriority(os.PRIO_PROCESS, pid, NICEST)
            for _ in range(TRIES):
                _drive(opened)
                opened.page.screenshot(path=str(picture), timeout=1e3 * START_S)
                if opened.mode() == "enabled":
                    return
            raise ChildDied("the page lost the lease each time: this picture shows it at rest")
        finally:
            opened.close()


def _drive(opened: OpenPage) -> None:
    page = opened.page
    page.keyboard.up("w")
    page.evaluate("document.getElementById('tab-steer').click()")
    opened.enable()
    _press(page, "ready")
    page.wait_for_timeout(500)
    opened.until(lambda: _stands(page), "the arm does not come to rest")
    _press(page, "Move")
    _drag(page, (46, -4))
    page.evaluate("document.getElementById('tab-now').click()")
    page.keyboard.down("w")
    page.wait_for_timeout(1e3 * SETTLED_S)


def _press(page: Any, name: str) -> None:
    page.get_by_role("button", name=name, exact=True).first.evaluate("(each) => each.click()")


def _drag(page: Any, way: tuple[float, float]) -> None:
    """Drag the handle by so much, and let go of it [px]."""
    x, y = page.evaluate("document.getElementById('scene').handleOnScreen()")
    box = page.locator("#scene").bounding_box()
    page.mouse.move(box["x"] + x, box["y"] + y)
    page.mouse.down()
    page.mouse.move(box["x"] + x + way[0], box["y"] + y + way[1], steps=4)
    page.mouse.up()


def _stands(page: Any) -> bool:
    """Return whether the handle stays where it is for a while."""
    return _stays(lambda: page.evaluate("document.getElementById('scene').handleOnScreen()"))


def _stays(where: Callable[[], list[float]]) -> bool:
    before = where()
    time.sleep(1.0)
    return max(abs(a - b) for a, b in zip(before, where(), strict=True)) < 0.2
