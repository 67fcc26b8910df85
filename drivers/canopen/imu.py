"""An inertial measurement unit on the CAN bus: accelerometer and gyroscope, read at every SYNC."""

import struct
from contextlib import suppress
from pathlib import Path
from typing import Final

import can
import numpy as np

from ...config.schema.cell import TimingSection
from ...config.schema.mechanism import ImuSection
from ...protocols.canopen import can301
from ...protocols.canopen.can301 import PDO_INVALID, NmtState
from ...protocols.canopen.can301 import CommunicationObject as Com
from ..device import (
    MOST_MISSED_SYNCS,
    Cause,
    InertialReading,
    InertialSensor,
    Trouble,
    Value,
)
from ..fieldbus import Fieldbus
from .io_modules import WatchedNode, Write

EVERY_SYNC: Final = 1
MOST_EQUAL: Final = 10
"""More samples of six equal counts in a row are no measurement: noise changes some [1]."""
START_AGAIN_S: Final = 1.0
"""A unit that is alive and tells nothing is told to start so often [s]."""
_COUNTS: Final = struct.Struct("<hhh")
_AXIS_BITS: Final = 16
_SENSORS: Final = ("accelerometer", "gyroscope")


class Imu(InertialSensor):
    """Tells how a link accelerates and turns; keeps the contract of `device.py`.

    The unit answers every SYNC with two frames, one for each sensor. A sample counts once both have
    come. One that is older than three SYNCs is stale; an axis at an end of its range tells no more
    than that; and samples that do not change come from a unit that has stuck. Its trouble is not
    vital: the arm goes on without it.
    """

    vital = False

    def __init__(
        self, fieldbus: Fieldbus, config: ImuSection, timing: TimingSection, eds: Path, name: str
    ) -> None:
        self.name, self.bus, self.config = name, fieldbus.name, config
        self._bus = fieldbus
        self._node = WatchedNode(name, config.node, fieldbus, timing, eds)
        first = can301.tpdo1_id(config.node)
        self._ids = (first, first + 0x100)
        self._scale = (config.acceleration_per_bit, config.rate_per_bit)
        ranges = zip((config.acceleration_range, config.rate_range), self._scale, strict=True)
        self._ends = tuple(end - 0.5 * bit for end, bit in ranges)
        self._bias = (np.array(config.acceleration_bias), np.array(config.rate_bias))
        self._half: list[tuple[int, tuple[int, ...]]] = [(0, ()), (0, ())]
        """Of each sensor the SYNC that it answered last, and its counts."""
        self._sample: tuple[tuple[int, ...], ...] | None = None
        self._sampled_sync, self._equal, self._started_s = 0, 0, 0.0
        fieldbus.listen(self._ids[0], lambda data, _stamp: self._on_counts(0, data))
        fieldbus.listen(self._ids[1], lambda data, _stamp: self._on_counts(1, data))

    def open(self) -> None:
        """Map both sensors, let them answer every SYNC, and start the node.

        Blocks; raises `DeviceError`.
        """
        objects = (self.config.acceleration_object, self.config.rate_object)
        writes: list[Write] = []
        for number, (cob_id, index) in enumerate(zip(self._ids, objects, strict=True)):
            self._bus.expect_no_answers(cob_id)
            pdo, mapping = Com.TPDO_COMMUNICATION + number, Com.TPDO_MAPPING + number
            writes += [(pdo, 1, "<I", cob_id | PDO_INVALID), (pdo, 2, "<B", EVERY_SYNC)]
            writes += [(mapping, 0, "<B", 0)]
            writes += [
                (mapping, axis, "<I", index << 16 | axis << 8 | _AXIS_BITS) for axis in (1, 2, 3)
            ]
            writes += [(mapping, 0, "<B", 3), (pdo, 1, "<I", cob_id)]
        self._node.open(*writes)
        for cob_id in self._ids:
            self._bus.expect_answers(cob_id)
        self._sample, self._sampled_sync, self._equal = None, self._bus.sync_count, 0

    def read(self) -> InertialReading:
        """Return the newest sample, and why it is none; start a unit again that was cut off."""
        trouble = self._node.trouble() or self._stale() or self._saturated() or self._stuck()
        lost = trouble is not None and trouble.cause is Cause.PDO_LOST
        idle = lost and self._node.state is NmtState.PRE_OPERATIONAL
        if idle and self._bus.now - self._started_s > START_AGAIN_S:
            self._started_s = self._bus.now
            with suppress(can.CanError):  # the bus' own trouble tells of it
                self._node.start()
        ready = self._sample is not None
        if self._sample is None or trouble is not None:
            return InertialReading(ready, None, None, trouble)
        acceleration, rate = (
            scale * np.array(counts) - bias
            for scale, counts, bias in zip(self._scale, self._sample, self._bias, strict=True)
        )
        return InertialReading(ready, acceleration, rate, None)

    def stop(self) -> None:
        """Do nothing: it moves nothing, and its readings are wanted while others stop."""

    def close(self) -> None:
        """Watch the unit no more. Never raises."""
        self._node.close()
        for cob_id in self._ids:
            self._bus.expect_no_answers(cob_id)
        self._sample = None

    def values(self) -> dict[str, Value]:
        """Return acceleration [m/s²] and rate [rad/s] by axis, None without; and what is wrong."""
        reading = self.read()
        found: dict[str, Value] = {}
        for letter, vector in (("a", reading.acceleration), ("w", reading.rate)):
            values = (None,) * 3 if vector is None else tuple(map(float, vector))
            found |= {f"{letter}{axis}": x for axis, x in zip("xyz", values, strict=True)}
        trouble = reading.trouble
        return found | {"trouble": None if trouble is None else str(trouble.cause)}

    def _stale(self) -> Trouble | None:
        missed = self._bus.sync_count - self._sampled_sync
        if missed <= MOST_MISSED_SYNCS:
            return None
        detail = f"no sample for {missed} SYNCs"
        return Trouble(Cause.PDO_LOST, self.name, detail, {"missed_syncs": missed})

    def _saturated(self) -> Trouble | None:
        if self._sample is None:
            return None
        for sensor, scale, end, counts in zip(
            _SENSORS, self._scale, self._ends, self._sample, strict=True
        ):
            for axis, count in zip("xyz", counts, strict=True):
                if abs(scale * count) >= end:
                    detail = f"{sensor} {axis} is at the end of its range, {scale * count:.4g}"
                    values: dict[str, Value] = {"axis": f"{sensor} {axis}", "value": scale * count}
                    return Trouble(Cause.SATURATED, self.name, detail, values)
        return None

    def _stuck(self) -> Trouble | None:
        if self._equal <= MOST_EQUAL:
            return None
        detail = f"{self._equal} samples are equal in all axes"
        return Trouble(Cause.UNCHANGING, self.name, detail, {"samples": self._equal})

    def _on_counts(self, sensor: int, data: bytes) -> None:
        if len(data) != _COUNTS.size:
            return  # nothing that it was told to send: it ages
        self._half[sensor] = self._bus.sync_count, _COUNTS.unpack(data)
        (first, acceleration), (second, rate) = self._half
        if first == second:
            before, self._sample = self._sample, (acceleration, rate)
            self._equal = self._equal + 1 if before == self._sample else 1
            self._sampled_sync = first
