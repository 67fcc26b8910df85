"""The plant knows its devices by their contract alone."""

from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
from telerobot.config.schema import cell as schema
from telerobot.config.schema.bus import CanOpenNodeSection, OnBusSection
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.device import (
    Cause,
    DeviceError,
    DriveReadings,
    JointDrive,
    JointDrives,
    Peripheral,
    SwitchedOutput,
    Trouble,
)
from telerobot.drivers.fieldbus import Fieldbus, Fieldbuses
from telerobot.drivers.kinds import KINDS
from telerobot.server.plant import Plant

log = []


class Known(Peripheral):
    """A device that nobody has heard of, and what it says."""

    def __init__(self, name, vital=True):
        self.name, self.bus, self.vital = name, "bus", vital
        self.trouble = self.reason = self.refuses = None
        self.told = {}

    def open(self):
        log.append(("open", self.name))
        if self.refuses:
            raise DeviceError(f"{self.name}: {self.refuses}")

    def read(self):
        return SimpleNamespace(trouble=self.trouble)

    def stop(self):
        log.append(("stop", self.name))

    def close(self):
        log.append(("close", self.name))

    def interlock(self):
        return self.reason

    def values(self):
        return self.told


class Lamp(Known, SwitchedOutput):
    def write(self, command):
        log.append((self.name, command))
        return command


class Drive(Known, JointDrive):
    answered, emergency = True, None

    @classmethod
    def together(cls, drives):
        return Drives(drives)

    request_enable = request_disable = request_fault_reset = lambda self: None

    def prepare(self, torque):
        return False


class Drives(JointDrives):
    def __init__(self, drives):
        self.drives = drives

    def answered(self):
        return [drive.answered for drive in self.drives]

    def stamp(self, drive):
        return 0.0

    def emergency(self):
        return next((drive.emergency for drive in self.drives if drive.emergency), None)

    def read(self):
        n = len(self.drives)
        troubles, nothing = tuple(drive.trouble for drive in self.drives), (None,) * n
        return DriveReadings(
            False, (0,) * n, nothing, np.zeros(n), np.zeros(n), nothing, False, troubles
        )

    def write(self, command):
        log.append(list(command))


@pytest.fixture
def plant():
    log.clear()
    hub = Hub()
    devices = (Drive("j1"), Known("quiet", vital=False), Lamp("lamp"))
    yield Plant(Fieldbuses(Fieldbus(InProcessBus(hub), lambda: 0.0)), devices)
    hub.close()


def test_every_device_is_opened_in_order_and_stopped_before_it_is_closed(plant):
    plant.open()
    plant.close()
    names = ["j1", "quiet", "lamp"]
    assert log == [(step, name) for step in ("open", "stop", "close") for name in names]


def test_one_that_cannot_be_opened_keeps_the_plant_closed(plant):
    plant.devices[1].refuses = "no answer"
    with pytest.raises(DeviceError, match="quiet: no answer"):
        plant.open()
    assert not plant.opened
    assert ("open", "lamp") not in log


def test_trouble_of_vital_devices_only_is_the_plants(plant):
    plant.open()
    plant.devices[1].trouble = Trouble(Cause.PDO_LOST, "quiet", "")
    assert plant.read(0.0).trouble is None
    plant.devices[2].trouble = Trouble(Cause.EMERGENCY, "lamp", "")
    assert plant.read(0.0).trouble.device == "lamp"
    plant.devices[0].trouble = Trouble(Cause.DRIVE_FAULT, "j1", "")
    assert plant.read(0.0).trouble.device == "j1"


def test_interlocks_and_values_are_handed_on(plant):
    plant.open()
    assert (plant.read(0.0).interlock, plant.read(0.0).values) == (None, {})
    plant.devices[1].reason, plant.devices[2].told = "quiet is moved", {"warm": 3.5}
    assert plant.read(0.0).interlock == "quiet is moved"
    assert plant.read(0.0).values == {"lamp": {"warm": 3.5}}


def of_buses(*counts):
    """Return a plant of so many drives on each of several buses."""
    log.clear()
    drives = []
    for bus, count in enumerate(counts):
        for j in range(count):
            drives.append(Drive(f"{bus}.j{j}"))
            drives[-1].bus = f"bus {bus}"
    hub = Hub()
    return Plant(Fieldbuses(Fieldbus(InProcessBus(hub), lambda: 0.0)), drives), drives


def unheard(drives, bus):
    for drive in drives:
        drive.answered = drive.bus not in bus


def test_a_bus_of_which_nobody_answers_one_sync_is_silent_if_another_one_answers():
    plant, drives = of_buses(2, 3)
    assert plant.emergency() is None
    unheard(drives, ["bus 1"])
    trouble = plant.emergency()
    assert (trouble.cause, trouble.device) == (Cause.BUS_SILENT, "bus 1")
    assert trouble.detail == "none of its 3 drives answers, 1.j0 to 1.j2"
    drives[3].answered = True
    assert plant.emergency() is None, "one of its drives does answer"


def test_buses_that_are_all_silent_at_once_are_judged_drive_by_drive():
    plant, drives = of_buses(2, 3)
    unheard(drives, ["bus 0", "bus 1"])
    assert plant.emergency() is None
    plant, drives = of_buses(3)
    unheard(drives, ["bus 0"])
    assert plant.emergency() is None, "an only bus has nobody else who could hear the stop"


def test_one_silent_drive_alone_on_its_bus_is_no_silent_bus():
    plant, drives = of_buses(1, 3)
    unheard(drives, ["bus 0"])
    assert plant.emergency() is None


def test_an_emergency_counts_before_a_silent_bus():
    plant, drives = of_buses(2, 3)
    unheard(drives, ["bus 0"])
    drives[3].emergency = Trouble(Cause.EMERGENCY, "1.j1", "")
    assert plant.emergency().device == "1.j1"


def test_outputs_are_switched_by_name_and_others_left_alone(plant):
    plant.switch({})
    plant.switch({"lamp": True})
    assert log == [("lamp", True)]


def tables(section):
    """Yield the classes of all devices' tables."""
    for kind in section.__subclasses__():
        yield from [kind] if kind is not CanOpenNodeSection else tables(kind)


def test_every_devices_table_has_a_driver_and_a_simulated_node():
    assert schema  # its import brings all of them in
    assert set(tables(OnBusSection)) == set(KINDS)
    for kind in KINDS.values():
        module, name = kind.node.split(":")
        node = getattr(import_module(f"telerobot.drivers.rig.nodes.{module}"), name)
        assert callable(node.from_bench)
