"""A rover that looks ahead: its tick, its scans, SYNC beside its scanner, and its wheels' latency.

Tick and scans are those of a simulated drive towards the bridge, among 16 boxes more: every ray is
cast, the base slows down, the arm folds. Physics goes between two ticks, so that caches are as cold
as in the daemon. Its telegrams and telemetry are looked at once more, by themselves, for the time
from a telegram to its contour; the longest is the one with the search of a posture.

SYNC and latency are those of real processes, `telerobot scan` among them.
"""

import gc
import socket
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
from telerobot.config.load import Cell, ConfigError, load_cell
from telerobot.drivers.scanner import decoded
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages.telemetry import State
from telerobot.protocols.sick import TelegramCutter
from telerobot.server.perception.scanning.scanning import Scanning
from telerobot.tools.bench import latency, sync
from telerobot.tools.bench.figures import Figures, percentiles
from telerobot.tools.bench.latency import EnabledPlant, driven
from telerobot.tools.host.machine import free_port, realtime
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

DRIVE_S, QUICK_DRIVE_S = 14.0, 8.0
"""Length of the simulated drive [s]: it decides after 6 s, and folds."""
SPEED = 0.3
"""Of the base in that [m/s]."""
BOXES = 16
"""Beside the way, in addition to what the scanner finds [1]."""
SETTLED_S = 1.0
"""Ticks count from there on [s]."""

Heard = tuple[float, bytes | State]


def bench(cell: Cell, quick: bool) -> Figures:
    """Measure tick and scans in a simulated drive, then SYNC and latency of real processes."""
    figures = looking(cell, QUICK_DRIVE_S if quick else DRIVE_S)
    with tempfile.TemporaryDirectory() as folder:
        own = with_own_scanner(cell, Path(folder))
        beside = sync.bench(own, sync.QUICK_SECONDS if quick else sync.SECONDS)
        figures |= {f"sync_{name}": value for name, value in beside.items()}
        steps = latency.QUICK_STEPS if quick else latency.STEPS
        figures |= {f"wheels_{name}": value for name, value in wheels(own, steps).items()}
    return figures


def with_own_scanner(cell: Cell, folder: Path) -> Cell:
    """Return the cell with its laser scanner on a port that nobody uses, as a file in a folder.

    Raises `ConfigError` for a cell without one.
    """
    scanner = cell.config.scanner
    if scanner is None:
        raise ConfigError(f"{cell.path}: scanner: missing")
    path = folder / f"own_{cell.config.name}.toml"
    address = f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    path.write_text(f'extends = "{cell.path}"\n[scanner]\naddress = "{address}"\n')
    return load_cell(path)


def looking(cell: Cell, seconds: float) -> Figures:
    """Measure a simulated drive towards the bridge for some seconds [s]."""
    simulation = Simulation(cell, _script(seconds))
    heard: list[Heard] = []
    ticks: list[float] = []
    known: list[int] = []

    def on_telegram(received: bytes) -> None:
        heard.append((simulation.rig.time_s, received))

    def on_tick(run: Simulation) -> None:
        if run.states:
            heard.append((run.rig.time_s, run.states[-1]))
        if run.clock.time_s >= SETTLED_S:
            ticks.append(run.cycle.compute_s)
            known.append(len(run.cycle.units.obstacles.known))

    if simulation.rig.scanner is not None:
        simulation.rig.scanner.on_telegram.append(on_telegram)
    simulation.on_tick = on_tick
    gc.collect()
    gc.disable()
    try:
        with realtime() as refusal:
            simulation.run()
            seconds_of_scans = contours(cell, heard)
    finally:
        gc.enable()
    return {
        "tick_us": percentiles(1e6 * np.array(ticks)),
        "boxes": int(np.median(known)) if known else 0,
        "scan_us": percentiles(1e6 * np.array(seconds_of_scans)),
        "sched_fifo": not refusal,
    }


def contours(cell: Cell, heard: list[Heard]) -> list[float]:
    """Return the times from telegram to contour [s]: to read it, to place it, to encode the news.

    Telegrams and telemetry come in the order in which they were `heard`, with the time [s].
    """
    scanning, cutter = Scanning(cell), TelegramCutter()
    seconds: list[float] = []
    reading_s = 0.0
    for now_s, what in heard:
        start_s = time.perf_counter()
        if isinstance(what, State):
            found = list(scanning.listen([what], now_s))
            for looked in found:
                for news in looked.messages:
                    encode(news)
            if any(looked.contour is not None for looked in found):
                seconds.append(reading_s + time.perf_counter() - start_s)
        else:
            for telegram in cutter.feed(what):
                if (scan := decoded(telegram)) is not None:
                    scanning.receive(scan, now_s)
            reading_s = time.perf_counter() - start_s
    return seconds


def wheels(cell: Cell, steps: int) -> Figures:
    """Measure from the put of a drive to the first frame of a wheel that follows it."""
    with driven(cell) as plant:
        targets = latency.Targets(plant.cell, plant.bus, cell.config.mechanism.wheels)
        period_s = cell.config.timing.period_s
        return latency.from_rest(plant, targets, steps, period_s, partial(_drive, plant))


def _drive(plant: EnabledPlant, speed: float) -> None:
    """Drive back: ahead a base waits for a scanner that was silent for a moment."""
    plant.operator.command(t.DRIVE, rates=(-abs(speed), 0.0))


def _script(seconds: float) -> Script:
    """Return the drive ahead, between two rows of boxes."""
    steps: list[dict[str, object]] = []
    for i in range(BOXES):
        news = {
            "name": f"box_{i}",
            "shape": "box",
            "xyz": [0.4 * (i // 2), 1.3 if i % 2 else -1.3, 0.8],
            "half_size": [0.1, 0.1, 0.3],
            "max_speed": 0.0,
        }
        steps.append({"at_s": 0.2, "sensor/obstacle": news})
    steps.append({"at_s": 0.3, "cmd/drive": {"rates": [SPEED, 0.0]}})
    return Script.model_validate({"duration_s": seconds, "step": steps})
