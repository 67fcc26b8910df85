"""Whether the daemon holds its period: a short one, on little of a core, and with more arms in it.

Daemon and rig are real processes, the first arm moves under a streamed stick. The daemon has one
core for itself, all others the rest. A core is slowed by a hog: a process that goes before the
daemon (SCHED_FIFO) and takes the same part of every millisecond.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from telerobot.config.load import Cell
from telerobot.server.process import PRIORITY
from telerobot.tools.bench import sync
from telerobot.tools.bench.figures import PERCENTILES, Figures
from telerobot.tools.bench.latency import EnabledPlant, driven
from telerobot.tools.client.operator import OperatorError

from .load import at_period, several

LEFT: Final = 0.25
"""Part of a core that is left to the daemon where it is slowed [1]."""
ARMS: Final = (1, 2, 4, 8)
SHORT_S: Final = 1e-3
"""A period in which a bus carries what three drives say and hear, and hardly more [s]."""
SLICE_S: Final = 1e-3
"""The hog takes its part of each [s]."""


def bench(cell: Cell, quick: bool) -> Figures:
    """Measure a slowed core, then arms in a row, each on a bus of its own."""
    seconds = sync.QUICK_SECONDS if quick else sync.SECONDS
    found: Figures = {f"slowed_to_{LEFT:g}": _held(cell, seconds, LEFT)}
    with tempfile.TemporaryDirectory() as folder:
        for count in ARMS:
            found[f"arms_{count}"] = _held(several(cell, count, Path(folder)), seconds)
    return found


def short(cell: Cell, quick: bool) -> Figures:
    """Measure SYNC of a cell at `SHORT_S`, beside a bare loop of that period."""
    with tempfile.TemporaryDirectory() as folder:
        cell = at_period(cell, SHORT_S, Path(folder))
        return sync.bench(cell, sync.QUICK_SECONDS if quick else sync.SECONDS)


def _held(cell: Cell, seconds: float, left: float = 1.0) -> Figures:
    """Measure for some seconds, with a part `left` (0 to 1) of a core; errors are told, too."""
    with tempfile.TemporaryDirectory() as folder:
        statistics = Path(folder) / "daemon.json"
        try:
            with driven(cell, statistics) as plant, _hogged(_apart(plant), 1.0 - left):
                sync.moving(plant, sync.SETTLE_S)
                _, figures = sync.moving(plant, seconds)
        except OperatorError as error:
            return {"error": " ".join(str(error).split())}
        told = json.loads(statistics.read_text())
    return {**figures, **{f"control_us_{name}": told[f"compute_us_{name}"] for name in PERCENTILES}}


def _apart(plant: EnabledPlant) -> int:
    """Put the daemon on a core, and everybody else on the others; return that core."""
    core, *others = sorted(os.sched_getaffinity(0))
    local = plant.local
    for process, cores in ((local.daemon, {core}), (local.rig, {*others} or {core})):
        if process is not None:
            for thread in Path(f"/proc/{process.pid}/task").iterdir():
                os.sched_setaffinity(int(thread.name), cores)
    return core


@contextmanager
def _hogged(core: int, share: float) -> Iterator[None]:
    """Take a share (0 to 1) of a core from whoever else is on it."""
    if share <= 0.0:
        yield
        return
    command = [sys.executable, "-m", __name__, str(core), str(share)]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as hog:
        try:
            yield
        finally:
            hog.kill()


def _hog(core: int, share: float) -> None:
    os.sched_setaffinity(0, {core})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY + 1))
    deadline_s = time.monotonic()
    while os.getppid() != 1:
        while time.monotonic() < deadline_s + share * SLICE_S:
            pass
        deadline_s += SLICE_S
        time.sleep(max(0.0, deadline_s - time.monotonic()))


if __name__ == "__main__":
    _hog(int(sys.argv[1]), float(sys.argv[2]))
