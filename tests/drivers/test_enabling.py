"""An enabling switch: the driver and the simulated module on one bus."""

from types import SimpleNamespace

import numpy as np
import pytest
from telerobot.config.schema.bus import EnablingSwitchSection
from telerobot.config.schema.cell import TimingSection
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.canopen.io_modules import EnablingInput
from telerobot.drivers.device import Cause, DeviceError
from telerobot.drivers.fieldbus import Fieldbus
from telerobot.drivers.rig.nodes.io import INPUT_EDS, SimulatedSwitch
from telerobot.drivers.rig.nodes.node import NodeLink
from telerobot.drivers.rig.nodes.wire import Wire
from telerobot.protocols.canopen import cia401
from telerobot.protocols.canopen.can301 import FrameError
from telerobot.protocols.messages.rig import RigFault

NODE = 30


@pytest.fixture
def bench():
    """A driver and the module that it hears, with two contacts."""
    found, hub = SimpleNamespace(now=0.0), Hub()
    config = EnablingSwitchSection(node=NODE, inputs=(2, 5))
    bus = InProcessBus(hub, lambda frame: found.node.link.deliver(*frame[:2]))
    link = NodeLink(Wire("bus", bus), lambda: found.now, np.random.default_rng(1))
    found.fieldbus = Fieldbus(InProcessBus(hub), lambda: found.now)
    found.driver = EnablingInput(
        found.fieldbus, config, TimingSection(), INPUT_EDS, "enabling_switch"
    )
    found.node = SimulatedSwitch(config, link, lambda: found.now)
    found.node.boot()
    found.fieldbus.receive(0.0)
    yield found
    hub.close()


def run(bench, periods=1):
    for _ in range(periods):
        bench.now += 0.01
        bench.fieldbus.heartbeat()
        bench.fieldbus.sync()
        bench.node.tick()
        bench.fieldbus.receive(bench.now)


def push(bench, on=True, value=None):
    bench.node.inject(RigFault(kind="push", target="enabling_switch", on=on, value=value))
    run(bench)


def test_the_arm_may_move_only_while_every_contact_is_on(bench):
    bench.driver.open()
    assert bench.driver.interlock() == "enabling_switch released"
    run(bench)
    assert (bench.driver.interlock(), bench.driver.values()) == (None, {"held": True})
    for contacts in (1 << 2, 1 << 5, 0b11011011):
        push(bench, value=contacts)
        assert bench.driver.interlock() == "enabling_switch released", bin(contacts)
    push(bench, value=0xFF)
    assert bench.driver.interlock() is None
    push(bench, on=False)
    assert (bench.driver.interlock(), bench.driver.values()) == (
        "enabling_switch released",
        {"held": False},
    )


def test_one_that_answers_no_sync_counts_as_released_before_its_heartbeat_is_missed(bench):
    bench.driver.open()
    run(bench, 10)
    bench.node.link.disturb(RigFault(kind="silence", target="enabling_switch"))
    run(bench, 4)
    assert bench.driver.interlock() == "enabling_switch silent"
    assert bench.driver.read().trouble is None
    run(bench, 20)
    assert bench.driver.read().trouble.cause is Cause.HEARTBEAT_LOST


def test_one_that_restarts_is_trouble_until_it_is_opened_again(bench):
    bench.driver.open()
    run(bench, 10)
    bench.node.boot()
    run(bench, 5)
    assert bench.driver.read().trouble.cause is Cause.NODE_RESTARTED
    assert bench.driver.interlock() == "enabling_switch silent"
    bench.driver.open()
    run(bench, 10)
    reading = bench.driver.read()
    assert (reading.ready, reading.held, reading.trouble) == (True, True, None)


def test_a_module_that_does_not_answer_is_named(bench):
    bench.node.link.disturb(RigFault(kind="silence", target="enabling_switch"))
    with pytest.raises(DeviceError, match=r"enabling_switch \(node 30\)"):
        bench.driver.open()


@pytest.mark.parametrize("data", [b"", b"\1\2"])
def test_inputs_are_one_byte(data):
    with pytest.raises(FrameError, match="inputs"):
        cia401.unpack_inputs(data)
