"""A page in a headless Chromium, with the clock of its events."""

import importlib.util
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from telerobot.tools.host.local_plant import ChildDied

NEXT: Final = ".actions button.next:not([hidden])"
PATIENCE_S: Final = 120.0
FLAGS: Final = ("--no-sandbox", "--disable-3d-apis", "--disable-gpu")
"""Without its scene: drawn by the processor alone, that would be measured and nothing else."""

VIEWPORT: Final = {"width": 960, "height": 620}

NOTE: Final = """
window.noted = {};
for (const [target, name] of [[window, "keydown"], [window, "keyup"], [window, "blur"]]) {
  target.addEventListener(name, (event) => {
    window.noted[name] = (performance.timeOrigin + event.timeStamp) / 1000;
  }, { capture: true });
}
"""
TICKS: Final = os.sysconf("SC_CLK_TCK")


def missing() -> str:
    """Return why there is no browser to measure with; empty where there is one."""
    if importlib.util.find_spec("playwright") is None:
        return "playwright is not installed: pip install playwright"
    if chromium() is None:
        return "no chromium here: apt-get install chromium"
    from laboratory.vendor.fetch import missing as not_fetched

    return "the page's JavaScript is not fetched: make venv" if not_fetched() else ""


def chromium() -> str | None:
    """Return the browser's path, None where there is none."""
    return shutil.which("chromium") or shutil.which("chromium-browser")


class OpenPage:
    """A page that is open on a console."""

    def __init__(self, browser: Any, address: str, **context: Any) -> None:
        self.context = browser.new_context(**{"viewport": VIEWPORT, **context})
        self.page = self.context.new_page()
        self.page.add_init_script(NOTE)
        self.page.goto(address)
        self.page.wait_for_selector("body[data-ready]", state="attached", timeout=1e3 * PATIENCE_S)

    def mode(self) -> str:
        """Return the mode that the page shows."""
        return str(self.page.text_content(".mode")).lower()

    def until(self, done: Callable[[], bool], otherwise: str) -> None:
        """Wait until something holds. Raises `ChildDied` with `otherwise` when time is up."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not done():
            if time.monotonic() > deadline_s:
                raise ChildDied(f"{otherwise}; the page shows {self.mode()}")
            time.sleep(0.01)

    def enable(self) -> None:
        """Press what the page offers next, until the arm is enabled by it."""

        def enabled() -> bool:
            self.page.evaluate(f"document.querySelector('{NEXT}')?.click()")
            self.page.wait_for_timeout(300)
            mine = "(you)" in str(self.page.text_content("#bar"))
            return mine and self.mode() == "enabled"

        self.until(enabled, "the arm is not enabled")

    def switch_off(self, source: str) -> None:
        """Switch a source off at its own control."""
        box = f"document.getElementById('on-{source}')"
        self.page.evaluate("document.getElementById('tab-set').click()")
        self.until(lambda: bool(self.page.evaluate(f"{box}.checked")), f"{source} is off")
        self.page.evaluate(f"{box}.click()")
        self.page.wait_for_timeout(500)
        self.until(lambda: not self.page.evaluate(f"{box}.checked"), f"{source} stays on")

    def noted(self, event: str) -> float:
        """Return when the browser last saw an event, on the wall clock [s]."""
        return float(self.page.evaluate(f"window.noted[{event!r}] ?? NaN"))

    def watched(self, viewers: int) -> None:
        """Let so many more viewers be told everything, by sockets of this page."""
        self.page.evaluate(
            "(n) => { window.viewers = [...Array(n).keys()].map((i) =>"
            " new WebSocket(`ws://${location.host}/ws?name=viewer${i}`)); }",
            viewers,
        )

    def close(self) -> None:
        """Close it, and with it its lease."""
        self.context.close()


def renderers() -> list[int]:
    """Return the ids of the processes that run pages of our own browser."""
    return children("--type=renderer")


def children(argument: str) -> list[int]:
    """Return the ids of our own processes, and of theirs, that were started with an argument."""
    parents: dict[int, int] = {}
    found: list[int] = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            parents[int(path.name)] = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            if argument in (path / "cmdline").read_text():
                found.append(int(path.name))
        except OSError:
            continue  # it has ended meanwhile

    def ours(pid: int) -> bool:
        return pid == os.getpid() or (pid in parents and ours(parents[pid]))

    return [pid for pid in found if ours(pid)]


def cpu_s(pids: list[int]) -> float:
    """Return the processor time that processes have taken so far [s]."""
    total = 0
    for pid in pids:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        total += int(fields[11]) + int(fields[12])
    return total / TICKS
