"""A simulated SICK LMS111: answers requests, and sends a telegram for every scan (CoLa-A).

| fault | what it does |
|---|---|
| silence | no telegrams, no answers |
| drop | the end of a telegram is lost, with the probability `value`, 1 by default |
| corrupt | words of a telegram are garbled, likewise |
| crop | scans have only so many rays, `value`, 181 by default: another angle range |
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from .....config.load import Cell
from .....protocols.messages.rig import RigFault
from .....protocols.sick.cola import framed, hexadecimal
from .....protocols.sick.scan_data import ANGLE_UNIT, MEASURING, Scan, encode_scan
from ...fault_values import value_of
from ...physics.sensors.rangefinder import Rangefinder
from ...physics.world import World

NAME: Final = "scanner"
"""Target of its faults."""
KINDS: Final = ("silence", "drop", "corrupt", "crop")


class SimulatedScanner:
    """The scanner of one rig. `on_telegram` gets the bytes of every scan, as they go out."""

    def __init__(self, cell: Cell, world: World) -> None:
        self._finder = Rangefinder(cell, world.model, world.data)
        self._faults: dict[str, float] = {}
        seed = 0 if cell.config.rig is None else cell.config.rig.seed
        self._rng = np.random.default_rng([seed, 3])
        self.on_telegram: list[Callable[[bytes], None]] = []
        self.on_step: Callable[[], None] = _ignore
        """Called after every tenth physics step."""
        self.scans = self._steps = 0

    @classmethod
    def of(cls, cell: Cell, world: World) -> "SimulatedScanner | None":
        """Return that of a cell; None where it has none."""
        return None if cell.config.scanner is None else cls(cell, world)

    def step(self, time_s: float) -> None:
        """Let the mirror turn on; send what is complete."""
        self._steps += 1
        if self._steps % 10 == 0:
            self.on_step()
        scan = self._finder.step(time_s)
        if scan is None or "silence" in self._faults:
            return
        self.scans += 1
        telegram = self._spoilt(framed(encode_scan(self._cropped(scan))))
        for listener in self.on_telegram:
            listener(telegram)

    def inject(self, fault: RigFault) -> None:
        """Apply a fault, or take it back. Raises `ValueError`."""
        if fault.kind not in KINDS:
            raise ValueError(f"fault {fault.kind}: a scanner knows: {', '.join(KINDS)}")
        value = 1.0
        if fault.kind == "crop":
            most = float(self._finder.scanner.rays - 1)
            value = 181.0 if fault.value is None else value_of(fault, 1.0, most, "rays")
        elif fault.value is not None:
            value = value_of(fault, 0.0, 1.0, "")
        self._faults.pop(fault.kind, None)
        if fault.on:
            self._faults[fault.kind] = value

    def answer(self, words: str) -> str | None:
        """Return the answer to a request; None while it is silent."""
        if "silence" in self._faults:
            return None
        scanner = self._finder.scanner
        kind, _, rest = words.partition(" ")
        name = rest.partition(" ")[0]
        first, last = scanner.first, scanner.first + scanner.step * (scanner.rays - 1)
        span = (
            f"{round(scanner.step / ANGLE_UNIT):X} {hexadecimal(round(first / ANGLE_UNIT))} "
            f"{hexadecimal(round(last / ANGLE_UNIT))}"
        )
        answers = {
            ("sMN", "SetAccessMode"): "sAN SetAccessMode 1",
            ("sWN", "LMDscandatacfg"): "sWA LMDscandatacfg",
            ("sMN", "LMCstartmeas"): "sAN LMCstartmeas 0",
            ("sMN", "mEEwriteall"): "sAN mEEwriteall 1",
            ("sMN", "Run"): "sAN Run 1",
            ("sRN", "SCdevicestate"): "sRA SCdevicestate 1",
            ("sRN", "STlms"): f"sRA STlms {MEASURING} 0 8 00:00:00 8 01.01.1970 0 0 0",
            ("sRN", "LMPoutputRange"): f"sRA LMPoutputRange 1 {span}",
            ("sRN", "LMPscancfg"): f"sRA LMPscancfg {round(100 * scanner.rate_hz):X} 1 {span}",
            ("sEN", "LMDscandata"): f"sEA LMDscandata {rest.rpartition(' ')[2]}",
        }
        return answers.get((kind, name), "sFA 3" if kind == "sRN" else "sFA C")

    def _cropped(self, scan: Scan) -> Scan:
        rays = self._faults.get("crop")
        return scan if rays is None else replace(scan, distances=scan.distances[: int(rays)])

    def _spoilt(self, telegram: bytes) -> bytes:
        if self._rng.random() < self._faults.get("drop", 0.0):
            telegram = telegram[: int(self._rng.integers(1, len(telegram) - 1))]
        if self._rng.random() < self._faults.get("corrupt", 0.0):
            spoilt = bytearray(telegram)
            for i in self._rng.integers(1, len(spoilt) - 1, 8).tolist():
                spoilt[i] = ord("Z")
            telegram = bytes(spoilt)
        return telegram


def _ignore() -> None:
    """Stand in for a listener."""
