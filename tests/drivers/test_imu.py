"""An inertial measurement unit: the driver and the simulated node on one bus."""

from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError
from telerobot.config.schema.cell import TimingSection
from telerobot.config.schema.mechanism import ImuSection
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.canopen.imu import Imu
from telerobot.drivers.device import Cause, DeviceError
from telerobot.drivers.fieldbus import Fieldbus
from telerobot.drivers.rig.nodes.node import NodeLink
from telerobot.drivers.rig.nodes.sensors import IMU_EDS, SimulatedImu
from telerobot.drivers.rig.nodes.wire import Wire
from telerobot.protocols.messages.rig import RigFault

NODE = 50
PERFECT = {"acceleration_noise": 0.0, "rate_noise": 0.0}
FELT, TURNED = np.array([1.5, -2.5, 9.81]), np.array([0.1, -0.2, 0.3])
VALUES = ("ax", "ay", "az", "wx", "wy", "wz")


def bench_of(config):
    """Return a driver and the node that it hears; `felt` and `turned` are the link's motion."""
    found, hub = SimpleNamespace(now=0.0, felt=FELT, turned=TURNED), Hub()
    bus = InProcessBus(hub, lambda frame: found.node.link.deliver(*frame[:2]))
    link = NodeLink(Wire("bus", bus), lambda: found.now, np.random.default_rng(1))
    found.fieldbus = Fieldbus(InProcessBus(hub), lambda: found.now)
    found.driver = Imu(found.fieldbus, config, TimingSection(), IMU_EDS, "imu")
    rng = np.random.default_rng(2)
    found.node = SimulatedImu(
        config, link, lambda: (found.felt, found.turned), rng, lambda: found.now
    )
    found.node.boot()
    found.fieldbus.receive(0.0)
    return found


@pytest.fixture
def bench():
    return bench_of(ImuSection(node=NODE, virtual=PERFECT))


def run(bench, periods=1):
    for _ in range(periods):
        bench.now += 0.01
        bench.fieldbus.heartbeat()
        bench.fieldbus.sync()
        bench.node.tick()
        bench.fieldbus.receive(bench.now)


def test_it_says_nothing_before_its_first_sample(bench):
    assert not bench.driver.read().ready
    bench.driver.open()
    assert bench.driver.read().acceleration is None
    assert bench.driver.values() == dict.fromkeys(VALUES) | {"trouble": None}
    run(bench)
    assert bench.driver.read().ready


def test_it_tells_how_the_link_moves_to_half_a_count(bench):
    bench.driver.open()
    run(bench)
    reading, config = bench.driver.read(), bench.driver.config
    assert reading.trouble is None
    np.testing.assert_allclose(
        reading.acceleration, FELT, atol=0.5 * config.acceleration_per_bit + 1e-12
    )
    np.testing.assert_allclose(reading.rate, TURNED, atol=0.5 * config.rate_per_bit + 1e-12)
    values = [bench.driver.values()[name] for name in VALUES]
    assert values == [*reading.acceleration.tolist(), *reading.rate.tolist()]


def test_the_bias_that_is_told_is_taken_off_what_the_unit_adds():
    biased = {"acceleration_bias": (0.5, 0.0, -0.4), "rate_bias": (0.0, 0.02, 0.0)}
    for told, most in ((biased, 2e-3), ({}, 1.0)):
        bench = bench_of(ImuSection(node=NODE, virtual=PERFECT | biased, **told))
        bench.driver.open()
        run(bench)
        off = np.abs(bench.driver.read().acceleration - FELT).max()
        assert (off < 2e-3) == bool(told)
        assert off < most
        assert (abs(bench.driver.read().rate[1] - TURNED[1]) < 2e-4) == bool(told)


def test_its_noise_is_that_of_the_cell():
    noise = {"acceleration_noise": 0.1, "rate_noise": 0.01}
    bench = bench_of(ImuSection(node=NODE, virtual=noise))
    bench.driver.open()
    samples = []
    for _ in range(600):
        run(bench)
        reading = bench.driver.read()
        samples.append([reading.acceleration, reading.rate])
    spread = np.std(samples, axis=0).mean(axis=1)
    np.testing.assert_allclose(spread, [0.1, 0.01], rtol=0.1)


@pytest.mark.parametrize(
    ("felt", "turned", "axis"),
    [
        ((0.0, -90.0, 9.81), TURNED, "accelerometer y"),
        (FELT, (0.0, 0.0, 4.4), "gyroscope z"),
    ],
)
def test_an_axis_at_an_end_of_its_range_is_no_reading_and_is_named(bench, felt, turned, axis):
    bench.driver.open()
    run(bench)
    bench.felt, bench.turned = np.array(felt), np.array(turned)
    run(bench)
    reading = bench.driver.read()
    assert (reading.acceleration, reading.rate) == (None, None)
    assert reading.trouble.cause is Cause.SATURATED
    assert reading.trouble.values["axis"] == axis
    assert bench.driver.values() == dict.fromkeys(VALUES) | {"trouble": "saturated"}
    bench.felt, bench.turned = FELT, TURNED
    run(bench)
    assert bench.driver.read().trouble is None


def test_one_that_leaves_four_syncs_unanswered_is_stale(bench):
    bench.driver.open()
    run(bench, 10)
    bench.node.link.disturb(RigFault(kind="silence", target="imu"))
    run(bench, 3)
    assert bench.driver.read().trouble is None
    run(bench)
    trouble = bench.driver.read().trouble
    assert (trouble.cause, trouble.detail) == (Cause.PDO_LOST, "no sample for 4 SYNCs")
    assert bench.driver.read().rate is None
    run(bench, 20)
    assert bench.driver.read().trouble.cause is Cause.HEARTBEAT_LOST


def test_a_sample_needs_both_halves_of_one_sync(bench):
    bench.driver.open()
    run(bench)
    received = bench.node.link.send
    bench.node.link.send = lambda can_id, data: (
        None if can_id == 0x280 + NODE else received(can_id, data)
    )
    run(bench, 4)
    assert bench.driver.read().trouble.cause is Cause.PDO_LOST


def test_one_that_was_cut_off_is_started_again():
    """Without the master's heartbeat a node leaves Operational by itself."""
    bench = bench_of(ImuSection(node=NODE))
    bench.driver.open()
    run(bench, 10)
    bench.node.link.disturb(RigFault(kind="silence", target="imu"))
    run(bench, 60)
    bench.node.link.disturb(RigFault(kind="silence", target="imu", on=False))
    for _ in range(150):
        run(bench)
        bench.driver.read()
    assert bench.driver.read().trouble is None


def test_one_that_restarted_is_named(bench):
    bench.driver.open()
    run(bench, 3)
    bench.node.boot()
    run(bench, 1)
    assert bench.driver.read().trouble.cause is Cause.NODE_RESTARTED


def test_another_makers_objects_are_mapped():
    bench = bench_of(
        ImuSection(node=NODE, virtual=PERFECT, acceleration_object=0x6101, rate_object=0x6102)
    )
    bench.driver.open()
    run(bench)
    np.testing.assert_allclose(bench.driver.read().acceleration, FELT, atol=2e-3)
    assert bench.node.objects[0x1A01, 2] == 0x6102_0210


def test_one_that_is_not_there_raises_a_device_error_with_its_name(bench):
    bench.node.link.disturb(RigFault(kind="silence", target="imu"))
    with pytest.raises(DeviceError, match=r"imu \(node 50\): writing"):
        bench.driver.open()


def test_one_that_has_stuck_is_named_until_it_changes():
    bench = bench_of(ImuSection(node=NODE))
    bench.driver.open()
    run(bench, 50)
    assert bench.driver.read().trouble is None
    bench.node.inject(RigFault(kind="freeze", target="imu"))
    run(bench, 9)
    assert bench.driver.read().trouble is None
    run(bench)
    reading = bench.driver.read()
    assert (reading.acceleration, reading.rate) == (None, None)
    assert reading.trouble.cause is Cause.UNCHANGING
    assert reading.trouble.detail == "11 samples are equal in all axes"
    bench.node.inject(RigFault(kind="freeze", target="imu", on=False))
    run(bench)
    assert bench.driver.read().trouble is None


def test_it_has_no_other_fault(bench):
    with pytest.raises(ValueError, match="an imu can only freeze"):
        bench.node.inject(RigFault(kind="push", target="imu"))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"acceleration_range": 100.0}, "16 bits of acceleration_per_bit end at 78.45"),
        ({"rate_range": 6.0}, "16 bits of rate_per_bit end at 5.004"),
        ({"rate_object": 0x3102}, "rate_object 0x3102 is acceleration_object, too"),
    ],
)
def test_a_range_beyond_its_counts_is_refused(wrong, words):
    with pytest.raises(ValidationError, match=words):
        ImuSection(node=NODE, **wrong)
