"""Figures of the benchmarks, and the machine that they were measured on."""

import os
import platform
import re
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..host.machine import versions

Figures = dict[str, Any]
"""Named figures: numbers, truth values, and tables of them; units in the names."""

PERCENTILES: Final = {"p50": 50.0, "p99": 99.0, "p99.9": 99.9, "max": 100.0}


def percentiles(values: NDArray[np.float64]) -> dict[str, float]:
    """Return the percentiles of values, in their unit; NaN where there are none."""
    if not len(values):
        return dict.fromkeys(PERCENTILES, float("nan"))
    return {name: round(float(np.percentile(values, p)), 1) for name, p in PERCENTILES.items()}


def cpu_s(pid: int) -> float:
    """Return the processor time that a process has taken so far, all of its threads [s]."""
    after_name = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return sum(int(ticks) for ticks in after_name[11:13]) / os.sysconf("SC_CLK_TCK")


def machine(*packages: str) -> Figures:
    """Return what the figures depend on: cores, processor, kernel, versions of packages."""
    named = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text(encoding="utf-8"))
    return {
        "cores": len(os.sched_getaffinity(0)),
        "processor": named[1] if named else platform.machine(),
        "load_1min": round(os.getloadavg()[0], 2),
        "kernel": platform.release(),
        "python": platform.python_version(),
        "openblas_num_threads": os.environ.get("OPENBLAS_NUM_THREADS"),
        "packages": {name: found or "missing" for name, found in versions(*packages).items()},
    }
