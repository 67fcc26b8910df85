"""Sleeps to absolute deadlines, and prints each period's error [µs].

Run as `python -m telerobot.tools.bench.bare PERIOD_S SECONDS`, with SCHED_FIFO where granted:
the least that any loop in Python can be late on this machine.
"""

import gc
import itertools
import sys

from ..host.machine import realtime, wakeups


def periods(period_s: float, seconds: float) -> list[float]:
    """Sleep to absolute deadlines for a while; return how wrong each period was [s]."""
    return [abs(b - a) for a, b in itertools.pairwise(wakeups(seconds, period_s))]


def main() -> int:
    period_s, seconds = float(sys.argv[1]), float(sys.argv[2])
    gc.disable()
    with realtime():
        errors = periods(period_s, seconds)
    print("\n".join(f"{1e6 * error:.3f}" for error in errors))
    return 0


if __name__ == "__main__":
    sys.exit(main())
