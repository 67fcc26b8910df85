"""Driven plant for the benchmarks: rig, daemon, an operator, and a listener on the bus."""

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ...config.load import Cell, ConfigError, load_cell
from ...drivers.bus import CanMessage, open_bus
from ..client.connection import OperatorError
from ..client.operator import Operator
from ..host.local_plant import LocalPlant, free_port

START_S = 30.0
"""Rig and daemon are up within [s]."""
STILL = "\n[redundancy]\nmid_range = 0.0\n"
"""Switches self-motion off: a latency is measured from rest."""


class FrameListener:
    """A passive member of the cell's first bus; stamps are the kernel's, on the wall clock [s]."""

    def __init__(self, cell: Cell) -> None:
        self._bus = open_bus(cell.config.fieldbuses[0])

    def frames(self) -> Iterator[CanMessage]:
        """Yield the frames that have come, without waiting."""
        while (message := self._bus.recv(0)) is not None:
            yield message

    def wait(self, timeout_s: float) -> CanMessage | None:
        """Return the next frame, None if none comes in time [s]."""
        return self._bus.recv(timeout_s)

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


@dataclass(frozen=True)
class EnabledPlant:
    """A plant whose arm is enabled, and who watches it."""

    cell: Cell
    operator: Operator
    listener: FrameListener


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


@contextmanager
def driven(cell: Cell, statistics: Path | None = None) -> Iterator[EnabledPlant]:
    """Start rig and daemon, take the lease and enable the arm.

    Raises `ChildDied` or `OperatorError` where that fails.
    """
    with LocalPlant(cell, statistics) as plant:
        plant.wait(plant.answers, START_S, "the daemon did not answer")
        listener = FrameListener(plant.cell)
        try:
            with Operator(plant.cell, name="bench") as operator:
                _until_ready(plant, operator)
                operator.acquire()
                operator.enable()
                yield EnabledPlant(plant.cell, operator, listener)
        finally:
            listener.close()


def _until_ready(plant: LocalPlant, operator: Operator) -> None:
    deadline_s = time.monotonic() + START_S
    while operator.state is None or operator.state.mode != "ready":
        plant.raise_if_dead()
        operator.spin(0.05)
        if time.monotonic() > deadline_s:
            raise OperatorError("not_now", "the daemon did not get ready")
