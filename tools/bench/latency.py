"""Latency from an operator's command to the drive's, over real processes."""

import struct
import tempfile
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...config.load import Cell, load_cell
from ...drivers.bus import CanBus, CanMessage, open_bus
from ...protocols import topics as t
from ...protocols.canopen.can301 import rpdo1_id
from ...protocols.messages.messages import Frame
from ..client.operator import Operator
from ..host.local_plant import LocalPlant
from .figures import Figures, percentiles

# --- Driven plant for the benchmarks: rig, daemon, an operator, and a listener on the bus ---------
START_S = 30.0  # rig and daemon are up within [s]
STILL = "\n[redundancy]\nmid_range = 0.0\n"
"""Switches self-motion off: a latency is measured from rest."""


def frames(bus: CanBus) -> Iterator[CanMessage]:
    """Yield the frames that have come, without waiting."""
    while (message := bus.recv(0)) is not None:
        yield message


@dataclass(frozen=True)
class EnabledPlant:
    """A plant whose arm is enabled, and who watches it."""

    cell: Cell
    operator: Operator
    bus: CanBus
    """A passive member of the cell's first bus; stamps are the kernel's, on the wall clock [s]."""
    local: LocalPlant
    """Its processes."""


def without_self_motion(cell: Cell, folder: Path) -> Cell:
    """Return the cell with its null space unused, as a file in a folder."""
    path = folder / f"{cell.config.name}.toml"
    text = cell.path.read_text(encoding="utf-8")
    if "[redundancy]" in text:
        text = text.replace("[redundancy]", "[redundancy]\nmid_range = 0.0")
    else:
        text += STILL
    path.write_text(text.replace(f'"{cell.robot.urdf.name}"', f'"{cell.robot.urdf}"'))
    return load_cell(path)


@contextmanager
def driven(cell: Cell, statistics: Path | None = None) -> Iterator[EnabledPlant]:
    """Start rig and daemon, take the lease and enable the arm.

    Raises `ChildDied` or `OperatorError` where that fails.
    """
    with LocalPlant(cell, statistics) as plant:
        plant.wait(plant.answers, START_S, "the daemon did not answer")
        bus = open_bus(plant.cell.config.fieldbuses[0])
        try:
            with Operator(plant.cell, name="bench") as operator:
                plant.wait(
                    lambda: operator.spin(0.05, lambda: _is_ready(operator)),
                    START_S,
                    "the daemon did not get ready",
                )
                operator.acquire()
                operator.enable()
                yield EnabledPlant(plant.cell, operator, bus, plant)
        finally:
            bus.shutdown()


def _is_ready(operator: Operator) -> bool:
    return operator.state is not None and operator.state.mode == "ready"


# --- Latency from an operator's put to the first command on the bus that reflects it --------------
#
# The arm stands. A stick twist is put at a moment that has no relation to the period; a passive
# member of the bus sees the first RPDO1 whose target has changed. The put is stamped by the
# wall clock, as the kernel stamps frames: one clock. Force control and self-motion are switched
# off meanwhile, since both move targets by themselves.
STEPS = 200
QUICK_STEPS = 50
SPEED = 0.03  # the stick's twist, along the base's y, to and fro [m/s]
STILL_S = 0.08  # targets that have not changed for this long stand [s]
GIVE_UP_S = 0.3  # shorter than a lease, which nobody renews meanwhile [s]
ALLOWANCE_S = 0.001  # target: p99 below two periods and this [s]


def bench(cell: Cell, steps: int = STEPS) -> Figures:
    """Measure a number of stick steps from rest."""
    period_s = cell.config.timing.period_s
    with tempfile.TemporaryDirectory() as folder:
        still = without_self_motion(cell, Path(folder))
        with driven(still) as plant:
            plant.operator.request(t.SWITCH, source="force", on=False)
            targets = Targets(plant.cell, plant.bus)

            def put(speed: float) -> None:
                twist, axes = (0.0, speed, 0.0, 0.0, 0.0, 0.0), Frame.BASE
                plant.operator.command(t.JOYSTICK, twist=twist, expressed_in=axes, relative_to=axes)

            return from_rest(plant, targets, steps, period_s, put)


def from_rest(
    plant: EnabledPlant,
    targets: "Targets",
    steps: int,
    period_s: float,
    put: Callable[[float], None],
) -> Figures:
    """Measure a number of steps from rest; `put` asks for a speed [m/s], to and fro, and for 0."""
    draw = np.random.default_rng(1)
    seconds: list[float] = []
    missed = 0
    for i in range(steps):
        targets.until_still(STILL_S, plant.operator.turn)
        time.sleep(float(draw.uniform(0.0, period_s)))
        plant.operator.turn()
        targets.forget()
        put_s = time.time()
        put(SPEED if i % 2 else -SPEED)
        changed_s = targets.changed_at(GIVE_UP_S)
        if changed_s is None:
            missed += 1
        else:
            seconds.append(changed_s - put_s)
        put(0.0)
    figures = percentiles(1e6 * np.array(seconds))
    target_us = round(1e6 * (2.0 * period_s + ALLOWANCE_S), 1)
    return {
        "steps": steps,
        "missed": missed,
        "latency_us": figures,
        "target_us": target_us,
        "met": figures["p99"] < target_us and missed == 0,
    }


class Targets:
    """Knows the newest target of each drive on the bus, or of those of some joints."""

    def __init__(self, cell: Cell, bus: CanBus, joints: Collection[str] | None = None) -> None:
        self._bus = bus
        drives = cell.config.mechanism.drives
        self._ids = {rpdo1_id(d.node) for d in drives if joints is None or d.joint in joints}
        self._targets: dict[int, int] = {}

    def until_still(self, still_s: float, meanwhile: Callable[[], None]) -> None:
        """Call `meanwhile` again and again until no target has changed for so long [s]."""
        since_s = time.monotonic()
        while time.monotonic() - since_s < still_s:
            meanwhile()
            if self._next(0.002) is not None:
                since_s = time.monotonic()

    def forget(self) -> None:
        """Read the frames that have come already."""
        for _ in frames(self._bus):
            continue

    def changed_at(self, within_s: float) -> float | None:
        """Return the stamp of the next frame that changes a target, None if none comes [s]."""
        since_s = time.monotonic()
        while time.monotonic() - since_s < within_s:
            changed_s = self._next(0.02)
            if changed_s is not None:
                return changed_s
        return None

    def _next(self, timeout_s: float) -> float | None:
        """Return the stamp of the next frame if it changes a target [s]."""
        frame = self._bus.recv(timeout_s)
        if frame is None or frame.arbitration_id not in self._ids or len(frame.data) != 6:
            return None
        (target,) = struct.unpack_from("<i", frame.data, 2)
        before = self._targets.get(frame.arbitration_id)
        self._targets[frame.arbitration_id] = target
        return None if before in (None, target) else frame.timestamp
