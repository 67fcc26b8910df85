"""What the loop asks of the machine: time, real-time settings, words to the service manager."""

import contextlib
import ctypes
import gc
import os
import re
import socket
import struct
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO, Protocol

# --- Time for the loop: the monotonic clock, or a virtual one that a simulation sets --------------


class Clock(Protocol):
    """Seconds on a clock that never goes back."""

    def now(self) -> float:
        """Return the time [s]."""
        ...

    def wall_ns(self) -> int:
        """Return the time of day [ns since 1970]: for stamps of records, and nothing else."""
        ...


class MonotonicClock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic()

    def wall_ns(self) -> int:
        """Return the time of day [ns since 1970]."""
        return time.time_ns()

    def sleep_until(self, deadline_s: float) -> None:
        """Sleep until an absolute time [s]; return at once when it has passed."""
        left = deadline_s - time.monotonic()
        if left > 0:
            time.sleep(left)


class VirtualClock:
    """A clock that stands until it is set."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def now(self) -> float:
        """Return the time [s]."""
        return self.time_s

    def wall_ns(self) -> int:
        """Return the virtual time [ns]."""
        return round(self.time_s * 1e9)


# --- Real-time settings of the operating system for the loop, as far as they are granted ----------

PRIORITY = 60
"""SCHED_FIFO priority: above ordinary threads, below the kernel's own."""

LOCKED_S = 1e-3
"""Python's own 5 ms make a tick half a period late; less lets others interrupt each tick [s]."""
_PYTHONS_S = sys.getswitchinterval()

_MCL_CURRENT_AND_FUTURE = 3

WAKE_US = 10
"""Processors may sleep so deeply that they wake up within this [µs]: in C1, not in C6, whose
100 to 200 µs come on top of every wake-up of the loop."""
LATENCY = Path("/dev/cpu_dma_latency")
"""Bounds that for all processors, while the file is open (Linux, power/pm_qos_interface)."""
_SLEEPING = Path("/sys/devices/system/cpu/cpuidle/current_driver")

HUGE = 2 << 20
"""Size of a huge page, where ordinary ones have 4 kB [B]."""
_MADV_COLLAPSE = 25
_PRIVATE = re.compile(
    r"^(\w+)-(\w+) rw-p \w+ 00:00 0 *(?:\[heap\])?\n(?:.+\n){3}Rss: +(\d+) kB$", re.MULTILINE
)
"""The process's own memory in /proc/self/smaps: from, to, and how much of it is used."""


def prepare() -> list[str]:
    """Ask for what a loop in real time needs; return a notice for each that was denied.

    That is real-time scheduling, locked memory and processors that wake up quickly.

    Garbage collection is off afterwards: the loop collects in its slack. Another thread of Python
    keeps the interpreter's lock for `LOCKED_S` at most once the loop asks for it.
    """
    notices = []
    sys.setswitchinterval(LOCKED_S)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except (PermissionError, OSError) as error:
        notices.append(
            f"no real-time scheduling ({error.strerror}): expect late ticks under load; "
            "grant CAP_SYS_NICE or an rtprio limit"
        )
    libc = ctypes.CDLL(None, use_errno=True)
    gc.disable()
    if libc.mlockall(_MCL_CURRENT_AND_FUTURE) != 0:
        notices.append(
            f"memory is not locked ({os.strerror(ctypes.get_errno())}): a page fault can delay a "
            "tick; grant CAP_IPC_LOCK or a memlock limit"
        )
    refusal = stay_awake()
    if refusal:
        notices.append(
            f"processors may sleep deeply ({refusal}): wake-ups can be late by 0.2 ms; let the "
            f"daemon's user write {LATENCY}"
        )
    return notices


def settle() -> None:
    """Keep all that lives now from the collector, and in huge pages as far as the kernel can.

    A period looks at hundreds of pages of Python's objects, and finds few of them in the TLB after
    a sleep. Linux collapses pages since 6.1 (madvise(2)); before that, they stay as they are. So
    do stacks and other memory that is set aside but hardly used.
    """
    gc.collect()
    gc.freeze()
    try:
        told = Path("/proc/self/smaps").read_text()
    except OSError:
        return
    libc = ctypes.CDLL(None)
    for begin, end, used_kB in _PRIVATE.findall(told):
        first, last = -(-int(begin, 16) // HUGE) * HUGE, int(end, 16) // HUGE * HUGE
        if first >= last or 2 * 1024 * int(used_kB) < int(end, 16) - int(begin, 16):
            continue
        # One call for all of them: each waits until every processor has let go of its pages.
        libc.madvise(ctypes.c_void_p(first), ctypes.c_size_t(last - first), _MADV_COLLAPSE)


_awake: list[BinaryIO] = []
"""The open file that keeps processors from deep sleep."""


def stay_awake() -> str:
    """Keep processors from sleeping deeply until `let_sleep`; return why not, or nothing."""
    if not _SLEEPING.exists():
        return ""  # a kernel that lets none sleep deeply
    try:
        held = LATENCY.open("wb", buffering=0)
        held.write(struct.pack("=i", WAKE_US))
    except OSError as error:
        return error.strerror or str(error)
    _awake.append(held)
    return ""


def let_sleep() -> None:
    """Let processors sleep as deeply as they like again."""
    while _awake:
        _awake.pop().close()


def release() -> None:
    """Give back what `prepare` took, before the process ends."""
    let_sleep()
    sys.setswitchinterval(_PYTHONS_S)
    gc.unfreeze()
    gc.enable()


# --- Words to the service manager that started the daemon: sd_notify, where there is one to hear


def notify(words: str, environment: Mapping[str, str] = os.environ) -> None:
    """Send `READY=1` and the like to systemd's socket; without one, do nothing."""
    address = environment.get("NOTIFY_SOCKET", "")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    with (
        contextlib.suppress(OSError),  # a manager that has gone is told nothing
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as heard,
    ):
        heard.sendto(words.encode(), address)
