"""Objects of a servo drive that depend on where its joint stands: room (607Dh), torque (60B2h).

Written over SDO with the drive's power off, where they change.
"""

import canopen

from ....config.schema.mechanism.mechanism import DriveSection
from ....protocols.canopen.cia402 import OperationMode
from . import servo_setup
from .setpoint import Setpoint


class Standstill:
    """Range and preload of one drive; `lower`, `upper` are the joint's limits [rad]."""

    def __init__(
        self,
        node: canopen.RemoteNode,
        drive: DriveSection,
        mode: OperationMode,
        lower: float,
        upper: float,
    ) -> None:
        self._node, self._drive = node, drive
        # In CST the setpoint itself is the torque.
        self._preloads = mode is not OperationMode.CST
        self._torque = Setpoint(drive, OperationMode.CST)
        self._limits = lower, upper
        self.configured()

    def configured(self) -> None:
        """Take note that `servo_setup.configure` has written all objects."""
        self._room, self._offset = self._limits, 0

    def write(self, q: float, torque: float) -> bool:
        """Prepare for a joint at `q` [rad] that `torque` holds [N·m]; return whether any changed.

        Blocks where an object has to change; raises `DeviceError`. A drive without 60B2h has its
        integral take the torque, after the joint has sagged a little.
        """
        room = servo_setup.room(self._drive, *self._limits, q)
        most = self._drive.max_torque
        held = min(max(torque, -most), most) if self._preloads else 0.0
        offset = self._torque.raw(held)
        changed = (room, offset) != (self._room, self._offset)
        if room != self._room:
            servo_setup.write_limits(self._node, self._drive, *room)
        if offset != self._offset:
            servo_setup.write_torque_offset(self._node, self._drive, offset)
        self._room, self._offset = room, offset
        return changed
