"""`telerobot demo` without a terminal."""

import json
import os
import select
import signal
import subprocess
import sys
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
