"""What a daemon's part of each period takes of a processor, in a simulation that waits its turn.

`python -P one_period.py CELL PERIODS CORE`, by its path: so it measures any revision that is found
as `telerobot`, and uses of that only what has long been there. It says that it is ready, reads when
to begin and how far apart periods are [s] (CLOCK_MONOTONIC), and prints the time of each [µs].
"""

import gc
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

from telerobot.config.load import load_cell
from telerobot.server import process
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

SETTLE_S = 2.0
"""Of virtual time before the first period that counts: the arm is enabled, and moves [s]."""
TIDY_EVERY = 50
"""Periods from one look for garbage to the next, as in the daemon's loop [1]."""


def _stick(seconds: float) -> Script:
    """Return the script of a stick that leads the tool to and fro."""
    steps = []
    for i in range(round(seconds)):
        twist = [0.02 - 0.04 * (i % 2), 0.0, 0.01, 0.0, 0.0, 0.0]
        steps.append({"at_s": 0.1 + i, "cmd/joystick": {"twist": twist}, "for_s": 1.0})
    return Script.model_validate({"duration_s": seconds + 1.0, "step": steps})


class _Timed:
    """Adds up the processor time of a cycle's parts, which begin when it is their turn."""

    def __init__(self, cycle: Any) -> None:
        self.spent_ns = 0
        self.turn_s = 0.0
        gather = self._timed(cycle.gather)

        def in_turn() -> None:
            time.sleep(max(0.0, self.turn_s - time.monotonic()))
            gather()

        cycle.gather, cycle.begin, cycle.finish = (
            in_turn, self._timed(cycle.begin), self._timed(cycle.finish)
        )  # fmt: skip

    def _timed(self, part: Callable[[], None]) -> Callable[[], None]:
        def timed() -> None:
            begin = time.thread_time_ns()
            part()
            self.spent_ns += time.thread_time_ns() - begin

        return timed


def main() -> None:
    """Measure as the command line says."""
    cell, periods, core = load_cell(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    os.sched_setaffinity(0, {core})
    period_s = cell.config.timing.period_s
    simulation = Simulation(cell, _stick(SETTLE_S + periods * period_s))
    simulation.cycle.boot()
    simulation.cycle.warm_up()
    while simulation.clock.time_s < SETTLE_S:
        simulation.step()
    gc.collect()
    getattr(process, "settle", gc.freeze)()
    gc.disable()
    print("ready", flush=True)
    begin_s, apart_s = map(float, sys.stdin.readline().split())
    timed, found = _Timed(simulation.cycle), []
    for i in range(periods):
        timed.spent_ns, timed.turn_s = 0, begin_s + i * apart_s
        simulation.step()
        found.append(timed.spent_ns * 1e-3)
        if i % TIDY_EVERY == 0:
            gc.collect(0)
    mode = simulation.cycle.mode
    if mode != "enabled":
        sys.exit(f"the arm ended in mode {mode}")
    print(json.dumps(found))


if __name__ == "__main__":
    main()
