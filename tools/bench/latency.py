"""Latency from an operator's put to the first command on the bus that reflects it.

The arm stands. A stick twist is put at a moment that has no relation to the period; a passive
member of the bus sees the first RPDO1 whose target has changed. The put is stamped by the wall
clock, as the kernel stamps frames: one clock. Force control and self-motion are switched off
meanwhile, since both move targets by themselves.
"""

import struct
import tempfile
import time
from pathlib import Path

import numpy as np

from ...config.load import Cell
from ...protocols import topics as t
from ...protocols.canopen.can301 import rpdo1_id
from ...protocols.messages.messages import Frame
from .figures import Figures, percentiles
from .plant import EnabledPlant, driven, without_self_motion

STEPS = 200
QUICK_STEPS = 50
SPEED = 0.03
"""The stick's twist, along the base's y, to and fro [m/s]."""
STILL_S = 0.08
"""Targets that have not changed for this long stand [s]."""
GIVE_UP_S = 1.0
ALLOWANCE_S = 0.001
"""Target: p99 below two periods and this [s]."""


def bench(cell: Cell, steps: int = STEPS) -> Figures:
    """Measure a number of stick steps from rest."""
    period_s = cell.config.timing.period_s
    with tempfile.TemporaryDirectory() as folder:
        still = without_self_motion(cell, Path(folder))
        with driven(still) as plant:
            plant.operator.request(t.SWITCH, source="force", on=False)
            watch = _Watch(plant)
            draw = np.random.default_rng(1)
            seconds: list[float] = []
            missed = 0
            for i in range(steps):
                watch.until_still()
                time.sleep(float(draw.uniform(0.0, period_s)))
                plant.operator.turn()
                latency_s = watch.step(SPEED if i % 2 else -SPEED)
                if latency_s is None:
                    missed += 1
                else:
                    seconds.append(latency_s)
                _stick(plant, 0.0)
    figures = percentiles(1e6 * np.array(seconds))
    target_us = round(1e6 * (2.0 * period_s + ALLOWANCE_S), 1)
    return {
        "steps": steps,
        "missed": missed,
        "latency_us": figures,
        "target_us": target_us,
        "met": figures["p99"] < target_us and missed == 0,
    }


class _Watch:
    """Knows the newest target of each drive on the bus."""

    def __init__(self, plant: EnabledPlant) -> None:
        self._plant = plant
        drives = plant.cell.config.mechanism.drives
        self._ids = {rpdo1_id(drive.node) for drive in drives}
        self._targets: dict[int, int] = {}

    def until_still(self) -> None:
        """Keep the operator's session alive until no target has changed for a while."""
        since_s = time.monotonic()
        while time.monotonic() - since_s < STILL_S:
            self._plant.operator.turn()
            if self._changed_at(0.002) is not None:
                since_s = time.monotonic()

    def step(self, speed: float) -> float | None:
        """Put a stick twist; return the time to the first changed target [s], None if none came."""
        while self._plant.listener.wait(0.0) is not None:
            continue  # frames from before the put
        put_s = time.time()
        _stick(self._plant, speed)
        while time.time() - put_s < GIVE_UP_S:
            changed_s = self._changed_at(0.02)
            if changed_s is not None:
                return changed_s - put_s
        return None

    def _changed_at(self, timeout_s: float) -> float | None:
        """Return the stamp of the next frame that changes a target, None if none comes [s]."""
        frame = self._plant.listener.wait(timeout_s)
        if frame is None or frame.arbitration_id not in self._ids or len(frame.data) != 6:
            return None
        (target,) = struct.unpack_from("<i", frame.data, 2)
        before = self._targets.get(frame.arbitration_id)
        self._targets[frame.arbitration_id] = target
        return None if before in (None, target) else frame.timestamp


def _stick(plant: EnabledPlant, speed: float) -> None:
    plant.operator.command(
        t.JOYSTICK,
        twist=(0.0, speed, 0.0, 0.0, 0.0, 0.0),
        expressed_in=Frame.BASE,
        relative_to=Frame.BASE,
    )
