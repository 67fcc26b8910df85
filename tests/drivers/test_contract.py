"""What every device driver promises, held by every device driver."""

from collections.abc import Callable
from typing import Any

import pytest
from telerobot.drivers.device import DeviceError
from telerobot.protocols.canopen import robotous


def servo(cell: Any) -> tuple[Any, Any]:
    return cell.servo, 0.65


def sensor(cell: Any) -> tuple[Any, Any]:
    return cell.sensor, robotous.bias()


def break_the_drive(cell: Any) -> None:
    cell.played.boots = False


def break_the_sensor(cell: Any) -> None:
    cell.played_sensor.starts = False


DEVICES = pytest.mark.parametrize("device", [servo, sensor])
Pick = Callable[[Any], tuple[Any, Any]]


@DEVICES
def test_a_device_has_a_name(cell: Any, device: Pick) -> None:
    assert device(cell)[0].name in ("j1", "force_torque")


@DEVICES
def test_a_device_says_nothing_before_it_was_heard(cell: Any, device: Pick) -> None:
    assert not device(cell)[0].read().ready


@DEVICES
def test_reading_and_writing_work_after_opening(cell: Any, device: Pick) -> None:
    driver, command = device(cell)
    driver.open()
    cell.fieldbus.sync()
    cell.fieldbus.receive(0.0)
    reading = driver.read()
    assert reading.ready
    assert reading.trouble is None
    assert driver.write(command) is not None


@pytest.mark.parametrize(
    ("device", "breaks"), [(servo, break_the_drive), (sensor, break_the_sensor)]
)
def test_a_device_that_does_not_answer_raises_a_device_error_with_its_name(
    cell: Any, device: Pick, breaks: Callable[[Any], None]
) -> None:
    breaks(cell)
    driver, _ = device(cell)
    with pytest.raises(DeviceError, match=driver.name):
        driver.open()


@DEVICES
def test_stopping_and_closing_are_safe_in_any_state_and_more_than_once(
    cell: Any, device: Pick
) -> None:
    driver, _ = device(cell)
    for _ in range(2):
        driver.stop()
        driver.close()
    driver.open()
    driver.stop()
    driver.stop()
    driver.close()
    cell.fieldbus.close()
    driver.stop()
    driver.close()
    assert not driver.read().ready


@DEVICES
def test_a_device_can_be_opened_again(cell: Any, device: Pick) -> None:
    driver, _ = device(cell)
    driver.open()
    driver.close()
    driver.open()
    cell.fieldbus.sync()
    cell.fieldbus.receive(0.0)
    assert driver.read().ready
