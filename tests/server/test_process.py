"""What the loop asks of the machine is held while it runs, and told where it is refused."""

import struct
import subprocess
import sys

import pytest
from telerobot.server import process


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """The file that bounds how deeply processors sleep, on a machine where they do."""
    found, sleeping = tmp_path / "cpu_dma_latency", tmp_path / "current_driver"
    sleeping.write_text("intel_idle\n")
    monkeypatch.setattr(process, "LATENCY", found)
    monkeypatch.setattr(process, "_SLEEPING", sleeping)
    yield found
    process.let_sleep()


def test_processors_are_kept_awake_until_they_may_sleep(asked):
    assert process.stay_awake() == ""
    assert struct.unpack("=i", asked.read_bytes()) == (process.WAKE_US,)
    (held,) = process._awake
    assert not held.closed  # the kernel forgets it as the file is closed
    process.let_sleep()
    assert held.closed


def test_a_refusal_is_told_in_words(asked):
    asked.mkdir()
    assert process.stay_awake() == "Is a directory"
    assert process._awake == []


def test_a_machine_whose_processors_do_not_sleep_is_asked_for_nothing(asked, monkeypatch):
    monkeypatch.setattr(process, "_SLEEPING", asked)
    assert process.stay_awake() == ""
    assert not asked.exists()


def test_other_threads_give_the_interpreters_lock_back_soon_while_the_loop_runs():
    """In a process of its own: it takes real time and locks memory, where it is granted."""
    code = (
        "from sys import getswitchinterval as f\n"
        "from telerobot.server.process import prepare, release\n"
        "before = f(); prepare(); during = f(); release(); print(before, during, f())"
    )
    told = subprocess.check_output([sys.executable, "-c", code], text=True)
    before, during, after = map(float, told.split())
    assert during == pytest.approx(process.LOCKED_S)
    assert during < before == after
