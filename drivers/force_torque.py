"""A Robotous RFT force/torque sensor on the CAN bus."""

from typing import Final

import numpy as np

from ..config.schema.mechanism import ForceTorqueSection
from ..protocols.canopen import robotous
from .device import Cause, DeviceError, MeanWrench, Trouble, WrenchReading, WrenchSensor
from .fieldbus import Fieldbus

FIRST_SAMPLE_TIMEOUT_S: Final = 1.0
START_AGAIN_S: Final = 1.0
"""A silent sensor is told to start so often [s]: without power for a moment, it has forgotten."""
MOST_UNREAD: Final = 32
"""Samples that are kept for a mean while nobody asks for it [1]."""


class RobotousSensor(WrenchSensor):
    """Pairs the two frames of each sample, and turns the sign; keeps the contract of `device.py`.

    The device reports the load *on* itself; what is handed on is what the arm exerts: its negative.
    `discarded` counts halves that found no partner within the pairing window: nothing numbers
    them, so a lost frame must not join halves of two samples. Nothing is averaged.

    A sample at an end of the measuring range, or with the sensor's overload status set, says no
    more than that the load is at least that. It is none: the reading goes on ageing, and is stale
    after `timeout_s` of them.

    Its trouble is not vital: what uses the wrench fades, or the cell calls the sensor essential.
    """

    vital = False

    def __init__(
        self, fieldbus: Fieldbus, config: ForceTorqueSection, name: str = "force_torque"
    ) -> None:
        self.name = name
        self.config = config
        self.samples = 0
        self.discarded = 0
        self._bus, self.bus = fieldbus, fieldbus.name
        self._first: tuple[bytes, float] | None = None
        self._foreign = False
        self._sample: robotous.Sample | None = None
        self._stamp = 0.0
        self._arrival_s = self._told_s = 0.0
        most = zip(config.measuring_range, robotous.HALF_COUNTS, strict=True)
        self._ends = tuple(end - half for end, half in most)
        self._heard_s: float | None = None
        """When the newest sample came, whatever it was worth [s]."""
        self._saturated: robotous.Sample | None = None
        """That sample, if it was at an end of its range."""
        self._unread: list[tuple[robotous.Sample, float]] = []
        self._before: list[tuple[float, ...]] = []
        self._mean: MeanWrench | None = None
        fieldbus.listen(config.reply_ids[0], self._on_first)
        fieldbus.listen(config.reply_ids[1], self._on_second)

    def open(self) -> None:
        """Set the rate, start the stream and wait for its first sample. Raises `DeviceError`."""
        self._sample = self._first = self._mean = self._saturated = self._heard_s = None
        self._unread.clear()
        self._before.clear()
        if not self._start():
            raise DeviceError(f"{self.name}: its commands cannot be sent: {self._bus.trouble}")
        if not self._bus.wait_until(lambda: self._heard_s is not None, FIRST_SAMPLE_TIMEOUT_S):
            raise DeviceError(
                f"{self.name}: no sample within {FIRST_SAMPLE_TIMEOUT_S} s of its start "
                f"(command id {self.config.command_id:#x})"
            )

    def read(self) -> WrenchReading:
        """Return the newest sample, and how old it is now; tell a silent sensor to start again."""
        sample, now, heard_s = self._sample, self._bus.now, self._heard_s
        silent = heard_s is not None and now - heard_s > self.config.timeout_s
        if silent and now - self._told_s > START_AGAIN_S:
            self._start()
        if sample is None:
            trouble = Trouble(Cause.PDO_LOST, self.name, "no sample yet")
            if self._saturated is not None and not silent:
                trouble = self._saturation(self._saturated)
            return WrenchReading(False, None, 0.0, 0.0, trouble)
        age = now - self._arrival_s
        load = np.array((*sample.force, *sample.torque))
        return WrenchReading(
            ready=True,
            wrench=-load,
            stamp=self._stamp,
            age_s=age,
            trouble=self._judge(sample, age, silent),
        )

    def mean(self) -> MeanWrench | None:
        """Return the mean of the samples since the last call, or what it was if there were none.

        None before the first sample. Contact that chatters faster than the sensor is read shows in
        any one sample as it happens to be at that instant.
        """
        if self._unread:
            # Lists: a few numbers, of which numpy would make a hundred thousandth of a second.
            loads = [(*sample.force, *sample.torque) for sample, _ in self._unread]
            count, row = len(loads), [*self._before, *loads]
            jump, most = [0.0] * 6, 0.0
            for a, b, c in zip(row, row[1:], row[2:], strict=False):
                off = [0.5 * (i + k) - j for i, j, k in zip(a, b, c, strict=True)]
                size = off[0] ** 2 + off[1] ** 2 + off[2] ** 2
                if size > most:
                    jump, most = off, size
            wrench = np.array([-sum(axis) / count for axis in zip(*loads, strict=True)])
            stamp = sum(stamp for _, stamp in self._unread) / count
            self._mean = MeanWrench(wrench, stamp, np.array(jump))
            self._before = row[-2:]
            self._unread.clear()
        return self._mean

    def write(self, command: bytes) -> bytes:
        """Send one of the protocol's commands, for instance `robotous.bias()`; return it."""
        self._bus.send(self.config.command_id, command)
        return command

    def stop(self) -> None:
        """Do nothing: a sensor moves nothing, and its readings are wanted while others stop."""

    def close(self) -> None:
        """Stop the stream. Never raises."""
        self._bus.send(self.config.command_id, robotous.stop())
        self._sample = self._first = None

    def _start(self) -> bool:
        self._told_s = self._bus.now
        commands = (robotous.stop(), robotous.set_rate(self.config.rate_hz), robotous.start())
        return all(self._bus.send(self.config.command_id, command) for command in commands)

    def _judge(self, sample: robotous.Sample, age: float, silent: bool) -> Trouble | None:
        if age > self.config.timeout_s:
            if self._saturated is not None and not silent:
                return self._saturation(self._saturated)
            return Trouble(Cause.PDO_LOST, self.name, f"no sample for {age:.3f} s", {"age_s": age})
        if sample.error:
            detail = f"the sensor reports error {sample.error:#06x}"
            return Trouble(Cause.EMERGENCY, self.name, detail, {"error": sample.error})
        return None

    def _at_an_end(self, sample: robotous.Sample) -> list[int]:
        """Return which axes of a sample are at an end of their range."""
        load = (*sample.force, *sample.torque)
        return [i for i, end in enumerate(self._ends) if not -end < load[i] < end]

    def _saturation(self, sample: robotous.Sample) -> Trouble:
        axes = self._at_an_end(sample)
        if not axes:
            detail = f"the sensor reports an overload, status {sample.overload:#04x}"
            return Trouble(Cause.SATURATED, self.name, detail, {"overload": sample.overload})
        load, first = (*sample.force, *sample.torque), axes[0]
        words = [
            f"{robotous.AXES[i]} is at {load[i]:.4g} of {self.config.measuring_range[i]:.4g} "
            + ("N" if i < 3 else "N·m")
            for i in axes
        ]
        return Trouble(
            Cause.SATURATED,
            self.name,
            ", ".join(words),
            {
                "axis": robotous.AXES[first],
                "load": load[first],
                "range": self.config.measuring_range[first],
            },
        )

    def _on_first(self, data: bytes, stamp: float) -> None:
        self._drop_half()
        self._foreign = not robotous.is_sample_start(data)
        if not self._foreign:
            self._first = (data, stamp)

    def _on_second(self, data: bytes, stamp: float) -> None:
        if self._foreign:  # the rest of a reply to another command
            self._foreign = False
            return
        first = self._first
        if first is None or not 0 <= stamp - first[1] <= self.config.pairing_window_s:
            self._drop_half()
            self.discarded += 1
            return
        self._first = self._saturated = None
        sample = robotous.join_sample(first[0], data)
        self._heard_s = self._bus.now
        self.samples += 1
        if sample.overload or self._at_an_end(sample):
            self._saturated = sample
            return
        self._sample, self._stamp, self._arrival_s = sample, stamp, self._bus.now
        if len(self._unread) < MOST_UNREAD:
            self._unread.append((self._sample, stamp))

    def _drop_half(self) -> None:
        if self._first is not None:
            self._first = None
            self.discarded += 1
