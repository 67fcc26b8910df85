"""The force/torque sensor: sign, pairing, age."""

from typing import Any

import numpy as np
import pytest
from telerobot.drivers.device import Cause, DeviceError
from telerobot.protocols.canopen import robotous
from telerobot.protocols.canopen.robotous import Sample, SensorCommand


def test_opening_sets_the_rate_and_waits_for_a_sample(cell: Any) -> None:
    assert not cell.sensor.read().ready
    assert cell.sensor.read().wrench is None
    cell.sensor.open()
    assert cell.played_sensor.commands == [
        (SensorCommand.STOP, 0),
        (SensorCommand.SET_RATE, 0),
        (SensorCommand.START, 0),
    ]
    assert cell.sensor.read().ready


def test_a_sensor_that_stays_silent_cannot_be_opened(cell: Any) -> None:
    cell.played_sensor.starts = False
    with pytest.raises(DeviceError, match="force_torque: no sample within"):
        cell.sensor.open()


def test_the_wrench_is_what_the_arm_exerts_not_the_load(cell: Any) -> None:
    """Pressing a wall at +x with 20 N, the sensor feels −20 N; the reading is +20."""
    cell.sensor.open()
    cell.played_sensor.sample = Sample((-20.0, 0.0, 4.0), (0.5, 0.0, -1.0), 0, 0)
    cell.played_sensor.send()
    cell.fieldbus.receive(0.0)
    wrench = cell.sensor.read().wrench
    np.testing.assert_allclose(wrench, [20.0, 0.0, -4.0, -0.5, 0.0, 1.0])


def test_a_lost_frame_never_joins_halves_of_two_samples(cell: Any) -> None:
    cell.sensor.open()
    played = cell.played_sensor
    before = cell.sensor.read().wrench
    played.sample = Sample((0.0, 0.0, 0.0), (8.0, 8.0, 8.0), 0, 0)
    played.send(second=False)
    cell.hub.time_s += 0.005
    played.sample = Sample((0.0, 0.0, 0.0), (-8.0, -8.0, -8.0), 0, 0)
    played.send(first=False)
    cell.fieldbus.receive(0.0)
    np.testing.assert_array_equal(cell.sensor.read().wrench, before)
    assert cell.sensor.discarded == 2
    played.send()
    cell.fieldbus.receive(0.0)
    np.testing.assert_allclose(cell.sensor.read().wrench[3:], [8.0, 8.0, 8.0])


def test_a_second_half_alone_and_a_first_half_twice_are_discarded(cell: Any) -> None:
    cell.sensor.open()
    cell.played_sensor.send(first=False)
    cell.played_sensor.send(second=False)
    cell.played_sensor.send()
    cell.fieldbus.receive(0.0)
    assert cell.sensor.discarded == 2
    assert cell.sensor.samples == 2


@pytest.mark.parametrize(("gap_s", "samples"), [(0.0019, 2), (0.0021, 1)])
def test_halves_pair_inside_the_window_only(cell: Any, gap_s: float, samples: int) -> None:
    cell.sensor.open()
    cell.played_sensor.send(gap_s=gap_s)
    cell.fieldbus.receive(0.0)
    assert cell.sensor.samples == samples


def test_the_reply_to_another_command_is_no_sample(cell: Any) -> None:
    cell.sensor.open()
    cell.played_sensor.put(0, b"\x0f\x01" + bytes(6))
    cell.played_sensor.put(1, bytes(8))
    cell.played_sensor.send()
    cell.fieldbus.receive(0.0)
    assert (cell.sensor.samples, cell.sensor.discarded) == (2, 0)


def test_age_is_measured_from_when_the_sample_was_taken_off_the_bus(cell: Any) -> None:
    cell.sensor.open()
    cell.hub.time_s = 10.0
    cell.played_sensor.send()
    cell.fieldbus.receive(100.0)
    cell.fieldbus.receive(100.03)
    reading = cell.sensor.read()
    assert reading.age_s == pytest.approx(0.03)
    assert reading.stamp == 10.0
    assert reading.trouble is None
    cell.fieldbus.receive(100.06)
    stale = cell.sensor.read()
    assert stale.trouble.cause is Cause.PDO_LOST
    assert stale.ready


def test_a_sensor_that_falls_silent_is_told_to_start_once_a_second(cell: Any) -> None:
    """One whose supply was gone for a moment waits for that, for ever."""
    cell.sensor.open()
    told = cell.played_sensor.commands
    told.clear()
    cell.played_sensor.starts = False
    for now_s in np.arange(100.0, 103.5, 0.01):
        cell.fieldbus.receive(float(now_s))
        cell.sensor.read()
    start = [(SensorCommand.STOP, 0), (SensorCommand.SET_RATE, 0), (SensorCommand.START, 0)]
    assert told == 4 * start
    cell.played_sensor.starts = True
    cell.fieldbus.receive(104.1)
    cell.sensor.read()
    cell.fieldbus.receive(104.11)
    assert cell.sensor.read().trouble is None
    assert told == 5 * start


def test_an_error_is_told(cell: Any) -> None:
    cell.sensor.open()
    hear(cell, Sample((0.0,) * 3, (0.0,) * 3, 0, 2))
    trouble = cell.sensor.read().trouble
    assert trouble.cause is Cause.EMERGENCY
    assert trouble.values == {"error": 2}


def hear(cell: Any, sample: Sample) -> None:
    cell.played_sensor.sample = sample
    cell.played_sensor.send()
    cell.fieldbus.receive(cell.fieldbus.now)


def hear_for_the_timeout(cell: Any, sample: Sample) -> Any:
    """Return the reading after a sample that is repeated for longer than one is fresh."""
    for _ in range(6):
        cell.fieldbus.receive(cell.fieldbus.now + 0.01)
        hear(cell, sample)
    return cell.sensor.read()


RAILS = [(axis, sign) for axis in range(6) for sign in (1.0, -1.0)]


@pytest.mark.parametrize(("axis", "sign"), RAILS)
def test_a_sample_at_an_end_of_its_range_is_none_and_its_axis_is_told(
    cell: Any, axis: int, sign: float
) -> None:
    cell.sensor.open()
    load = np.zeros(6)
    load[axis] = sign * 1e4
    trouble = hear_for_the_timeout(cell, Sample(tuple(load[:3]), tuple(load[3:]), 0, 0)).trouble
    assert trouble.cause is Cause.SATURATED
    assert trouble.values["axis"] == ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")[axis]
    assert trouble.values["load"] == pytest.approx(sign * (655.34 if axis < 3 else 16.3835))


def test_the_range_of_the_cell_is_the_one_that_is_judged(make_cell: Any) -> None:
    cell = make_cell(measuring_range=(200.0, 200.0, 200.0, 4.0, 4.0, 4.0))
    cell.sensor.open()
    well = Sample((199.9, 0.0, 0.0), (3.99, 0.0, 0.0), 0, 0)
    assert hear_for_the_timeout(cell, well).trouble is None
    beyond = Sample((200.0, 0.0, 0.0), (0.0, -4.0, 0.0), 0, 0)
    detail = hear_for_the_timeout(cell, beyond).trouble.detail
    assert "Fx is at 200 of 200 N, Ty is at -4 of 4 N·m" in detail


def test_a_sample_with_the_overload_status_is_none_wherever_it_reads(cell: Any) -> None:
    cell.sensor.open()
    trouble = hear_for_the_timeout(cell, Sample((0.0,) * 3, (0.0,) * 3, 4, 0)).trouble
    assert trouble.cause is Cause.SATURATED
    assert trouble.values == {"overload": 4}


def test_a_blow_beyond_the_range_leaves_the_reading_from_before_it(cell: Any) -> None:
    cell.sensor.open()
    well, beyond = Sample((8.0, 0, 0), (0,) * 3, 0, 0), Sample((1e4, 0, 0), (0,) * 3, 0, 0)
    cell.sensor.mean()
    hear(cell, well)
    cell.fieldbus.receive(cell.fieldbus.now + 0.04)
    hear(cell, beyond)
    reading = cell.sensor.read()
    assert reading.trouble is None
    assert reading.wrench[0] == cell.sensor.mean().wrench[0] == -8.0
    assert reading.age_s == pytest.approx(0.04)
    assert hear_for_the_timeout(cell, beyond).trouble.cause is Cause.SATURATED
    hear(cell, well)
    assert cell.sensor.read().trouble is None


def test_a_sensor_that_is_at_its_end_is_not_silent_and_not_started_again(cell: Any) -> None:
    cell.sensor.open()
    cell.played_sensor.commands.clear()
    for _ in range(30):
        hear_for_the_timeout(cell, Sample((1e4, 0, 0), (0,) * 3, 0, 0))
    assert cell.played_sensor.commands == []


def test_a_sensor_that_is_at_its_end_from_the_beginning_is_opened_and_told(cell: Any) -> None:
    cell.played_sensor.sample = Sample((1e4, 0.0, 0.0), (0.0,) * 3, 0, 0)
    cell.sensor.open()
    reading = cell.sensor.read()
    assert (reading.ready, reading.wrench) == (False, None)
    assert reading.trouble.cause is Cause.SATURATED


def test_a_bias_is_asked_of_the_sensor(cell: Any) -> None:
    cell.sensor.open()
    assert cell.sensor.write(robotous.bias()) == robotous.bias()
    assert cell.played_sensor.commands[-1] == (SensorCommand.SET_BIAS, 1)


def test_the_mean_is_of_every_sample_since_it_was_last_asked_for(cell: Any) -> None:
    """Of contact that chatters, any one sample shows what happens to be at its instant."""
    cell.sensor.open()
    cell.sensor.mean()
    for force in (0.0, -30.0, 0.0):
        cell.hub.time_s += 0.005
        cell.played_sensor.sample = Sample((force, 0.0, 0.0), (0.0, 0.0, 0.0), 0, 0)
        cell.played_sensor.send()
    cell.fieldbus.receive(0.0)
    mean = cell.sensor.mean()
    np.testing.assert_allclose(mean.wrench, [10.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(mean.jump, [30.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert cell.sensor.read().stamp - mean.stamp == pytest.approx(0.005)
    assert cell.sensor.mean() is mean
