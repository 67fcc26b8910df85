"""Sleeps to absolute deadlines, and prints each period's error [µs].

Run as `python -m telerobot.tools.bench.bare PERIOD_S SECONDS`, with SCHED_FIFO where granted:
the least that any loop in Python can be late on this machine.
"""

import ctypes
import gc
import itertools
import sys
import time

from ..host.machine import realtime

_CLOCK_MONOTONIC = 1
_TIMER_ABSTIME = 1


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


def periods(period_s: float, seconds: float) -> list[float]:
    """Sleep to absolute deadlines for a while; return how wrong each period was [s]."""
    libc = ctypes.CDLL(None)
    period_ns = round(1e9 * period_s)
    deadline = time.monotonic_ns() + period_ns
    woke: list[int] = []
    for _ in range(round(seconds / period_s)):
        until = _Timespec(*divmod(deadline, 1_000_000_000))
        libc.clock_nanosleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, ctypes.byref(until), None)
        woke.append(time.monotonic_ns())
        deadline += period_ns
    return [1e-9 * abs(b - a - period_ns) for a, b in itertools.pairwise(woke)]


def main() -> int:
    period_s, seconds = float(sys.argv[1]), float(sys.argv[2])
    gc.disable()
    with realtime():
        errors = periods(period_s, seconds)
    print("\n".join(f"{1e6 * error:.3f}" for error in errors))
    return 0


if __name__ == "__main__":
    sys.exit(main())
