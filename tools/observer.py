"""A judge on the bus: counts sent setpoints beyond any bound, from raw frames and SYNC stamps.

It shares no code with the server's control: it decodes frames by itself, knows the bounds from the
cell file, and forms finite differences of the setpoints that were in force at each SYNC. The
tolerance is what quantised targets add: `STEPS` encoder steps, over T for speed, T² for
acceleration and T³ for jerk.
"""

import itertools
import struct
from dataclasses import dataclass, field

from ..config.load import Cell

STEPS = (1.0, 2.0, 4.0)
"""Encoder steps of tolerance on first, second and third differences [1]."""

RELATIVE = 1e-6
"""Relative tolerance on every bound, for rounding [1]."""

_SYNC = 0x080
_RPDO1 = 0x200
_TPDO1 = 0x180
_ENABLED_MASK, _ENABLED = 0x6F, 0x27
_COMMAND_MASK, _COMMAND = 0x0F, 0x0F


@dataclass
class _Joint:
    """Bounds of one joint, and the setpoints that were in force at the last SYNCs."""

    name: str
    scale: float
    zero: float
    lower: float
    upper: float
    bounds: tuple[float, float, float]
    step: float
    pending: float | None = None
    enabled: bool = False
    history: list[tuple[float, float]] = field(default_factory=list)


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
        limits = {j.name: j for j in cell.robot.joints}
        self._period = cell.config.timing.period_s
        self._joints: dict[int, _Joint] = {}
        for drive in cell.config.mechanism.drives:
            joint = limits[drive.joint]
            self._joints[drive.node] = _Joint(
                name=drive.joint,
                scale=drive.direction / drive.counts_per_radian,
                zero=drive.zero_rad,
                lower=joint.lower,
                upper=joint.upper,
                bounds=(drive.max_velocity, drive.max_acceleration, drive.max_jerk),
                step=1.0 / drive.counts_per_radian,
            )
        self.violations: list[Violation] = []
        self.max_speed_ratio = 0.0
        self.max_acceleration_ratio = 0.0
        self.syncs = 0

    def frame(self, time_s: float, can_id: int, data: bytes) -> None:
        """Take in one frame, stamped in seconds."""
        if can_id == _SYNC:
            self.syncs += 1
            for joint in self._joints.values():
                self._at_sync(joint, time_s)
        elif _RPDO1 < can_id <= _RPDO1 + 127 and len(data) == 6:
            watched = self._joints.get(can_id - _RPDO1)
            if watched is not None:
                controlword, counts = struct.unpack("<Hi", data)
                commanded = controlword & _COMMAND_MASK == _COMMAND
                on = commanded and watched.enabled
                watched.pending = watched.zero + watched.scale * counts if on else None
        elif _TPDO1 < can_id <= _TPDO1 + 127 and len(data) == 8:
            watched = self._joints.get(can_id - _TPDO1)
            if watched is not None:
                (statusword,) = struct.unpack_from("<H", data)
                watched.enabled = statusword & _ENABLED_MASK == _ENABLED

    def _at_sync(self, joint: _Joint, time_s: float) -> None:
        """Judge the setpoint that this SYNC puts in force."""
        if joint.pending is None:
            joint.history.clear()
            return
        q = joint.pending
        if not joint.lower - joint.step <= q <= joint.upper + joint.step:
            bound = joint.lower if q < joint.lower else joint.upper
            self.violations.append(Violation(time_s, joint.name, "position", q, bound))
        joint.history = [*joint.history[-3:], (time_s, q)]
        angles = [q for _, q in joint.history]
        for order, kind in enumerate(("velocity", "acceleration", "jerk")):
            if len(angles) < order + 2:
                return
            value = _difference(angles, order + 1) / self._period ** (order + 1)
            bound = joint.bounds[order]
            tolerance = STEPS[order] * joint.step / self._period ** (order + 1)
            if order == 0:
                self.max_speed_ratio = max(self.max_speed_ratio, abs(value) / bound)
            elif order == 1:
                ratio = abs(value) / bound
                self.max_acceleration_ratio = max(self.max_acceleration_ratio, ratio)
            if abs(value) > bound * (1 + RELATIVE) + tolerance:
                self.violations.append(Violation(time_s, joint.name, kind, value, bound))


def _difference(values: list[float], order: int) -> float:
    """Return the backward difference of an order, at the newest value."""
    while order:
        values = [b - a for a, b in itertools.pairwise(values)]
        order -= 1
    return values[-1]
