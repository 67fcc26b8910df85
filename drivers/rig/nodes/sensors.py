"""Simulated sensors: a Robotous force/torque sensor, an inertial unit, a SICK LMS111 scanner."""

import math
import operator
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final, Self, cast

import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell
from ....config.schema.bus import Entry
from ....config.schema.mechanism import ForceTorqueSection, ImuSection
from ....config.schema.rig import RigForceTorqueSection
from ....protocols.canopen import robotous
from ....protocols.canopen.can301 import FrameError
from ....protocols.canopen.robotous import COUNTS_PER_NEWTON, COUNTS_PER_NEWTON_METRE, SensorCommand
from ....protocols.messages.rig import MOST_FORCE, RigFault, value_of, vector_of
from ....protocols.sick import ANGLE_UNIT, MEASURING, Scan, encode_scan, framed, hexadecimal
from ..physics.sensors import Rangefinder
from ..physics.world import World
from .canopen import CanNode
from .node import Bench, NodeLink

# --- How a force/torque sensor with cross-talk answers to a load ----------------------------------
#
# Mounting and cross-talk together are one matrix, and nobody can tell from outside how much of
# it is which: an antisymmetric coupling among the forces *is* a small rotation. So cross-talk
# means here what is left when that rotation is counted as mounting: it is symmetric among the
# forces, and among the moments.

_LENGTH = COUNTS_PER_NEWTON / COUNTS_PER_NEWTON_METRE
"""The moment that fills the sensor's range as much as a newton does [m]."""


def response(cross_talk: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the matrix (6, 6) from the load in the Sensor frame to the reading.

    Each axis shows in each other one of its kind with the part `cross_talk`, and each force in each
    moment with that part of the ranges' ratio; the signs are drawn.
    """
    signs = rng.choice((-1.0, 1.0), size=(6, 6))
    coupling = np.zeros((6, 6))
    for part in (slice(0, 3), slice(3, 6)):
        upper = np.triu(signs[part, part], 1)
        coupling[part, part] = upper + upper.T
    coupling[3:, :3] = _LENGTH * signs[3:, :3]
    matrix: NDArray[np.float64] = np.eye(6) + cross_talk * coupling
    return matrix


# --- The simulated Robotous force/torque sensor: free-running, with noise, bias and quantisation
#
# It saturates as the real one does: beyond its measuring range it reads the range's end, and
# reports an overload.

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
        self._range = tuple(config.measuring_range)
        self._offset = [0.0] * 6
        self._period_s = 1.0 / config.rate_hz
        self.due_s = float("inf")
        """When the next sample is due [s]."""
        self._frozen = False
        self._mute = False
        self._shift, self._shift_s, self._comes_s = np.zeros(6), 0.0, 0.0
        """What the fault `bias` adds, since when, and how long it takes to come [s]."""
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
        self.due_s, self._offset, self._last = float("inf"), [0.0] * 6, None

    def inject(self, fault: RigFault) -> None:
        """Freeze the sample, or let its zero drift. Raises `ValueError` for other faults."""
        if fault.kind == "bias":
            self._shift_s = self._clock()
            self._shift[:3] = vector_of(fault, MOST_FORCE, "N") if fault.on else 0.0
            self._comes_s = value_of(fault, 0.0, 3600.0, "s", default=0.0)
        elif fault.kind == "freeze":
            self.freeze(fault.on, mute=bool(fault.value))
        else:
            raise ValueError(f"fault {fault.kind}: its target is a joint, not {fault.target}")

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
            self._offset = self._reading().tolist() if parameter else [0.0] * 6
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
            noisy = self._reading() + self._rng.standard_normal(6) * self._noise
            reading, overload = noisy.tolist(), 0
            for axis, most in enumerate(self._range):
                if abs(reading[axis]) > most:
                    reading[axis] = math.copysign(most, reading[axis])
                    # One bit for each axis; nobody reads more of it than whether it is zero.
                    overload |= 1 << axis
            x, y, z, mx, my, mz = map(operator.sub, reading, self._offset)
            sample = robotous.Sample((x, y, z), (mx, my, mz), overload, 0)
            self._last = robotous.encode_sample(sample)
        for can_id, half in zip(self._reply_ids, self._last, strict=True):
            self.link.send(can_id, half)

    def _reading(self) -> NDArray[np.float64]:
        reading: NDArray[np.float64] = self._response @ self._load() + self._bias
        since_s = self._clock() - self._shift_s
        return reading + self._shift * min(1.0, since_s / max(self._comes_s, _EPSILON_S))


# --- The simulated inertial measurement unit: specific force and rate, at each SYNC ----

IMU_EDS: Final = Path(__file__).resolve().parents[3] / "config" / "devices" / "simulated_imu.eds"
MOST_BIAS: Final = 10.0
"""Of the fault `bias` [rad/s]."""
_OBJECTS: Final = (0x3102, 0x3103)
"""Specific force and angular rate, in its data sheet."""


class SimulatedImu(CanNode):
    """Samples the `motion` of its link (two of (3,), [m/s²], [rad/s]) once at an instant.

    Bias and noise are added; beyond its range it reads the range's end. The fault `freeze` repeats
    the last sample, `bias` is a gyroscope's whose bias jumps.
    """

    def __init__(
        self,
        imu: ImuSection,
        link: NodeLink,
        motion: Callable[[], tuple[NDArray[np.float64], NDArray[np.float64]]],
        rng: np.random.Generator,
        clock: Callable[[], float],
    ) -> None:
        super().__init__(imu.node, link, clock, IMU_EDS)
        truth, self._motion, self._rng = imu.virtual, motion, rng
        self._bias = np.array([truth.acceleration_bias, truth.rate_bias])
        self._shift = np.zeros((2, 1))
        """By which all axes of either sensor read more than at the start."""
        self._noise = np.array([[truth.acceleration_noise], [truth.rate_noise]])
        self._scale = np.array([[imu.acceleration_per_bit], [imu.rate_per_bit]])
        self._most = np.array([[imu.acceleration_range], [imu.rate_range]])
        self._sampled_s, self._frozen = -1.0, False
        self._counts = [0] * 6
        """The newest sample: acceleration and rate."""
        known = self.objects.object_dictionary
        for row, index in enumerate((imu.acceleration_object, imu.rate_object)):
            if index not in known:  # another maker's: the same sensor, elsewhere
                known.indices[index] = known[_OBJECTS[row]]
            for axis in range(3):
                self.objects.measured[index, axis + 1] = partial(self._sample, 3 * row + axis)

    @classmethod
    def from_bench(cls, entry: Entry, bench: Bench) -> Self:
        """Make the unit on Base or Wrist of the bench's arm."""
        imu = cast(ImuSection, entry.section)
        motion = partial(bench.world.inertial, entry.part or 0, imu.on == "base", imu.T_on_imu)
        return cls(imu, bench.link(), motion, bench.rng(), bench.clock)

    def inject(self, fault: RigFault) -> None:
        """Freeze the sample, or shift the gyroscope's. Raises `ValueError` for other faults."""
        if fault.kind == "bias":
            more = value_of(fault, -MOST_BIAS, MOST_BIAS, "rad/s", default=0.06)
            self._shift[1] = more if fault.on else 0.0
        elif fault.kind == "freeze":
            self._frozen = fault.on
        else:
            raise ValueError(f"fault {fault.kind}: an imu can only freeze, or have a bias")

    def _sample(self, axis: int) -> int:
        """Return an axis of this instant's sample, which is a new one if it is not there yet."""
        now = self.clock()
        if now != self._sampled_s and not self._frozen:
            self._sampled_s = now
            reading = np.array(self._motion()) + self._bias + self._shift
            reading += self._noise * self._rng.normal(size=(2, 3))
            held = np.clip(reading, -self._most, self._most)
            self._counts = np.rint(held / self._scale).astype(int).ravel().tolist()
        return self._counts[axis]


# --- A simulated SICK LMS111: answers requests, and sends a telegram for every scan (CoLa-A) ------
#
# | fault | what it does |
# |---|---|
# | silence | no telegrams, no answers |
# | drop | the end of a telegram is lost, with the probability `value`, 1 by default |
# | corrupt | words of a telegram are garbled, likewise |
# | crop | scans have only so many rays, `value`, 181 by default: another angle range |

NAME: Final = "scanner"
"""Target of its faults."""
KINDS: Final = ("silence", "drop", "corrupt", "crop")


class SimulatedScanner:
    """The scanner of one rig. `on_telegram` gets the bytes of every scan, as they go out."""

    def __init__(self, cell: Cell, world: World) -> None:
        self._finder = Rangefinder(cell, world.model, world.data)
        self._faults: dict[str, float] = {}
        seed = 0 if cell.config.rig is None else cell.config.rig.seed
        self._rng = np.random.default_rng([seed, 3])
        self.on_telegram: list[Callable[[bytes], None]] = []
        self.on_step: Callable[[], None] = _ignore
        """Called after every tenth physics step."""
        self.scans = self._steps = 0

    @classmethod
    def of(cls, cell: Cell, world: World) -> "SimulatedScanner | None":
        """Return that of a cell; None where it has none."""
        return None if cell.config.scanner is None else cls(cell, world)

    def step(self, time_s: float) -> None:
        """Let the mirror turn on; send what is complete."""
        self._steps += 1
        if self._steps % 10 == 0:
            self.on_step()
        scan = self._finder.step(time_s)
        if scan is None or "silence" in self._faults:
            return
        self.scans += 1
        telegram = self._spoilt(framed(encode_scan(self._cropped(scan))))
        for listener in self.on_telegram:
            listener(telegram)

    def inject(self, fault: RigFault) -> None:
        """Apply a fault, or take it back. Raises `ValueError`."""
        if fault.kind not in KINDS:
            raise ValueError(f"fault {fault.kind}: a scanner knows: {', '.join(KINDS)}")
        value = 1.0
        if fault.kind == "crop":
            most = float(self._finder.scanner.rays - 1)
            value = 181.0 if fault.value is None else value_of(fault, 1.0, most, "rays")
        elif fault.value is not None:
            value = value_of(fault, 0.0, 1.0, "")
        self._faults.pop(fault.kind, None)
        if fault.on:
            self._faults[fault.kind] = value

    def answer(self, words: str) -> str | None:
        """Return the answer to a request; None while it is silent."""
        if "silence" in self._faults:
            return None
        scanner = self._finder.scanner
        kind, _, rest = words.partition(" ")
        name = rest.partition(" ")[0]
        first, last = scanner.first, scanner.first + scanner.step * (scanner.rays - 1)
        span = (
            f"{round(scanner.step / ANGLE_UNIT):X} {hexadecimal(round(first / ANGLE_UNIT))} "
            f"{hexadecimal(round(last / ANGLE_UNIT))}"
        )
        answers = {
            ("sMN", "SetAccessMode"): "sAN SetAccessMode 1",
            ("sWN", "LMDscandatacfg"): "sWA LMDscandatacfg",
            ("sMN", "LMCstartmeas"): "sAN LMCstartmeas 0",
            ("sMN", "mEEwriteall"): "sAN mEEwriteall 1",
            ("sMN", "Run"): "sAN Run 1",
            ("sRN", "SCdevicestate"): "sRA SCdevicestate 1",
            ("sRN", "STlms"): f"sRA STlms {MEASURING} 0 8 00:00:00 8 01.01.1970 0 0 0",
            ("sRN", "LMPoutputRange"): f"sRA LMPoutputRange 1 {span}",
            ("sRN", "LMPscancfg"): f"sRA LMPscancfg {round(100 * scanner.rate_hz):X} 1 {span}",
            ("sEN", "LMDscandata"): f"sEA LMDscandata {rest.rpartition(' ')[2]}",
        }
        return answers.get((kind, name), "sFA 3" if kind == "sRN" else "sFA C")

    def _cropped(self, scan: Scan) -> Scan:
        rays = self._faults.get("crop")
        return scan if rays is None else replace(scan, distances=scan.distances[: int(rays)])

    def _spoilt(self, telegram: bytes) -> bytes:
        if self._rng.random() < self._faults.get("drop", 0.0):
            telegram = telegram[: int(self._rng.integers(1, len(telegram) - 1))]
        if self._rng.random() < self._faults.get("corrupt", 0.0):
            spoilt = bytearray(telegram)
            for i in self._rng.integers(1, len(spoilt) - 1, 8).tolist():
                spoilt[i] = ord("Z")
            telegram = bytes(spoilt)
        return telegram


def _ignore() -> None:
    """Stand in for a listener."""
