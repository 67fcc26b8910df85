"""RPDO2 with 6085h: a drive is told the ramp of the quick stop that follows.

It is mapped once, in *Pre-operational*, and sent just before a quick stop only; the drive takes it
over when it comes, without a SYNC. A reset configures the drive anew, with the cell's own ramp.
"""

import struct
from collections.abc import Iterator
from typing import Final

import canopen

from ....config.schema.mechanism.mechanism import DriveSection
from ....protocols.canopen import can301
from ....protocols.canopen.can301 import CommunicationObject as Com
from ....protocols.canopen.cia402 import Object
from ...device import DeviceError
from ...fieldbus import Fieldbus
from . import servo_setup
from .servo_setup import U8, U32, SetupWrite

_NUMBER: Final = 1
"""RPDO2, counted from 0."""
_LAYOUT: Final = struct.Struct("<I")


class StopRamp:
    """Tells one drive the ramp of its quick stop."""

    def __init__(self, fieldbus: Fieldbus, node: canopen.RemoteNode, drive: DriveSection) -> None:
        self._bus, self._node, self._drive = fieldbus, node, drive
        self._id = can301.rpdo1_id(drive.node) + 0x100 * _NUMBER

    def map(self) -> None:
        """Map 6085h in *Pre-operational*, after the drive was configured. Raises `DeviceError`."""
        try:
            for step in self._steps():
                servo_setup.write(self._node, self._drive, step)
        except DeviceError as error:
            raise DeviceError(
                f"{error}; the drive takes no 6085h by PDO: set quick_stop = 'each' in the task "
                "that holds a payload with others, or in the arm's backbone"
            ) from error

    def send(self, deceleration: float) -> None:
        """Send the ramp of the next quick stop [rad/s²]."""
        counts = round(deceleration * self._drive.counts_per_radian)
        self._bus.send(self._id, _LAYOUT.pack(min(max(counts, 1), 2**32 - 1)))

    def _steps(self) -> Iterator[SetupWrite]:
        communication = Com.RPDO_COMMUNICATION + _NUMBER
        mapping = Com.RPDO_MAPPING + _NUMBER
        yield SetupWrite(communication, 2, U8, can301.AT_ONCE)
        yield SetupWrite(mapping, 0, U8, 0)
        yield SetupWrite(
            mapping, 1, U32, can301.mapping_entry(Object.QUICK_STOP_DECELERATION, 0, 32)
        )
        yield SetupWrite(mapping, 0, U8, 1)
        yield SetupWrite(communication, 1, U32, self._id)
