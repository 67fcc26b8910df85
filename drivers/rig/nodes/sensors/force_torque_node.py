"""The simulated Robotous force/torque sensor: free-running, with noise, bias and quantisation.

It saturates as the real one does: beyond its measuring range it reads the range's end, and reports
an overload.
"""

from collections.abc import Callable
from functools import partial
from typing import Self, cast

import numpy as np
from numpy.typing import NDArray

from .....config.schema.bus.on_bus import Entry
from .....config.schema.mechanism.mechanism import ForceTorqueSection
from .....config.schema.rig.rig import RigForceTorqueSection
from .....protocols.canopen import robotous
from .....protocols.canopen.can301 import FrameError
from .....protocols.canopen.robotous import SensorCommand
from .....protocols.messages.rig import RigFault
from ..bench import Bench
from ..link import NodeLink
from .cross_talk import response

_EPSILON_S = 1e-7


class SimulatedForceTorque:
    """Sends the `load` on itself (6,) [N, N·m] in the Sensor frame at its rate.

    Silent until it is told to start. The rate changes only while it is stopped, as the maker's
    manual has it.
    """

    samples_after_step = True

    def __init__(
        self,
        config: ForceTorqueSection,
        truth: RigForceTorqueSection,
        link: NodeLink,
        load: Callable[[], NDArray[np.float64]],
        rng: np.random.Generator,
        response_rng: np.random.Generator,
        clock: Callable[[], float],
    ) -> None:
        self.command_id = config.command_id
        self._reply_ids = config.reply_ids
        self.link = link
        link.on_frame = self.receive
        self._load = load
        self._rng = rng
        self._clock = clock
        self._noise = np.array(truth.noise)
        self._bias = np.array(truth.bias)
        self._response = response(truth.cross_talk, response_rng)
        self._range = np.array(config.measuring_range)
        self._offset = np.zeros(6)
        self._period_s = 1.0 / config.rate_hz
        self.due_s = float("inf")
        """When the next sample is due [s]."""
        self._frozen = False
        self._mute = False
        self._last: tuple[bytes, bytes] | None = None

    @classmethod
    def from_bench(cls, entry: Entry, bench: Bench) -> Self:
        """Make the sensor at the wrist of the bench's arm."""
        sensor, truth = cast(ForceTorqueSection, entry.section), bench.rig(entry).force_torque
        link, noise, response = bench.link(), bench.rng(), bench.rng()
        load = partial(bench.world.sensor_wrench, entry.part or 0)
        return cls(sensor, truth, link, load, noise, response, bench.clock)

    def identifiers(self) -> tuple[int, ...]:
        """Return that of its commands."""
        return (self.command_id,)

    def boot(self) -> None:
        """Power on: it is silent until it is told to start."""
        self.due_s, self._offset, self._last = float("inf"), np.zeros(6), None

    def inject(self, fault: RigFault) -> None:
        """Freeze the sample. Raises `ValueError` for other faults."""
        if fault.kind != "freeze":
            raise ValueError(f"fault {fault.kind}: its target is a joint, not {fault.target}")
        self.freeze(fault.on, mute=bool(fault.value))

    def freeze(self, on: bool, *, mute: bool = False) -> None:
        """Repeat the last sample for ever, or with `mute` send none; `on` false: work again."""
        self._frozen, self._mute = on and not mute, on and mute

    def receive(self, can_id: int, data: bytes) -> None:
        """Obey a command; anything else on the bus is ignored, also a command that is none."""
        if can_id != self.command_id:
            return
        try:
            command, parameter = robotous.parse_command(data)
        except FrameError:
            return
        if command is SensorCommand.START:
            self.due_s = self._clock() + self._period_s
        elif command is SensorCommand.STOP:
            self.due_s = float("inf")
        elif command is SensorCommand.SET_BIAS:
            self._offset = self._reading() if parameter else np.zeros(6)
        elif command is SensorCommand.SET_RATE and self.due_s == float("inf"):
            rates = {code: rate for rate, code in robotous.RATE_CODES.items()}
            self._period_s = 1.0 / rates.get(parameter, 200)

    def tick(self) -> None:
        """Send a sample when one is due."""
        if self._clock() + _EPSILON_S < self.due_s:
            return
        self.due_s += self._period_s
        if self._mute:
            return
        if not self._frozen or self._last is None:
            reading = self._reading() + self._rng.normal(size=6) * self._noise
            held = np.clip(reading, -self._range, self._range)
            # One bit for each axis; nobody reads more of it than whether it is zero.
            overload = int((1 << np.flatnonzero(held != reading)).sum())
            x, y, z, mx, my, mz = (held - self._offset).tolist()
            sample = robotous.Sample((x, y, z), (mx, my, mz), overload, 0)
            self._last = robotous.encode_sample(sample)
        for can_id, half in zip(self._reply_ids, self._last, strict=True):
            self.link.send(can_id, half)

    def _reading(self) -> NDArray[np.float64]:
        reading: NDArray[np.float64] = self._response @ self._load() + self._bias
        return reading
