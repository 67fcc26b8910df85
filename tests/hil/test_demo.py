"""`telerobot demo` without a terminal."""

import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.hil

DEMO = [sys.executable, "-m", "telerobot.tools.cli", "demo"]


def start(*arguments):
    return subprocess.Popen(
        [*DEMO, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def children_of(process):
    pids = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return {int(pid) for pid in pids}


def test_two_demos_run_side_by_side_and_show_a_healthy_arm():
    demos = [start(cell, "--json", "--seconds", "4") for cell in ("pa10", "ur5e")]
    for demo, cell in zip(demos, ("pa10", "ur5e"), strict=True):
        out, err = demo.communicate(timeout=120)
        assert demo.returncode == 0, err
        summary = json.loads(out)
        assert summary["cell"] == cell
        assert summary["healthy"]
        assert summary["errors"] == []
        assert summary["ticks"] > 300
        assert summary["lateness_us_p50"] > 0
        assert 0 < summary["worst_following_error_rad"] < 0.05


@pytest.mark.smoke
def test_without_a_terminal_the_demo_says_that_it_plays_a_script():
    demo = start("pa10", "--seconds", "2")
    out, err = demo.communicate(timeout=120)
    assert demo.returncode == 0, err
    assert "no terminal: the demo plays a script" in err
    assert "final mode" in out


@pytest.mark.parametrize("ending", ["its rig dies", "the demo is killed"])
def test_no_process_is_left_behind(ending):
    demo = start("pa10", "--headless", "--seconds", "60")
    while "enabled" not in demo.stderr.readline():
        assert demo.poll() is None
    children = children_of(demo)
    assert len(children) == 2
    watched = [os.pidfd_open(pid) for pid in children]
    if ending == "its rig dies":
        os.kill(min(children), signal.SIGKILL)
    else:
        demo.kill()
    _, err = demo.communicate(timeout=60)
    if ending == "its rig dies":
        assert demo.returncode == 1
        assert err.splitlines()[-1] == "telerobot: the rig ended with code -9"
    for ended in watched:
        assert select.select([ended], [], [], 30)[0], "rig or daemon outlived the demo"
        os.close(ended)


class Terminal:
    """A demo in a terminal of its own: what it wrote, and keys."""

    def __init__(self, *arguments):
        self._fd, end = pty.openpty()
        environment = {**os.environ, "DISPLAY": "", "WAYLAND_DISPLAY": ""}
        self.process = subprocess.Popen(
            [*DEMO, *arguments], stdin=end, stdout=end, stderr=end, env=environment
        )
        os.close(end)
        self.text = ""

    def read_until(self, words, within_s=120):
        self.until(lambda: words in self.text, words, within_s)

    def until(self, done, words, within_s=120):
        deadline_s = time.monotonic() + within_s
        while not done():
            ready, _, _ = select.select([self._fd], [], [], within_s)
            assert ready, f"nothing more, and no {words!r} in:\n{self.text[-3000:]}"
            assert time.monotonic() < deadline_s, f"no {words!r} in:\n{self.text[-3000:]}"
            self.text += os.read(self._fd, 4096).decode(errors="replace")

    def forget(self):
        self.text = ""

    def press(self, keys):
        os.write(self._fd, keys.encode())

    def close(self):
        self.process.terminate()
        while True:  # a terminal that nobody reads holds up who writes
            try:
                if not os.read(self._fd, 4096):
                    break
            except OSError:
                break
        os.close(self._fd)
        return self.process.wait()


def commands_of(process):
    paths = {pid: Path(f"/proc/{pid}/cmdline") for pid in children_of(process)}
    words = {pid: path.read_text().split("\0") for pid, path in paths.items()}
    return {said[said.index("telerobot.tools.cli") + 1]: pid for pid, said in words.items()}


def test_what_is_killed_is_told_and_started_again_and_the_keys_go_on():
    demo = Terminal("pa10", "--no-page")
    try:
        demo.read_until("pa10 listens at tcp/127.0.0.1:")
        demo.read_until("lease granted")
        demo.forget()
        os.kill(commands_of(demo.process)["serve"], signal.SIGKILL)
        demo.read_until("the daemon ended with code -9: it is started again")
        demo.read_until("no telemetry for")
        demo.forget()
        demo.read_until("lease free")  # told by the new daemon
        demo.press("L")
        demo.read_until("lease granted")
    finally:
        demo.close()


def test_the_keys_lead_a_beam_that_two_arms_hold():
    # A mode follows what clears the screen, whose last letter is no part of it.
    shown = re.compile(r"(?:\x1b\[J|(?<![A-Z[]))([A-Z]+) \| beam \| xyz \S+ \S+ ([+-][\d.]+) m")
    demo = Terminal("pa10_pair", "--no-page")

    def higher_than(place):
        mode, z = shown.findall(demo.text)[-1]
        if float(z) > place + 0.01:
            return True
        demo.press("r" if mode == "ENABLED" else "m")  # ticks that come late end in HOLD
        return False

    try:
        demo.read_until("lease granted")
        demo.press("m")
        demo.until(lambda: shown.search(demo.text), "beam")
        before = float(shown.findall(demo.text)[-1][1])
        demo.until(lambda: higher_than(before), "a beam that rises")
        demo.forget()
        demo.press("x")
        demo.read_until("PROTECTIVE STOP")
        demo.until(lambda: [m for m, _ in shown.findall(demo.text)[-1:]] == ["HOLD"], "HOLD")
    finally:
        demo.close()
