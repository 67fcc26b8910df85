"""A daemon's period of this revision and another one, period by period in turn on one core.

Minutes apart, the same period may take a quarter more on a machine that others use. A hundredth of
a second apart both meet the same machine: a ratio repeats to 3 % after a minute.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from statistics import mean, median
from typing import Final

from telerobot.drivers.device import DeviceError
from telerobot.tools.bench.figures import Figures, machine

from .against import HERE, checked_out

CELL: Final = "pa10"
ROUNDS: Final = 4
"""Times that both are measured; who goes first changes every round [1]."""
PERIODS: Final = 500
"""Of each in a round [1]."""
QUICK: Final = 100
"""Of each in the only round of a quick run [1]."""
TURN_S: Final = 0.015
"""From one's period to the other's [s]: the caches are cold, and the first one's rig is done."""
BEGIN_S: Final = 0.2
"""From the last one's being ready to the first period [s]."""

Spent = dict[str, list[float]]
"""Processor time of each period [µs], by the name of the tree."""


def in_turn(revision: str, quick: bool) -> Figures:
    """Measure both, print each round, and return all. Raises `DeviceError` as `compare` does."""
    told = machine()
    print(f"load {told['load_1min']} on {told['cores']} cores: {told['processor']}")
    with checked_out(HERE, revision) as before:
        measured({"before": before}, QUICK)  # compiles what is called
        rounds = []
        for i in range(1 if quick else ROUNDS):
            order = [("before", before), ("now", HERE)][:: -1 if i % 2 else 1]
            rounds.append(figures(measured(dict(order), QUICK if quick else PERIODS)))
            print(
                "   ".join(f"{name} {value:.4g}" for name, value in rounds[-1].items()), flush=True
            )
    ratios = {name: median(each[name] for each in rounds) for name in ("ratio_p50", "ratio_mean")}
    print("median of rounds: " + "   ".join(f"{name} {r:.3f}" for name, r in ratios.items()))
    return {"before": revision, "machine": told, "rounds": rounds, **ratios}


def figures(spent: Spent) -> dict[str, float]:
    """Return medians and means of both [µs], and the ratios of now to before [1]."""
    found = {
        f"{name}_{kind}_us": of(spent[name])
        for name in ("before", "now")
        for kind, of in (("p50", median), ("mean", mean))
    }
    for kind in ("p50", "mean"):
        found[f"ratio_{kind}"] = found[f"now_{kind}_us"] / found[f"before_{kind}_us"]
    return found


def measured(trees: Mapping[str, Path], periods: int, cell: str = CELL) -> Spent:
    """Return what periods of each tree took, in turn on the last core that there is.

    Raises `DeviceError` for a tree that cannot be measured.
    """
    core, script = max(os.sched_getaffinity(0)), Path(__file__).with_name("one_period.py")
    with ExitStack() as ending:
        processes = {}
        for name, tree in trees.items():
            command = [sys.executable, "-P", str(script), cell, str(periods), str(core)]
            process = subprocess.Popen(
                command, cwd=tree, env={**os.environ, "PYTHONPATH": str(tree / ".namespace")},
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
            processes[name] = ending.enter_context(process)
            ending.callback(process.kill)
        for name, process in processes.items():
            if _line(process) != "ready":
                raise DeviceError(f"{name}: {_last_words(process)}")
        begin_s = time.monotonic() + BEGIN_S
        for i, process in enumerate(processes.values()):
            _tell(process, f"{begin_s + i * TURN_S} {len(processes) * TURN_S}")
        found: Spent = {}
        for name, process in processes.items():
            told = _line(process)
            if not told:
                raise DeviceError(f"{name}: {_last_words(process)}")
            found[name] = json.loads(told)
    return found


def _line(process: "subprocess.Popen[str]") -> str:
    return "" if process.stdout is None else process.stdout.readline().strip()


def _tell(process: "subprocess.Popen[str]", words: str) -> None:
    if process.stdin is not None:
        process.stdin.write(words + "\n")
        process.stdin.flush()


def _last_words(process: "subprocess.Popen[str]") -> str:
    told = "" if process.stderr is None else process.stderr.read()
    lines: Sequence[str] = told.strip().splitlines() or ["it ended without a word"]
    return lines[-1]
