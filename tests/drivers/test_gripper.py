"""The gripper's driver and its simulated module, through frames."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from telerobot.config.schema.cell import TimingSection
from telerobot.config.schema.mechanism import GripperSection
from telerobot.drivers import rig
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.canopen.io_modules import REPEAT, GripperOutput
from telerobot.drivers.device import Cause, DeviceError
from telerobot.drivers.fieldbus import Fieldbus
from telerobot.drivers.rig.nodes.io import SimulatedGripper
from telerobot.drivers.rig.nodes.node import NodeLink
from telerobot.drivers.rig.nodes.wire import Wire
from telerobot.protocols.canopen import can301
from telerobot.protocols.canopen.can301 import NmtCommand, NmtState
from telerobot.protocols.canopen.cia401 import pack_outputs
from telerobot.protocols.messages.rig import RigFault

EDS = Path(rig.__file__).parents[2] / "config" / "devices" / "simulated_output.eds"
NODE, OUTPUT = 20, 3


@pytest.fixture
def hub():
    hub = Hub()
    yield hub
    hub.close()


@pytest.fixture
def bench(hub):
    """A driver, the module it drives, and what the module's gripper was told."""
    return make(hub, closed=1)


def make(hub, closed):
    found = SimpleNamespace(grasps=[], sent=[], now=0.0)
    config = GripperSection(node=NODE, output=OUTPUT, closed=closed)
    clock = lambda: found.now  # noqa: E731
    bus = InProcessBus(hub, lambda frame: found.node.link.deliver(*frame[:2]))
    link = NodeLink(Wire("bus", bus), clock, np.random.default_rng(1))
    found.fieldbus = Fieldbus(InProcessBus(hub), clock)
    found.driver = GripperOutput(found.fieldbus, config, TimingSection(), EDS)
    found.node = SimulatedGripper(config, link, found.grasps.append, clock)
    found.node.boot()
    found.fieldbus.receive(0.0)
    found.fieldbus.taps.append(lambda can_id, data: found.sent.append((can_id, data)))
    return found


def beat(bench, seconds):
    """Let time pass, with the daemon's own heartbeat."""
    for _ in range(round(seconds / 0.01)):
        bench.now += 0.01
        bench.fieldbus.heartbeat()
        bench.node.tick()
        bench.fieldbus.receive(bench.now)


@pytest.mark.parametrize("closed", [0, 1])
def test_closing_and_opening_switch_the_output_and_nothing_else(hub, closed):
    bench = make(hub, closed)
    bench.driver.open()
    for command in (True, False, True):
        assert bench.driver.write(command) is command
        assert bench.node.closed is command
        assert bench.node.objects[0x6200, 1] in (0, 1 << OUTPUT)


def test_opening_the_device_neither_resets_nor_switches_it(bench):
    bench.driver.open()
    bench.driver.write(True)
    bench.sent.clear()
    bench.driver.open()
    assert bench.node.closed
    sent = [data[0] for can_id, data in bench.sent if can_id == can301.NMT_ID]
    assert sent == [NmtCommand.START]
    assert not any(can_id == can301.rpdo1_id(NODE) for can_id, _ in bench.sent)


def test_the_output_is_sent_on_change_and_now_and_then(bench):
    bench.driver.open()
    bench.sent.clear()
    for _ in range(2 * REPEAT):
        bench.driver.write(True)
    bench.driver.write(False)
    frames = [data for can_id, data in bench.sent if can_id == can301.rpdo1_id(NODE)]
    assert frames == [bytes((8,)), bytes((8,)), bytes((0,))]


def test_it_is_ready_once_its_heartbeat_says_operational(bench):
    assert not bench.driver.read().ready
    bench.driver.open()
    beat(bench, 0.2)
    reading = bench.driver.read()
    assert (reading.ready, reading.state, reading.trouble) == (True, NmtState.OPERATIONAL, None)


def test_silence_and_a_restart_are_trouble(bench):
    bench.driver.open()
    beat(bench, 0.1)
    bench.node.link.disturb(RigFault(kind="silence", target="gripper"))
    beat(bench, 0.3)
    assert bench.driver.read().trouble.cause is Cause.HEARTBEAT_LOST
    bench.node.link.disturb(RigFault(kind="silence", target="gripper", on=False))
    bench.node.boot()
    bench.fieldbus.receive(bench.now)
    assert bench.driver.read().trouble.cause is Cause.NODE_RESTARTED
    bench.driver.open()
    beat(bench, 0.1)
    assert bench.driver.read().trouble is None


def test_a_module_that_does_not_answer_is_named(bench):
    bench.node.link.disturb(RigFault(kind="silence", target="gripper"))
    with pytest.raises(DeviceError, match=r"gripper \(node 20\)"):
        bench.driver.open()


def test_without_the_daemon_the_grip_is_kept(bench):
    bench.driver.open()
    bench.driver.write(True)
    beat(bench, 0.1)
    bench.driver.stop()
    bench.driver.close()
    bench.now += 1.0
    bench.node.tick()
    assert bench.node.master_lost
    assert bench.node.closed


def test_a_module_told_to_does_let_go_when_the_master_is_lost(bench):
    bench.driver.open()
    bench.driver.write(True)
    bench.node.objects[0x6206, 1] = 0xFF
    beat(bench, 0.1)
    bench.now += 1.0
    bench.node.tick()
    assert not bench.node.closed
    assert bench.grasps[-1] is False


def test_a_ninth_output_is_no_output():
    with pytest.raises(ValueError, match="8 bits"):
        pack_outputs(256)
