"""Jitter of SYNC on the bus, beside a bare loop of absolute sleeps on the same machine.

Daemon and rig run as processes, the arm is enabled and moves under a streamed stick. A passive
member of the bus takes the kernel's receive stamps. At the same time, a process that does nothing
else sleeps to absolute deadlines of the same period: what the machine itself grants. How long its
control computations took, the daemon tells when it ends; what processor time it and the rig take a
period, the kernel.
"""

import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from ...config.load import Cell
from ...protocols.canopen.can301 import SYNC_ID
from ..client.operator import OperatorError
from .figures import PERCENTILES, Figures, cpu_s, percentiles
from .latency import EnabledPlant, driven, frames

SECONDS = 60.0
QUICK_SECONDS = 10.0
SETTLE_S = 1.0
SWAY = (0.05, 4.0)  # the stick sways with this amplitude [m/s] and period [s]
STEP_S = 0.05


def bench(cell: Cell, seconds: float = SECONDS) -> Figures:
    """Measure for some seconds [s]."""
    with tempfile.TemporaryDirectory() as folder:
        statistics = Path(folder) / "daemon.json"
        found = _measured(cell, seconds, statistics)
        told = json.loads(statistics.read_text())
    return {**found, "control_us": {name: told[f"compute_us_{name}"] for name in PERCENTILES}}


def _measured(cell: Cell, seconds: float, statistics: Path) -> Figures:
    period_s = cell.config.timing.period_s
    with driven(cell, statistics) as plant:
        _sway(plant, SETTLE_S)
        for _ in frames(plant.bus):
            continue  # what came before the measurement
        command = [sys.executable, "-m", f"{__package__}.bare", str(period_s), str(seconds)]
        bare = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            stamps, held = moving(plant, seconds)
            output, _ = bare.communicate(timeout=seconds + 30.0)
        finally:
            if bare.poll() is None:
                bare.kill()
                bare.wait()
    gaps = np.diff(np.array(stamps))
    ours = percentiles(1e6 * np.abs(gaps - period_s))
    bare_us = percentiles(np.array([float(word) for word in output.split()]))
    return {
        "syncs": len(stamps),
        "period_error_us": ours,
        "bare_error_us": bare_us,
        **{f"ratio_{p}": round(ours[p] / (bare_us[p] or math.nan), 2) for p in ("p99", "p99.9")},
        **held,
    }


def moving(plant: EnabledPlant, seconds: float) -> tuple[list[float], Figures]:
    """Drive the arm to and fro; return the stamps of SYNC [s], and what it cost meanwhile.

    That is overruns, and what daemon and rig took of the processor a period [µs]. Raises
    `OperatorError` for an arm that is not enabled in the end: one that holds costs less.
    """
    children = {"daemon": plant.local.daemon, "rig": plant.local.rig}
    pids = {f"{name}_cpu_us": child.pid for name, child in children.items() if child}
    before = {name: cpu_s(pid) for name, pid in pids.items()}
    overruns = plant.operator.wait_state().overruns
    stamps = _sway(plant, seconds)
    periods = seconds / plant.cell.config.timing.period_s
    if (state := plant.operator.wait_state()).mode != "enabled":
        raise OperatorError("bench", f"the arm did not stay enabled: {state.mode}")
    found: Figures = {"overruns": state.overruns - overruns}
    for name, pid in pids.items():
        found[name] = round(1e6 * (cpu_s(pid) - before[name]) / periods, 1)
    return stamps, found


def _sway(plant: EnabledPlant, seconds: float) -> list[float]:
    """Drive the arm to and fro; return the stamps of SYNC [s]."""
    amplitude, cycle_s = SWAY
    stamps: list[float] = []
    for i in range(round(seconds / STEP_S)):
        speed = amplitude * math.sin(2.0 * math.pi * i * STEP_S / cycle_s)
        twist = (0.0, speed, 0.5 * speed, 0.0, 0.0, 0.0)
        plant.operator.joystick(twist, STEP_S, expressed_in="base")
        stamps += [
            frame.timestamp for frame in frames(plant.bus) if frame.arbitration_id == SYNC_ID
        ]
    return stamps
