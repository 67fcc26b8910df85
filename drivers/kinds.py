"""Table of the kinds of devices on a bus: for each, its driver and its simulated node.

A row's key is the class of the device's table in the cell file. The rig imports a node when it
makes it: a daemon loads no physics.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ..config.load import Cell
from ..config.schema.bus import EnablingSwitchSection, Entry, OnBusSection
from ..config.schema.mechanism import (
    DriveSection,
    ForceTorqueSection,
    GripperSection,
    ImuSection,
)
from ..protocols.canopen.cia402 import OperationMode
from .canopen.imu import Imu
from .canopen.io_modules import EnablingInput, GripperOutput
from .canopen.servo import ServoDrive, StopRamp
from .device import Device
from .fieldbus import Fieldbus, Fieldbuses
from .force_torque import RobotousSensor

EDS: Final = Path(__file__).resolve().parent.parent / "config" / "devices"


@dataclass(frozen=True)
class Kind:
    """Maker of a device's driver, and the class of its simulated node."""

    driver: Callable[[Any, Entry, Fieldbus, Cell], Device]
    """Takes the device's table, its entry, its bus, and the cell of its mechanism."""
    node: str
    """Module in `rig/nodes/` and class, which keeps the contract `node.py`."""


def _servo(drive: DriveSection, entry: Entry, fieldbus: Fieldbus, cell: Cell) -> Device:
    joint = next(j for j in cell.robot.joints if j.name == drive.joint)
    return ServoDrive(
        fieldbus,
        drive.model_copy(update={"joint": entry.name}),
        cell.config.timing,
        lower=joint.lower,
        upper=joint.upper,
        mode=OperationMode[cell.config.mechanism.mode_of(drive).upper()],
        endless=drive.joint in cell.config.mechanism.wheels,
        eds=EDS / "simulated_drive.eds",
    )


def _sensor(sensor: ForceTorqueSection, entry: Entry, fieldbus: Fieldbus, _cell: Cell) -> Device:
    return RobotousSensor(fieldbus, sensor, entry.name)


def _gripper(gripper: GripperSection, entry: Entry, fieldbus: Fieldbus, cell: Cell) -> Device:
    eds = EDS / "simulated_output.eds"
    return GripperOutput(fieldbus, gripper, cell.config.timing, eds, entry.name)


def _imu(imu: ImuSection, entry: Entry, fieldbus: Fieldbus, cell: Cell) -> Device:
    return Imu(fieldbus, imu, cell.config.timing, EDS / "simulated_imu.eds", entry.name)


def _switch(switch: EnablingSwitchSection, entry: Entry, fieldbus: Fieldbus, cell: Cell) -> Device:
    eds = EDS / "simulated_input.eds"
    return EnablingInput(fieldbus, switch, cell.config.timing, eds, entry.name)


KINDS: Final[dict[type[OnBusSection], Kind]] = {
    DriveSection: Kind(_servo, "servo:SimulatedDrive"),
    ForceTorqueSection: Kind(_sensor, "sensors:SimulatedForceTorque"),
    GripperSection: Kind(_gripper, "io:SimulatedGripper"),
    ImuSection: Kind(_imu, "sensors:SimulatedImu"),
    EnablingSwitchSection: Kind(_switch, "io:SimulatedSwitch"),
}


def make_drivers(cell: Cell, buses: Fieldbuses) -> tuple[Device, ...]:
    """Return the drivers of a cell's devices, in the order of booting; none is opened yet."""
    by_name = {c.name: bus for c, bus in zip(cell.config.fieldbuses, buses, strict=True)}
    parts = cell.parts
    together = {name for t in cell.joint_tasks if t.quick_stop == "in_proportion" for name in t.by}
    drivers = []
    for entry in cell.devices:
        part = cell if entry.part is None else parts[entry.part]
        make = KINDS[type(entry.section)].driver
        driver = make(entry.section, entry, by_name[entry.bus], part)
        driver.part = entry.part
        backbone = part.config.mechanism.backbone
        told = backbone is not None and backbone.quick_stop == "in_proportion"
        if isinstance(driver, ServoDrive) and (told or part.config.mechanism.name in together):
            driver.ramp = StopRamp(by_name[entry.bus], driver.node, driver.drive)
        drivers.append(driver)
    return tuple(drivers)
