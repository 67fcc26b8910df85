"""Judge of every frame that the daemon sends: limits of setpoints, and the hash of all."""

import operator
import struct
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate

from ...config.load import Cell
from ...config.schema.bus import Entry
from ...config.schema.mechanism import DriveSection
from ...protocols.canopen.cia402 import Unwrapped

KINDS = ("velocity", "acceleration", "jerk")
"""What first, second and third differences of positions are judged as."""

STEPS = (1.0, 2.0, 4.0)  # encoder steps of tolerance on first, second and third differences [1]

RELATIVE = 1e-6  # relative tolerance on every bound, for rounding [1]

GATE = 1e-3  # relative tolerance of the torque's rate: the gate's own [1]

TRACKING = 0.05
"""A joint that catches up with its command may be faster than its bound by this part [1]."""

SAG = 0.005  # a joint that is enabled at its limit, or outside, may sag by so much [rad]

LEAP = 0.001  # the first setpoint after enabling may be so far from where the joint stood [rad]

_SYNC = 0x080
_RPDO1 = 0x200
_TPDO1 = 0x180
_ENABLED_MASK, _ENABLED = 0x6F, 0x27
_COMMAND_MASK, _COMMAND = 0x0F, 0x0F


@dataclass
class _Joint:
    """Bounds of one joint, and the setpoints that were in force at the last SYNCs."""

    name: str
    mode: str  # operation mode: csp, csv or cst
    scale: float
    zero: float
    unit: float
    """What one count of a setpoint is [rad, rad/s or N·m], signed; one of 0 is at `origin`."""
    origin: float
    lower: float
    upper: float
    bounds: tuple[float, float, float]
    step: float
    torque_bounds: tuple[float, float]  # torque [N·m] and its rate [N·m/s]
    fastest: float  # greatest speed that may be sent in CSV [rad/s]
    low: float
    """Least angle that counts as inside [rad]: the limit, or how far outside the joint still is."""
    high: float
    turns: Unwrapped | None = None  # counts of a wheel, which wrap
    stood: float | None = None
    """Where the joint stood when its drive was last off [rad]; None once it was sent a position."""
    measured: float | None = None
    before: float | None = None  # setpoint at the SYNC before the last [rad]
    pending: float | None = None
    enabled: bool = False
    sent: list[float] = field(default_factory=list)
    """Newest setpoint in force, and its backward differences as far as SYNCs in a row tell."""

    @cached_property
    def command(self) -> struct.Struct:
        """Layout of RPDO1: the controlword, and a setpoint."""
        return struct.Struct("<Hh" if self.mode == "cst" else "<Hi")

    def stands(self, q: float) -> None:
        """Take in where the joint stands while its drive is off."""
        self.low, self.high = min(self.lower, q - SAG), max(self.upper, q + SAG)
        self.stood = q

    def left(self, q: float, sag: float = 0.0) -> float | None:
        """Return the bound that an angle is beyond, if any; one further in is a new bound."""
        if q < self.low - self.step:
            return self.lower
        if q > self.high + self.step:
            return self.upper
        self.low = min(self.lower, max(self.low, q - sag))
        self.high = max(self.upper, min(self.high, q + sag))
        return None


@dataclass(frozen=True)
class Violation:
    """One setpoint beyond one bound."""

    time_s: float
    joint: str
    kind: str
    value: float
    bound: float


class Observer:
    """Watches setpoints of every drive of a cell; told every frame on the bus, in order."""

    def __init__(self, cell: Cell) -> None:
        self._period = cell.config.timing.period_s
        self._powers = tuple(self._period**order for order in (1, 2, 3))
        buses = [bus.name for bus in cell.config.fieldbuses]
        self._on_bus: list[dict[int, _Joint]] = [{} for _ in buses]  # joints by node, of each bus
        for entry in cell.devices:
            if isinstance(entry.section, DriveSection):
                made = _joint(entry, cell.parts[entry.part or 0])
                self._on_bus[buses.index(entry.bus)][entry.section.node] = made
        self.violations: list[Violation] = []
        self.max_speed_ratio = 0.0
        self.max_acceleration_ratio = 0.0
        self.syncs = 0

    def frame(self, time_s: float, can_id: int, data: bytes, bus: int = 0) -> None:
        """Take in one frame, stamped in seconds, of the cell's bus of that index."""
        joints = self._on_bus[bus]
        if can_id == _SYNC:
            self.syncs += bus == 0
            for joint in joints.values():
                if joint.pending is None:
                    joint.sent.clear()
                else:
                    self._in_force(joint, time_s, joint.pending)
        elif _RPDO1 < can_id <= _RPDO1 + 127:
            watched = joints.get(can_id - _RPDO1)
            if watched is not None and len(data) == watched.command.size:
                controlword, raw = watched.command.unpack(data)
                commanded = controlword & _COMMAND_MASK == _COMMAND
                on = commanded and watched.enabled
                watched.pending = watched.unit * raw + watched.origin if on else None
        elif _TPDO1 < can_id <= _TPDO1 + 127 and len(data) == 8:
            watched = joints.get(can_id - _TPDO1)
            if watched is not None:
                statusword, counts = struct.unpack_from("<Hi", data)
                if watched.turns is not None:
                    counts = watched.turns.take(counts)
                watched.enabled = statusword & _ENABLED_MASK == _ENABLED
                if not watched.enabled:
                    watched.stands(watched.zero + watched.scale * counts)
                if watched.mode != "csp":
                    self._moved(time_s, watched, watched.zero + watched.scale * counts)

    def _moved(self, time_s: float, joint: _Joint, q: float) -> None:
        """Judge where an enabled joint has come to."""
        joint.before, joint.measured = joint.measured if joint.enabled else None, q
        if not joint.enabled:
            return
        bound = joint.left(q, SAG)
        if bound is not None:
            self._found(time_s, joint, "measured_position", q, bound)
        if joint.before is not None:
            speed, most = (q - joint.before) / self._period, joint.bounds[0]
            self.max_speed_ratio = max(self.max_speed_ratio, abs(speed) / most)
            if abs(speed) > most * (1 + TRACKING) + joint.step / self._period:
                self._found(time_s, joint, "measured_velocity", speed, most)

    def _found(self, time_s: float, joint: _Joint, kind: str, value: float, bound: float) -> None:
        self.violations.append(Violation(time_s, joint.name, kind, value, bound))

    def _in_force(self, joint: _Joint, time_s: float, setpoint: float) -> None:
        """Judge the setpoint that a SYNC puts in force."""
        if joint.mode == "csp":
            self._judge_position(joint, time_s, setpoint)
        elif joint.mode == "cst":
            self._judge_torque(joint, time_s, setpoint)
        elif abs(setpoint) > joint.fastest * (1 + TRACKING) + joint.step:
            self._found(time_s, joint, "velocity", setpoint, joint.fastest)

    def _judge_torque(self, joint: _Joint, time_s: float, torque: float) -> None:
        most, fastest = joint.torque_bounds
        step = abs(joint.unit)
        if abs(torque) > most * (1 + RELATIVE) + 0.5 * step:
            self._found(time_s, joint, "torque", torque, most)
        if joint.sent:
            rate = (torque - joint.sent[0]) / self._period
            if abs(rate) > fastest * (1 + GATE) + step / self._period:
                self._found(time_s, joint, "torque_rate", rate, fastest)
        joint.sent = [torque]

    def _judge_position(self, joint: _Joint, time_s: float, q: float) -> None:
        beyond = joint.left(q)
        if beyond is not None:
            self._found(time_s, joint, "position", q, beyond)
        if joint.stood is not None:
            # Whatever the daemon takes it for: a drive leaps to its first setpoint.
            leap = q - joint.stood
            if abs(leap) > LEAP + joint.step:
                self._found(time_s, joint, "leap", leap, LEAP)
            joint.stood = None
        joint.sent = list(accumulate((q, *joint.sent[:3]), operator.sub))
        for order, difference in enumerate(joint.sent[1:]):
            power, bound = self._powers[order], joint.bounds[order]
            value = difference / power
            if order == 0:
                self.max_speed_ratio = max(self.max_speed_ratio, abs(value) / bound)
            elif order == 1:
                ratio = abs(value) / bound
                self.max_acceleration_ratio = max(self.max_acceleration_ratio, ratio)
            if abs(value) > bound * (1 + RELATIVE) + STEPS[order] * joint.step / power:
                self._found(time_s, joint, KINDS[order], value, bound)


def _joint(entry: Entry, part: Cell) -> _Joint:
    """Return the bounds of a drive's joint, by the cell of its mechanism."""
    drive = entry.section
    if not isinstance(drive, DriveSection):
        raise TypeError(f"{entry.name} is no drive")
    joint = next(j for j in part.robot.joints if j.name == drive.joint)
    mode, scale = part.config.mechanism.mode_of(drive), drive.direction / drive.counts_per_radian
    return _Joint(
        name=entry.name,
        mode=mode,
        scale=scale,
        zero=drive.zero_rad,
        unit=drive.direction * drive.rated_torque * 1e-3 if mode == "cst" else scale,
        origin=drive.zero_rad if mode == "csp" else 0.0,
        lower=joint.lower,
        upper=joint.upper,
        bounds=(drive.max_velocity, drive.max_acceleration, drive.max_jerk),
        step=1.0 / drive.counts_per_radian,
        torque_bounds=(drive.max_torque, drive.max_torque_rate or float("inf")),
        fastest=drive.max_velocity + part.config.torque.speed_gain * drive.window,
        low=joint.lower,
        high=joint.upper,
        turns=Unwrapped() if drive.joint in part.config.mechanism.wheels else None,
    )
