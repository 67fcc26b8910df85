"""Setpoints in RPDO1 in each cyclic synchronous mode: joint units to raw values, and back."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

from ....config.schema.mechanism.mechanism import DriveSection
from ....protocols.canopen import cia402_pdo
from ....protocols.canopen.cia402 import OperationMode

_I16_MAX: Final = 2**15 - 1
_I32_MAX: Final = 2**31 - 1
_UNIT: Final = {OperationMode.CSP: "rad", OperationMode.CSV: "rad/s", OperationMode.CST: "N·m"}
_MOST: Final = {
    OperationMode.CSP: _I32_MAX,
    OperationMode.CSV: _I32_MAX,
    OperationMode.CST: _I16_MAX,
}
_PACK: Final = {
    OperationMode.CSP: cia402_pdo.pack_csp,
    OperationMode.CSV: cia402_pdo.pack_csv,
    OperationMode.CST: cia402_pdo.pack_cst,
}


@dataclass(frozen=True)
class Setpoint:
    """Setpoints of one drive: rad in CSP (607Ah), rad/s in CSV (60FFh), N·m in CST (6071h)."""

    drive: DriveSection
    mode: OperationMode

    @cached_property
    def scale(self) -> float:
        """Raw units per joint unit: counts, counts per second, or thousandths of rated torque."""
        if self.mode is OperationMode.CST:
            return self.drive.direction * 1000.0 / self.drive.rated_torque
        return self.drive.direction * self.drive.counts_per_radian

    @cached_property
    def zero(self) -> float:
        """The command at raw zero; only a position has one of its own."""
        return self.drive.zero_rad if self.mode is OperationMode.CSP else 0.0

    def raw(self, command: float) -> int:
        """Return the nearest raw value to a command.

        Raises `ValueError` if it is not finite, or beyond the bits of its object.
        """
        exact = (command - self.zero) * self.scale
        if not abs(exact) <= _MOST[self.mode]:
            raise ValueError(
                f"{self.drive.joint}: {command} {_UNIT[self.mode]} is beyond the bits of the "
                f"drive's setpoint"
            )
        return round(exact)

    def command(self, raw: int) -> float:
        """Return what a raw value asks of the joint."""
        return self.zero + raw / self.scale

    def still(self, position: int) -> int:
        """Return the raw value that asks for no motion with the drive at `position` [counts].

        In CST it is no torque: it goes out after a stop only, which the drive runs by itself.
        """
        return position if self.mode is OperationMode.CSP else 0

    def pack(self, controlword: int, raw: int) -> bytes:
        """Return RPDO1."""
        return _PACK[self.mode](controlword, raw)
