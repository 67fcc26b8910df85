"""The devices of one cell as one thing: all drives, the sensor, the bus they share."""

from dataclasses import dataclass

import numpy as np

from ..drivers.device import DeviceError, Trouble
from ..drivers.fieldbus import Fieldbus
from ..drivers.force_torque import MeanWrench, RobotousSensor
from ..drivers.gripper import GripperOutput
from ..drivers.servo import ServoDrive
from ..protocols.canopen.cia402 import DriveState
from .control.spatial import Array

OFF = (DriveState.SWITCH_ON_DISABLED, DriveState.READY_TO_SWITCH_ON)
"""Drive states in which the power stage is off and nothing is wrong."""

LISTEN_S = 0.25
"""Another master is listened for this long before a drive is reset; it sends SYNC oftener [s]."""


@dataclass(frozen=True)
class PlantReading:
    """What the devices last said."""

    q: Array | None
    """Joint angles (n,) [rad]; None before every drive has told its own."""
    sampled_s: float | None
    """When all of them were sampled [s], on the fieldbus' clock; None when that is not known."""
    tau: Array
    """Joint torques (n,) [N·m]."""
    states: tuple[DriveState | None, ...]
    obeyed: bool
    """Every drive's state was sampled after what it was last told took effect."""
    wrench: Array | None
    """What the arm exerts, at and in the Sensor frame (6,) [N, N·m]; None when stale."""
    wrench_age_s: float | None
    wrench_lag_s: float
    """How much older the sample is than the joints' angles, by the bus' own stamps [s]."""
    wrench_mean: MeanWrench | None
    """The same, as the mean of all samples since the reading before; None when stale."""
    wrench_mean_lag_s: float
    """How much older that mean is than the joints' angles [s]."""
    trouble: Trouble | None

    @property
    def wrench_over_period(self) -> tuple[Array, float] | None:
        """The mean wrench (6,) and how much older it is than the joints' angles [s], if fresh."""
        mean = self.wrench_mean
        return None if mean is None else (mean.wrench, self.wrench_mean_lag_s)

    @property
    def enabled(self) -> bool:
        """True when every drive is in Operation enabled, and was told nothing else since."""
        return self.obeyed and all(s is DriveState.OPERATION_ENABLED for s in self.states)

    @property
    def off(self) -> bool:
        """True when every drive's power stage is off and stays so, and none is faulty."""
        return self.obeyed and all(s in OFF for s in self.states)


class Plant:
    """Opens, reads, writes and stops every device of a cell."""

    def __init__(
        self,
        fieldbus: Fieldbus,
        drives: tuple[ServoDrive, ...],
        sensor: RobotousSensor | None,
        sensor_timeout_s: float,
        gripper: GripperOutput | None = None,
    ) -> None:
        self.fieldbus = fieldbus
        self.drives = drives
        self.sensor = sensor
        self.gripper = gripper
        self.opened = False
        self._commanded = False
        self._sensor_timeout_s = sensor_timeout_s
        self._wrench_lag_s = 0.0

    def open(self) -> None:
        """Configure every device; blocks. Raises `DeviceError`.

        Nothing is sent while somebody else commands these drives: they may be moving.
        """
        self.opened = False
        self.fieldbus.clear_trouble()
        self.fieldbus.wait_until(lambda: self.fieldbus.trouble is not None, LISTEN_S)
        if self.fieldbus.trouble is not None:
            raise DeviceError(f"{self.fieldbus.name}: {self.fieldbus.trouble.detail}")
        self._commanded = True
        for drive in self.drives:
            drive.open()
        if self.sensor is not None:
            self.sensor.open()
        if self.gripper is not None:
            self.gripper.open()
        self.opened = True

    def sync(self) -> None:
        """Send SYNC."""
        self.fieldbus.sync()

    def answered(self) -> bool:
        """Take in what has come; return whether every drive has answered the last SYNC."""
        self.fieldbus.receive(self.fieldbus.clock())
        return all(drive.read().fresh for drive in self.drives)

    def read(self, now_s: float) -> PlantReading:
        """Return what the devices last said."""
        self.fieldbus.receive(now_s)
        readings = [drive.read() for drive in self.drives]
        angles = [r.position_rad for r in readings]
        heard = self.opened and all(a is not None for a in angles)
        trouble = self.fieldbus.trouble
        for reading in readings:
            trouble = trouble or reading.trouble
        if self.gripper is not None:
            trouble = trouble or self.gripper.read().trouble
        wrench, age = self._wrench(now_s)
        mean = None if self.sensor is None else self.sensor.mean()
        sampled_s = readings[0].sampled_s
        together = all(r.sampled_s == sampled_s for r in readings)
        return PlantReading(
            q=np.array(angles, dtype=float) if heard else None,
            sampled_s=sampled_s if together else None,
            tau=np.array([r.torque_nm or 0.0 for r in readings]),
            states=tuple(r.state for r in readings),
            obeyed=all(r.obeyed for r in readings),
            wrench=wrench,
            wrench_age_s=age,
            wrench_lag_s=self._wrench_lag_s,
            wrench_mean=None if wrench is None else mean,
            wrench_mean_lag_s=0.0 if mean is None else self.drives[0].answer_stamp - mean.stamp,
            trouble=trouble if self.opened else None,
        )

    def write(self, command: Array) -> None:
        """Send every drive its setpoint (n,): rad, rad/s or N·m, as the operation mode is."""
        for drive, setpoint in zip(self.drives, command.tolist(), strict=True):
            drive.write(setpoint)

    def grip(self, closed: bool | None) -> None:
        """Keep the gripper closed or open; None: nobody has said, it stays as it is."""
        if self.gripper is not None and closed is not None:
            self.gripper.write(closed)

    def make_room(self) -> bool:
        """Let every drive's position limits hold where its joint stands; return whether it blocked.

        To be called with all drives off. Raises `DeviceError`.
        """
        blocked = False
        for drive in self.drives:
            blocked = drive.make_room() or blocked
        return blocked

    def enable(self) -> None:
        """Ask every drive for Operation enabled."""
        for drive in self.drives:
            drive.request_enable()

    def disable(self) -> None:
        """Ask every drive to switch its power off."""
        for drive in self.drives:
            drive.request_disable()

    def reset(self) -> None:
        """Ask every drive to leave its fault."""
        for drive in self.drives:
            drive.request_fault_reset()

    def quick_stop(self) -> None:
        """Stop every drive on its own ramp, now."""
        for drive in self.drives:
            drive.stop()

    def close(self) -> None:
        """Stop and let go of every device, unless it was never ours."""
        if self._commanded:
            self.quick_stop()
            for drive in self.drives:
                drive.close()
            if self.sensor is not None:
                self.sensor.close()
            if self.gripper is not None:
                self.gripper.close()
        self.fieldbus.close()

    def _wrench(self, now_s: float) -> tuple[Array | None, float | None]:
        if self.sensor is None or not self.opened:
            return None, None
        reading = self.sensor.read(now_s)
        # The first drive's answer comes right after the SYNC at which all of them sampled.
        self._wrench_lag_s = self.drives[0].answer_stamp - reading.stamp
        fresh = (
            reading.wrench is not None
            and reading.trouble is None
            and reading.age_s <= self._sensor_timeout_s
        )
        return (reading.wrench if fresh else None), reading.age_s
