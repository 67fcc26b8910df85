"""Several fieldbuses as one, each with a clock of its own for stamps."""

from types import SimpleNamespace

import can
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.bus import BusSection
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.canopen.servo import ServoDrive
from telerobot.drivers.device import Cause, DeviceError
from telerobot.drivers.fieldbus import Fieldbus, Fieldbuses, open_buses
from telerobot.drivers.force_torque import RobotousSensor
from telerobot.protocols.canopen import can301
from telerobot.server.plant import Plant

from .conftest import PERIOD_S, Cell, PlayedDrive, PlayedSensor

OFFSET_S = 1e6
"""Stamps of the second bus are so much later: its interface has a clock of its own [s]."""


@pytest.fixture
def plant(make_cell):
    """A drive on each of two buses, the sensor on the second; `send_s` passes in each SYNC."""
    cell: Cell = make_cell()
    hub, now = Hub(), SimpleNamespace(s=0.0, send_s=0.0)

    def clock():
        return now.s

    class Slow(InProcessBus):
        def put(self, can_id, data):
            super().put(can_id, data)
            now.s += now.send_s if can_id == can301.SYNC_ID else 0.0

    first = Fieldbus(Slow(cell.hub), clock, "bus left")
    second = Fieldbus(Slow(hub), clock, "bus right")
    drives = [ServoDrive(b, cell.drive, cell.timing, lower=-2, upper=3) for b in (first, second)]
    sensor = RobotousSensor(second, cell.ft)
    played = PlayedDrive(hub), PlayedSensor(hub, cell.ft)
    made = Plant(Fieldbuses(first, second), (*drives, sensor))

    def step(sample=True):
        """Pass a period: SYNC on both, answers, and a sample 1 ms after the second's."""
        now.s += PERIOD_S
        cell.hub.time_s, hub.time_s = now.s, now.s + OFFSET_S
        cell.played.heartbeat()
        played[0].heartbeat()
        made.buses.sync()
        if sample:
            hub.time_s += 1e-3
            played[1].send()
        return made.read(now.s)

    yield SimpleNamespace(it=made, step=step, now=now, played=(cell.played, played[0]))
    hub.close()


def test_a_sample_is_aged_by_the_clock_of_its_own_bus(plant):
    plant.it.open()
    plant.step()
    reading = plant.step()
    assert reading.q is not None
    (reading,) = reading.units
    assert reading.wrench_lag_s == pytest.approx(-1e-3, abs=1e-6)
    assert reading.wrench_mean_lag_s == pytest.approx(-1e-3, abs=1e-6)


@pytest.mark.parametrize(("apart_s", "together"), [(1e-4, True), (2e-4, True), (4e-4, False)])
def test_samples_are_together_within_three_tenths_of_a_millisecond(plant, apart_s, together):
    plant.now.send_s = apart_s
    plant.it.open()
    plant.step()
    at_s = plant.now.s + PERIOD_S
    (reading,) = plant.step().units
    assert reading.sampled_s == (pytest.approx(at_s) if together else None)


def test_sync_and_heartbeat_go_out_on_every_bus_one_right_after_the_other():
    sent, hubs = [], (Hub(), Hub())
    for i, hub in enumerate(hubs):
        InProcessBus(hub, lambda frame, i=i: sent.append((i, frame[0])))
    buses = Fieldbuses(*(Fieldbus(InProcessBus(hub), lambda: 0.0) for hub in hubs))
    buses.sync()
    buses.heartbeat()
    beat = can301.heartbeat_id(can301.MASTER_NODE)
    assert sent == [(0, 0x080), (1, 0x080), (0, beat), (1, beat)]
    assert [bus.sync_count for bus in buses] == [1, 1]


def test_the_plant_has_answered_only_when_every_bus_has(plant):
    plant.it.open()
    plant.played[1].answers_sync = False
    plant.it.buses.sync()
    assert not plant.it.answered()
    plant.played[1].answer()
    assert plant.it.answered()


def test_one_drive_that_is_silent_alone_on_its_bus_is_told_as_that_drive(plant):
    plant.it.open()
    plant.step()
    plant.played[1].answers_sync = False
    for _ in range(5):
        trouble = plant.step().trouble
    assert (trouble.cause, trouble.device) == (Cause.PDO_LOST, "j1")


def test_a_second_master_on_the_second_bus_keeps_every_drive_from_being_opened(plant):
    hub = plant.it.buses[1].bus.hub
    InProcessBus(hub).send(can.Message(arbitration_id=can301.SYNC_ID, is_extended_id=False))
    plant.it.buses.clear_trouble()
    with pytest.raises(DeviceError, match="bus right: someone else sent 0x080"):
        plant.it.open()


@pytest.mark.parametrize("passed_s", [0.0, 0.1, 0.3])
def test_another_master_is_listened_for_since_a_bus_was_opened(passed_s):
    class Bus(InProcessBus):
        def take(self, timeout=0.0):
            now.s += timeout
            return super().take(0.0)

    hub, now = Hub(), SimpleNamespace(s=5.0)
    buses = Fieldbuses(Fieldbus(Bus(hub), lambda: now.s, "bus"))
    now.s += passed_s
    buses.listen(0.25)
    assert now.s == pytest.approx(5.0 + max(0.25, passed_s))
    assert buses.trouble is None
    InProcessBus(hub).put(can301.SYNC_ID, b"")
    now.s += 1.0
    before_s = now.s
    buses.listen(0.25)
    assert now.s == before_s, "it has waited for longer than is asked"
    assert buses.trouble.cause is Cause.SECOND_MASTER


def test_what_is_heard_while_another_master_is_listened_for_ends_it():
    class Bus(InProcessBus):
        def take(self, timeout=0.0):
            if timeout:
                other.put(can301.SYNC_ID, b"")
            return super().take(0.0)

    hub = Hub()
    buses, other = Fieldbuses(Fieldbus(Bus(hub), lambda: 0.0, "bus")), InProcessBus(hub)
    buses.listen(0.25)
    assert buses.trouble.cause is Cause.SECOND_MASTER


def test_waiting_ends_when_any_bus_has_something(tmp_path):
    names = ("239.74.163.77", "239.74.163.78")
    buses = tuple(
        BusSection(name=f"b{i}", channel=name, port=43977) for i, name in enumerate(names)
    )
    cell = altered(load_cell("pa10"), {"buses": buses})
    ours, others = (open_buses(cell, lambda: 0.0) for _ in range(2))
    heard = []
    ours[1].listen(0x123, lambda data, _stamp: heard.append(data))
    others[1].send(0x123, b"now")
    for _ in range(100):
        ours.wait(1.0)
        ours.receive(0.0)
        if heard:
            break
    assert heard == [b"now"]
    ours.close()
    others.close()


def test_a_bus_that_cannot_be_opened_closes_those_before_it():
    gone = BusSection(name="gone", interface="socketcan", channel="can_that_is_not")
    config = SimpleNamespace(fieldbuses=(BusSection(channel="239.74.163.79", port=43979), gone))
    with pytest.raises(DeviceError, match="socketcan can_that_is_not"):
        open_buses(SimpleNamespace(config=config), lambda: 0.0)
