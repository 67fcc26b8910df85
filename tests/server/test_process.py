"""What the loop asks of the machine is held while it runs, and told where it is refused."""

import ctypes
import gc
import mmap
import re
import struct
import subprocess
import sys
from pathlib import Path

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


def _huge_kB(at: int) -> int:
    """Return how much of the mapping around an address is in huge pages [kB]."""
    around = False
    for line in Path("/proc/self/smaps").read_text().splitlines():
        if found := re.match(r"(\w+)-(\w+) ", line):
            around = int(found[1], 16) <= at < int(found[2], 16)
        if around and line.startswith("AnonHugePages:"):
            return int(line.split()[1])
    raise AssertionError("no mapping there")


def _mapped() -> mmap.mmap:
    """Return memory for four huge pages at least three of which are whole."""
    return mmap.mmap(-1, 4 * process.HUGE, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)


@pytest.fixture
def collapsing():
    """Skip where the kernel itself collapses no pages, as before Linux 6.1: it is asked here.

    So it is where the kernel does it unasked: nobody could tell who did it.
    """
    rule = Path("/sys/kernel/mm/transparent_hugepage/enabled")
    if rule.exists() and "[always]" in rule.read_text():
        pytest.skip("this machine has pages huge of itself")
    with _mapped() as tried:
        tried[:] = bytes(4 * process.HUGE)
        try:
            tried.madvise(process._MADV_COLLAPSE)
        except OSError as error:
            pytest.skip(f"this kernel collapses no pages: {error.strerror}")


def test_memory_in_use_is_gathered_in_huge_pages_and_stays_what_it_is(collapsing):
    words = bytes(range(256)) * (4 * process.HUGE // 256)
    with _mapped() as used, _mapped() as spare:
        # Each with a mark of its own, so that it stays apart from its neighbours.
        used.madvise(mmap.MADV_DONTFORK)
        spare.madvise(mmap.MADV_DONTDUMP)
        used[:] = words
        for begin in range(0, len(spare), process.HUGE):
            spare[begin] = 1
        at, beside = (ctypes.addressof(ctypes.c_char.from_buffer(each)) for each in (used, spare))
        assert _huge_kB(at) == 0
        try:
            process.settle()
        finally:
            gc.unfreeze()
        assert _huge_kB(at) >= 3 * process.HUGE // 1024
        assert _huge_kB(beside) == 0, "what is hardly used stays as it is"
        assert used[:] == words
